"""Moving as a whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.keyframes import Number, Place, number_at, place_at
from pipeline.flow.parameters import Direction, Positive, Sense
from pipeline.flow.vectors import ORIGIN, Y, unit
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

    def gradient_bound(self, time: float) -> float:
        return 0.0


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

    def gradient_bound(self, time: float) -> float:
        return abs(number_at(self.speed, time))


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

    def gradient_bound(self, time: float) -> float:
        return max(abs(rate) for rate in place_at(self.rate, time))


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

    def gradient_bound(self, time: float) -> float:
        return abs(number_at(self.rate, time))


@dataclass(frozen=True)
class Squeeze(Term):
    """Narrows a waist and drives what was there out to both sides, as a hand does; keeps volume.

    With ϖ the distance from the axis and h the height along it, L the length and R the radius of the grip,

        across  − rate/2 · ϖ · (1 − 2 h²/L²) · exp(−h²/L² − ϖ²/R²)
        along     rate · h · (1 − ϖ²/R²) · exp(−h²/L² − ϖ²/R²)

    from the stream function rate/2 · ϖ² h exp(−h²/L² − ϖ²/R²): a strain at the centre that fades away. Beyond
    R it flows back. A negative rate makes a bulge.

    Source: Stokes' stream function, Lamb, *Hydrodynamics* (6th ed., 1932), §94; the fading is ours.
    """

    axis: Annotated[Direction, Sense("along which it gives way")] = Y
    centre: Annotated[Place, Sense("of the grip", "units")] = ORIGIN
    radius: Annotated[Positive, Sense("of the grip, across the axis", "units")] = 2.0
    length: Annotated[Positive, Sense("of the grip, along the axis", "units")] = 0.7
    rate: Annotated[Number, Sense("of lengthening at the centre; negative bulges", "1/s", required=True)] = (
        1.0
    )

    @property
    def kind(self) -> int:
        return op.SQUEEZE

    def row(self, time: float) -> tuple[float, ...]:
        wide, long = number_at(self.radius, time) ** -2.0, number_at(self.length, time) ** -2.0
        return (*place_at(self.centre, time), *unit(self.axis), long, wide, number_at(self.rate, time))

    def gradient_bound(self, time: float) -> float:
        """At the centre it is the rate; the slanting parts grow with how far the grip is from round."""
        slender = number_at(self.radius, time) / number_at(self.length, time)
        return abs(number_at(self.rate, time)) * (1.0 + 0.75 * slender + 0.75 / slender)
