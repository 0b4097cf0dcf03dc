"""Moving as a whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.directions import ORIGIN
from pipeline.flow.choreography import Place, place_at
from pipeline.flow.parameters import Sense
from pipeline.flow.velocity import Term


@dataclass(frozen=True)
class Translation(Term):
    """Uniform motion: the same velocity everywhere; keeps volume."""

    rate: Annotated[Place, Sense("velocity along x, y and z", "units/s", required=True)] = ORIGIN

    @property
    def kind(self) -> int:
        return op.TRANSLATION

    def row(self, time: float) -> tuple[float, ...]:
        return place_at(self.rate, time)

    def steepness(self, time: float) -> float:
        return 0.0
