"""Turning as a whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.directions import ORIGIN, Y, unit
from pipeline.flow.choreography import Number, Place, number_at, place_at
from pipeline.flow.parameters import Direction, Sense
from pipeline.flow.velocity import Term


@dataclass(frozen=True)
class Rotation(Term):
    """Turns everything about a line: velocity = speed · axis × r; keeps volume."""

    axis: Annotated[Direction, Sense("of the line")] = Y
    centre: Annotated[Place, Sense("a point on the line", "units")] = ORIGIN
    speed: Annotated[Number, Sense("counter-clockwise seen against the axis", "degrees/s", required=True)] = (
        1.0
    )

    @property
    def kind(self) -> int:
        return op.ROTATION

    def row(self, time: float) -> tuple[float, ...]:
        return (*place_at(self.centre, time), *unit(self.axis), number_at(self.speed, time))

    def steepness(self, time: float) -> float:
        return abs(number_at(self.speed, time))
