"""Halvorsen's attractor as a flow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.attractor import Attractor
from pipeline.flow.choreography import Number, Vector, number_at
from pipeline.flow.parameters import Positive, Sense


@dataclass(frozen=True)
class Halvorsen(Attractor):
    """Three wings that feed each other around a diagonal.

        x' = −a x − 4 y − 4 z − y²    y' = −a y − 4 z − 4 x − z²    z' = −a z − 4 x − 4 y − x²

    It is about 20 of its units wide, with (−3.5, −3.5, −3.5) at `centre`. The divergence is
    −3 a × time_scale.

    Source: Sprott, *Chaos and Time-Series Analysis* (2003), appendix A.5, who names it after Halvorsen.
    """

    reach: ClassVar[float] = 11.0

    a: Annotated[Number, Sense("a: how strongly it is held together")] = 1.4
    scale: Annotated[Positive, Sense("of its units in one of the scene's")] = 10.0
    time_scale: Annotated[Number, Sense("of its time units in a second")] = 0.1

    @property
    def kind(self) -> int:
        return op.HALVORSEN

    def _numbers(self, time: float) -> tuple[float, ...]:
        return (number_at(self.a, time),)

    def _middle(self, time: float) -> Vector:
        return -3.5, -3.5, -3.5

    def _gradient(self, time: float) -> float:
        """The diagonal, what is a turn of the axes, and what grows with a coordinate."""
        return abs(number_at(self.a, time)) + 4.0 + (3.0 + 2.0 * self.reach)
