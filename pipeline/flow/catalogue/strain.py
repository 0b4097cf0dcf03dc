"""Drawing out along an axis while narrowing across it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.directions import ORIGIN, Y, unit
from pipeline.flow.choreography import Number, Place, number_at, place_at
from pipeline.flow.parameters import Direction, Sense
from pipeline.flow.velocity import Term


@dataclass(frozen=True)
class Strain(Term):
    """Draws out along an axis and narrows across it; keeps volume.

    Velocity = rate · height along the axis and −rate/2 · r across it. Length grows as exp(rate × seconds);
    a negative rate flattens.

    Source: Batchelor, *An Introduction to Fluid Dynamics* (1967), §2.3.
    """

    axis: Annotated[Direction, Sense("along which it lengthens")] = Y
    centre: Annotated[Place, Sense("what stays where it is", "units")] = ORIGIN
    rate: Annotated[Number, Sense("of lengthening; negative flattens", "1/s", required=True)] = 1.0

    @property
    def kind(self) -> int:
        return op.STRAIN

    def row(self, time: float) -> tuple[float, ...]:
        rate = number_at(self.rate, time)
        return (*place_at(self.centre, time), *unit(self.axis), rate, -0.5 * rate)

    def steepness(self, time: float) -> float:
        return abs(number_at(self.rate, time))
