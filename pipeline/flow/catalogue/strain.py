"""Drawing out along an axis while narrowing across it."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.directions import ORIGIN, Y, unit
from pipeline.flow.choreography import Number, Place, Vector, number_at, place_at
from pipeline.flow.velocity import Term


@dataclass(frozen=True)
class Strain(Term):
    """Velocity = rate · height along the axis and −rate/2 · r across it; free of divergence.

    Length grows as exp(rate × seconds) and the volume stays. A negative rate flattens.

    rate  per second

    Source: Batchelor, *An Introduction to Fluid Dynamics* (1967), §2.3.
    """

    axis: Vector = Y
    centre: Place = ORIGIN
    rate: Number = 1.0

    @property
    def kind(self) -> int:
        return op.STRAIN

    def row(self, time: float) -> tuple[float, ...]:
        rate = number_at(self.rate, time)
        return (*place_at(self.centre, time), *unit(self.axis), rate, -0.5 * rate)

    def steepness(self, time: float) -> float:
        return abs(number_at(self.rate, time))
