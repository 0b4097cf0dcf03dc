"""Turning as a whole."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.directions import ORIGIN, Y, unit
from pipeline.flow.choreography import Number, Place, Vector, number_at, place_at
from pipeline.flow.velocity import Term


@dataclass(frozen=True)
class Rotation(Term):
    """Rigid rotation about a line: velocity = speed · axis × r; free of divergence.

    speed  radians per second, counter-clockwise seen against the axis
    """

    axis: Vector = Y
    centre: Place = ORIGIN
    speed: Number = 1.0

    @property
    def kind(self) -> int:
        return op.ROTATION

    def row(self, time: float) -> tuple[float, ...]:
        return (*place_at(self.centre, time), *unit(self.axis), number_at(self.speed, time))

    def steepness(self, time: float) -> float:
        return abs(number_at(self.speed, time))
