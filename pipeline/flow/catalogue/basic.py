"""Basic velocities: uniform or proportional to the distance, sources, sinks, expansion, squeezing; and cells.

Flows in cells repeat: ABC, the double gyre and Enright's test.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from flowsculpt.pipeline.flow.kernels import field_kernels as kernels
from flowsculpt.pipeline.flow.parameters import (
    ORIGIN,
    Direction,
    Number,
    ParameterDoc,
    PositiveConstant,
    PositiveNumber,
    VectorParameter,
    Y,
    Z,
    number_at,
    unit,
    vector_at,
)
from flowsculpt.pipeline.flow.velocity import BasicField


class _LinearField(BasicField):
    """The base of velocities that are linear in the position."""

    def length_scale(self, time: float) -> float:
        return math.inf


@dataclass(frozen=True)
class Translation(_LinearField):
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
class Rotation(_LinearField):
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
class Scaling(_LinearField):
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
class Strain(_LinearField):
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


@dataclass(frozen=True)
class Source(BasicField):
    """Pushes everything away from a point, the less the farther.

    Velocity = Q / (4 π) · r / (r² + R²)^(3/2) for a flux Q: far away that of a point source. Volume is
    created within about the core's radius R; the divergence is 3 Q R² / (4 π (r² + R²)^(5/2)), in all Q.

    Source: Lamb, *Hydrodynamics* (6th ed., 1932), §56; the core is Plummer's (1911).
    """

    opcode: ClassVar[int] = kernels.SOURCE
    sign: ClassVar[float] = 1.0

    centre: Annotated[VectorParameter, ParameterDoc("the point", "units")] = ORIGIN
    radius: Annotated[PositiveNumber, ParameterDoc("of the core", "units")] = 0.3
    flux: Annotated[Number, ParameterDoc("volume that comes out", "units³/s")] = 1.0

    def row(self, time: float) -> tuple[float, ...]:
        radius, flux = number_at(self.radius, time), self.sign * number_at(self.flux, time)
        return (*vector_at(self.centre, time), radius * radius, flux / (4 * math.pi))

    def gradient_bound(self, time: float) -> float:
        """Return the gradient at the centre, where it is largest."""
        return abs(number_at(self.flux, time)) / (4 * math.pi * number_at(self.radius, time) ** 3)

    def length_scale(self, time: float) -> float:
        return number_at(self.radius, time)


@dataclass(frozen=True)
class Sink(Source):
    """Draws everything towards a point, the more the nearer: a source run backwards."""

    sign: ClassVar[float] = -1.0

    flux: Annotated[Number, ParameterDoc("volume that goes in", "units³/s")] = 1.0


@dataclass(frozen=True)
class Expansion(BasicField):
    """A ball or disc that swells, or shrinks; nothing moves outside of it.

    Within the radius R, velocity = rate · (1 − r²/R²)² · r; outside, and on the rim, nothing moves. A disc
    moves points away from its axis, at any height; a ball away from its centre. Overlapping discs of both
    signs, added up, are figure B. Near the centre distances grow as exp(rate × seconds).

    Source: the discs of expansion and contraction of Reynolds 1991, figure B (P15); the falloff is ours.
    """

    shape: Annotated[Literal["disc", "ball"], ParameterDoc("away from an axis, or from a centre")] = "ball"
    axis: Annotated[Direction, ParameterDoc("of a disc")] = Z
    centre: Annotated[VectorParameter, ParameterDoc("the fixed point", "units")] = ORIGIN
    radius: Annotated[PositiveNumber, ParameterDoc("of the region", "units")] = 1.0
    rate: Annotated[Number, ParameterDoc("at the centre; negative shrinks", "1/s", required=True)] = 1.0

    @property
    def opcode(self) -> int:
        return kernels.DISC if self.shape == "disc" else kernels.BALL

    def row(self, time: float) -> tuple[float, ...]:
        narrowness = number_at(self.radius, time) ** -2.0
        return (*vector_at(self.centre, time), *unit(self.axis), narrowness, number_at(self.rate, time))

    def gradient_bound(self, time: float) -> float:
        return abs(number_at(self.rate, time))

    def length_scale(self, time: float) -> float:
        return number_at(self.radius, time)


@dataclass(frozen=True)
class Squeeze(BasicField):
    """Narrows a waist and drives its material out to both sides, like a gripping hand; keeps volume.

    With ϖ the distance from the axis and h the height along it, L the length and R the radius of the grip,

        across  − rate/2 · ϖ · (1 − 2 h²/L²) · exp(−h²/L² − ϖ²/R²)
        along     rate · h · (1 − ϖ²/R²) · exp(−h²/L² − ϖ²/R²)

    from the stream function rate/2 · ϖ² h exp(−h²/L² − ϖ²/R²): a strain at the centre that fades away. Beyond
    R it flows back. A negative rate makes a bulge.

    Source: Stokes' stream function, Lamb, *Hydrodynamics* (6th ed., 1932), §94; the fading is ours.
    """

    opcode: ClassVar[int] = kernels.SQUEEZE

    axis: Annotated[Direction, ParameterDoc("along which it gives way")] = Y
    centre: Annotated[VectorParameter, ParameterDoc("of the grip", "units")] = ORIGIN
    radius: Annotated[PositiveNumber, ParameterDoc("of the grip, across the axis", "units")] = 2.0
    length: Annotated[PositiveNumber, ParameterDoc("of the grip, along the axis", "units")] = 0.7
    rate: Annotated[
        Number, ParameterDoc("of lengthening at the centre; negative bulges", "1/s", required=True)
    ] = 1.0

    def row(self, time: float) -> tuple[float, ...]:
        wide, long = number_at(self.radius, time) ** -2.0, number_at(self.length, time) ** -2.0
        return (*vector_at(self.centre, time), *unit(self.axis), long, wide, number_at(self.rate, time))

    def gradient_bound(self, time: float) -> float:
        """Bound the gradient: the rate at the centre, and shear that grows as the grip departs from round."""
        slender = number_at(self.radius, time) / number_at(self.length, time)
        return abs(number_at(self.rate, time)) * (1.0 + 0.75 * slender + 0.75 / slender)

    def length_scale(self, time: float) -> float:
        return min(number_at(self.radius, time), number_at(self.length, time))


LINEAR: tuple[type, ...] = (Translation, Rotation, Scaling, Strain)
SOURCES: tuple[type, ...] = (Source, Sink, Expansion, Squeeze)


@dataclass(frozen=True)
class ABC(BasicField):
    """Stirs in cells that repeat, by three crossed waves; keeps volume.

        u = a sin kz + c cos ky    v = b sin kx + a cos kz    w = c sin ky + b cos kx

    with k = 2π / scale. Its vorticity is k times the velocity, and its streamlines wander without a pattern.

    Source: Arnold (1965), Beltrami, Childress (1970); Dombre et al., *Chaotic streamlines in the ABC flows*,
    J. Fluid Mech. 167 (1986).
    """

    opcode: ClassVar[int] = kernels.ABC

    centre: Annotated[VectorParameter, ParameterDoc("where kx, ky and kz are 0", "units")] = ORIGIN
    scale: Annotated[PositiveNumber, ParameterDoc("the period along each axis", "units")] = 3.0
    a: Annotated[Number, ParameterDoc("wave along z", "units/s")] = 1.0
    b: Annotated[Number, ParameterDoc("wave along x", "units/s")] = (2.0 / 3.0) ** 0.5
    c: Annotated[Number, ParameterDoc("wave along y", "units/s")] = (1.0 / 3.0) ** 0.5

    def row(self, time: float) -> tuple[float, ...]:
        return (*vector_at(self.centre, time), self._wave(time), *self._speeds(time))

    def gradient_bound(self, time: float) -> float:
        return self._wave(time) * math.hypot(*self._speeds(time))

    def _speeds(self, time: float) -> tuple[float, float, float]:
        return number_at(self.a, time), number_at(self.b, time), number_at(self.c, time)

    def length_scale(self, time: float) -> float:
        return 1.0 / self._wave(time)

    def _wave(self, time: float) -> float:
        return 2 * math.pi / number_at(self.scale, time)


@dataclass(frozen=True)
class DoubleGyre(BasicField):
    """Two gyres side by side in x and y, whose border swings to and fro; keeps volume.

    From the stream function ψ = speed · scale · sin(π f) sin(π y), with 0 < x < 2 and 0 < y < 1 in heights of
    a gyre,

        f = ε sin(2π t/T) x² + (1 − 2 ε sin(2π t/T)) x    u = −∂ψ/∂y    v = ∂ψ/∂x

    Points that the border passes change sides: it mixes. Nothing crosses the border around both; beyond it,
    to the left and right, mirror images follow (the cells of the formula itself would grow ever narrower).

    Source: Shadden, Lekien & Marsden, *Definition and properties of Lagrangian coherent structures*,
    Physica D 212 (2005), §5.
    """

    opcode: ClassVar[int] = kernels.DOUBLE_GYRE

    centre: Annotated[VectorParameter, ParameterDoc("the middle of both", "units")] = ORIGIN
    scale: Annotated[PositiveNumber, ParameterDoc("height of a gyre, and about its width", "units")] = 1.0
    speed: Annotated[Number, ParameterDoc("1/π of the largest speed", "units/s")] = 0.3
    swing: Annotated[Number, ParameterDoc("ε, how far the border swings")] = 0.25
    period: Annotated[PositiveConstant, ParameterDoc("of the swinging", "s")] = 3.0

    def row(self, time: float) -> tuple[float, ...]:
        scale, speed = number_at(self.scale, time), math.pi * number_at(self.speed, time)
        return (*vector_at(self.centre, time), 1.0 / scale, speed, self._swing(time))

    def gradient_bound(self, time: float) -> float:
        """Bound the gradient: π² F² by the waves, F = 1 + 2 ε the largest slope of f, and 2 π ε by f''."""
        rate = math.pi * abs(number_at(self.speed, time)) / number_at(self.scale, time)
        swing = abs(self._swing(time))
        return rate * (math.pi * (1.0 + 2.0 * swing) ** 2 + 2.0 * swing)

    def length_scale(self, time: float) -> float:
        """Return that of the waves, which are the narrower the larger the slope of f."""
        return number_at(self.scale, time) / (math.pi * (1.0 + 2.0 * abs(self._swing(time))))

    def _swing(self, time: float) -> float:
        return number_at(self.swing, time) * math.sin(2 * math.pi * time / self.period)


@dataclass(frozen=True)
class Enright(BasicField):
    """Draws a ball out to a thin curled sheet and back into a ball, within a cube; keeps volume.

    With 0 < x, y, z < 1 in the cube of side `scale` about `centre`,

        u =  2 sin²(πx) sin(2πy) sin(2πz) cos(πt/T)
        v = −  sin(2πx) sin²(πy) sin(2πz) cos(πt/T)
        w = −  sin(2πx) sin(2πy) sin²(πz) cos(πt/T)

    in sides of the cube per second. Nothing crosses the faces of the cube; beyond them the pattern repeats.
    The deformation is greatest half way through the period T; at its end all points are back.

    Source: LeVeque, *High-Resolution Conservative Algorithms for Advection in Incompressible Flow*, SIAM
    Journal on Numerical Analysis 33 (1996); with a ball of radius 0.15 about (0.35, 0.35, 0.35) and T = 3,
    the test of Enright et al., *A Hybrid Particle Level Set Method*, J. Comput. Phys. 183 (2002). P3.
    """

    opcode: ClassVar[int] = kernels.ENRIGHT

    centre: Annotated[VectorParameter, ParameterDoc("of the cube", "units")] = ORIGIN
    scale: Annotated[PositiveNumber, ParameterDoc("side of the cube", "units")] = 2.0
    period: Annotated[PositiveConstant, ParameterDoc("there and back", "s")] = 3.0

    def row(self, time: float) -> tuple[float, ...]:
        return (*vector_at(self.centre, time), number_at(self.scale, time), self._factor(time))

    def gradient_bound(self, time: float) -> float:
        """Return 4π times the factor, reached on an axis of the cube, half way from its centre to a face."""
        return 4 * math.pi * abs(self._factor(time))

    def length_scale(self, time: float) -> float:
        return number_at(self.scale, time) / (2 * math.pi)

    def _factor(self, time: float) -> float:
        return math.cos(math.pi * time / self.period)


CELLULAR: tuple[type, ...] = (ABC, DoubleGyre, Enright)
