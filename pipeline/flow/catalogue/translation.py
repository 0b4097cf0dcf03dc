"""Moving as a whole."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.flow import _kernels_velocity as kernels
from pipeline.flow.catalogue.directions import ORIGIN
from pipeline.flow.choreography import Place, place_at
from pipeline.flow.velocity import Term


@dataclass(frozen=True)
class Translation(Term):
    """The same velocity everywhere, in units per second."""

    velocity: Place = ORIGIN  # type: ignore[assignment]  # the field's one parameter, named as in the shot

    @property
    def kind(self) -> int:
        return kernels.TRANSLATION

    def row(self, time: float) -> tuple[float, ...]:
        return place_at(self.velocity, time)

    def steepness(self, time: float) -> float:
        return 0.0
