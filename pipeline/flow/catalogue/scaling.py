"""Growing or shrinking as a whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.directions import ORIGIN
from pipeline.flow.choreography import Place, place_at
from pipeline.flow.parameters import Sense
from pipeline.flow.velocity import Term


@dataclass(frozen=True)
class Scaling(Term):
    """Grows everything from a centre, uniformly or along each axis: velocity = rate · r.

    Lengths along an axis grow as exp(rate × seconds); the divergence is the sum of the three rates.
    """

    centre: Annotated[Place, Sense("what stays where it is", "units")] = ORIGIN
    rate: Annotated[Place, Sense("along x, y and z; negative shrinks", "1/s", required=True)] = ORIGIN

    @property
    def kind(self) -> int:
        return op.SCALING

    def row(self, time: float) -> tuple[float, ...]:
        return (*place_at(self.centre, time), *place_at(self.rate, time))

    def steepness(self, time: float) -> float:
        return max(abs(rate) for rate in place_at(self.rate, time))
