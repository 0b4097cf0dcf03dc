"""Translation, rotation, scaling and strain: velocities that are uniform or proportional to the distance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from pipeline.flow.kernels import linear as kernels
from pipeline.flow.parameters import (
    ORIGIN,
    Direction,
    Number,
    ParameterDoc,
    VectorParameter,
    Y,
    number_at,
    unit,
    vector_at,
)
from pipeline.flow.velocity import BasicField


@dataclass(frozen=True)
class Translation(BasicField):
    """Uniform motion: the same velocity everywhere; keeps volume."""

    opcode: ClassVar[int] = kernels.TRANSLATION

    rate: Annotated[VectorParameter, ParameterDoc("velocity along x, y and z", "units/s", required=True)] = (
        ORIGIN
    )

    def row(self, time: float) -> tuple[float, ...]:
        return vector_at(self.rate, time)

    def gradient_bound(self, time: float) -> float:
        return 0.0


@dataclass(frozen=True)
class Rotation(BasicField):
    """Turns everything about a line: velocity = speed · axis × r; keeps volume."""

    opcode: ClassVar[int] = kernels.ROTATION

    axis: Annotated[Direction, ParameterDoc("of the line")] = Y
    centre: Annotated[VectorParameter, ParameterDoc("a point on the line", "units")] = ORIGIN
    speed: Annotated[
        Number, ParameterDoc("counter-clockwise seen against the axis", "degrees/s", required=True)
    ] = 1.0

    def row(self, time: float) -> tuple[float, ...]:
        return (*vector_at(self.centre, time), *unit(self.axis), number_at(self.speed, time))

    def gradient_bound(self, time: float) -> float:
        return abs(number_at(self.speed, time))


@dataclass(frozen=True)
class Scaling(BasicField):
    """Grows everything from a centre, uniformly or along each axis: velocity = rate · r.

    Lengths along an axis grow as exp(rate × seconds); the divergence is the sum of the three rates.
    """

    opcode: ClassVar[int] = kernels.SCALING

    centre: Annotated[VectorParameter, ParameterDoc("the fixed point", "units")] = ORIGIN
    rate: Annotated[
        VectorParameter, ParameterDoc("along x, y and z; negative shrinks", "1/s", required=True)
    ] = ORIGIN

    def row(self, time: float) -> tuple[float, ...]:
        return (*vector_at(self.centre, time), *vector_at(self.rate, time))

    def gradient_bound(self, time: float) -> float:
        return max(abs(rate) for rate in vector_at(self.rate, time))


@dataclass(frozen=True)
class Strain(BasicField):
    """Lengthens along an axis and narrows across it; keeps volume.

    Velocity = rate · height along the axis and −rate/2 · r across it. Length grows as exp(rate × seconds);
    a negative rate flattens.

    Source: Batchelor, *An Introduction to Fluid Dynamics* (1967), §2.3.
    """

    opcode: ClassVar[int] = kernels.STRAIN

    axis: Annotated[Direction, ParameterDoc("along which it lengthens")] = Y
    centre: Annotated[VectorParameter, ParameterDoc("the fixed point", "units")] = ORIGIN
    rate: Annotated[Number, ParameterDoc("of lengthening; negative flattens", "1/s", required=True)] = 1.0

    def row(self, time: float) -> tuple[float, ...]:
        rate = number_at(self.rate, time)
        return (*vector_at(self.centre, time), *unit(self.axis), rate, -0.5 * rate)

    def gradient_bound(self, time: float) -> float:
        return abs(number_at(self.rate, time))


FLOWS: tuple[type, ...] = (Translation, Rotation, Scaling, Strain)
