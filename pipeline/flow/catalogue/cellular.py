"""Three crossed waves that stir each other."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.keyframes import Number, Place, number_at, place_at
from pipeline.flow.parameters import Positive, PositiveConstant, Sense
from pipeline.flow.vectors import ORIGIN
from pipeline.flow.velocity import Term


@dataclass(frozen=True)
class ABC(Term):
    """Stirs in cells that repeat, by three crossed waves; keeps volume.

        u = a sin kz + c cos ky    v = b sin kx + a cos kz    w = c sin ky + b cos kx

    with k = 2π / scale. Its vorticity is k times the velocity, and its streamlines wander without a pattern.

    Source: Arnold (1965), Beltrami, Childress (1970); Dombre et al., *Chaotic streamlines in the ABC flows*,
    J. Fluid Mech. 167 (1986).
    """

    centre: Annotated[Place, Sense("where kx, ky and kz are nought", "units")] = ORIGIN
    scale: Annotated[Positive, Sense("after which it repeats", "units")] = 3.0
    a: Annotated[Number, Sense("wave along z", "units/s")] = 1.0
    b: Annotated[Number, Sense("wave along x", "units/s")] = (2.0 / 3.0) ** 0.5
    c: Annotated[Number, Sense("wave along y", "units/s")] = (1.0 / 3.0) ** 0.5

    @property
    def kind(self) -> int:
        return op.ABC

    def row(self, time: float) -> tuple[float, ...]:
        return (*place_at(self.centre, time), self._wave(time), *self._speeds(time))

    def gradient_bound(self, time: float) -> float:
        return self._wave(time) * math.hypot(*self._speeds(time))

    def _wave(self, time: float) -> float:
        return 2 * math.pi / number_at(self.scale, time)

    def _speeds(self, time: float) -> tuple[float, float, float]:
        return number_at(self.a, time), number_at(self.b, time), number_at(self.c, time)


@dataclass(frozen=True)
class TaylorGreen(Term):
    """Turns in cubic cells, each against its neighbours on all sides; keeps volume and height.

        u = speed · sin kx cos ky cos kz    v = −speed · cos kx sin ky cos kz    w = 0

    with k = π / scale. Nothing crosses the planes between cells.

    Source: Taylor & Green, *Mechanism of the Production of Small Eddies from Large Ones*, Proc. R. Soc. A 158
    (1937).
    """

    centre: Annotated[Place, Sense("a corner where cells meet", "units")] = ORIGIN
    scale: Annotated[Positive, Sense("side of a cell", "units")] = 1.0
    speed: Annotated[Number, Sense("the greatest there is", "units/s")] = 1.0

    @property
    def kind(self) -> int:
        return op.TAYLOR_GREEN

    def row(self, time: float) -> tuple[float, ...]:
        return (*place_at(self.centre, time), self._wave(time), number_at(self.speed, time))

    def gradient_bound(self, time: float) -> float:
        return math.sqrt(2.0) * self._wave(time) * abs(number_at(self.speed, time))

    def _wave(self, time: float) -> float:
        return math.pi / number_at(self.scale, time)


@dataclass(frozen=True)
class DoubleGyre(Term):
    """Two gyres side by side in x and y, whose border swings to and fro; keeps volume.

    From the stream function ψ = speed · scale · sin(π f) sin(π y), with 0 < x < 2 and 0 < y < 1 in heights of
    a gyre,

        f = ε sin(2π t/T) x² + (1 − 2 ε sin(2π t/T)) x    u = −∂ψ/∂y    v = ∂ψ/∂x

    Points that the border passes change sides: it mixes. Nothing crosses the frame of the two; beyond it, to
    the left and right, their mirror images follow (the formula's own cells grow ever narrower and steeper).

    Source: Shadden, Lekien & Marsden, *Definition and properties of Lagrangian coherent structures*,
    Physica D 212 (2005), §5.
    """

    centre: Annotated[Place, Sense("the middle of both", "units")] = ORIGIN
    scale: Annotated[Positive, Sense("height of a gyre, and about its width", "units")] = 1.0
    speed: Annotated[Number, Sense("π times it is the greatest there is", "units/s")] = 0.3
    swing: Annotated[Number, Sense("ε, how far the border swings")] = 0.25
    period: Annotated[PositiveConstant, Sense("of the swinging", "s")] = 3.0

    @property
    def kind(self) -> int:
        return op.DOUBLE_GYRE

    def row(self, time: float) -> tuple[float, ...]:
        scale, speed = number_at(self.scale, time), math.pi * number_at(self.speed, time)
        return (*place_at(self.centre, time), 1.0 / scale, speed, self._swing(time))

    def gradient_bound(self, time: float) -> float:
        """Everywhere: with F = 1 + 2 ε the steepest of f, π² F² of the waves, and 2 π ε where f bends."""
        rate = math.pi * abs(number_at(self.speed, time)) / number_at(self.scale, time)
        swing = abs(self._swing(time))
        return rate * (math.pi * (1.0 + 2.0 * swing) ** 2 + 2.0 * swing)

    def _swing(self, time: float) -> float:
        return number_at(self.swing, time) * math.sin(2 * math.pi * time / self.period)


@dataclass(frozen=True)
class Enright(Term):
    """Draws a ball out to a thin curled sheet and puts it together again, within a cube; keeps volume.

    With 0 < x, y, z < 1 in the cube of side `scale` about `centre`,

        u =  2 sin²(πx) sin(2πy) sin(2πz) cos(πt/T)
        v = −  sin(2πx) sin²(πy) sin(2πz) cos(πt/T)
        w = −  sin(2πx) sin(2πy) sin²(πz) cos(πt/T)

    in sides of the cube per second. Nothing crosses the faces of the cube; beyond them the pattern repeats.
    Half way through the period T the deformation is greatest, at its end all is where it was.

    Source: LeVeque, *High-Resolution Conservative Algorithms for Advection in Incompressible Flow*, SIAM
    Journal on Numerical Analysis 33 (1996); with a ball of radius 0.15 about (0.35, 0.35, 0.35) and T = 3,
    the test of Enright et al., *A Hybrid Particle Level Set Method*, J. Comput. Phys. 183 (2002). P3.
    """

    centre: Annotated[Place, Sense("of the cube", "units")] = ORIGIN
    scale: Annotated[Positive, Sense("side of the cube", "units")] = 2.0
    period: Annotated[PositiveConstant, Sense("there and back", "s")] = 3.0

    @property
    def kind(self) -> int:
        return op.ENRIGHT

    def row(self, time: float) -> tuple[float, ...]:
        return (*place_at(self.centre, time), number_at(self.scale, time), self._factor(time))

    def gradient_bound(self, time: float) -> float:
        """4π, which is reached on an axis of the cube, half way from its centre to a face."""
        return 4 * math.pi * abs(self._factor(time))

    def _factor(self, time: float) -> float:
        return math.cos(math.pi * time / self.period)


@dataclass(frozen=True)
class Kneading(Term):
    """Stretches and folds like a baker, stroke after stroke: along x, along y, along z; keeps volume.

    A period T has three strokes. In each only one of

        u = a(t) sin ky    v = a(t) sin kz    w = a(t) sin kx        k = 2π / scale

    acts: it bends what lies straight into a wave, and the next stroke folds the wave over itself. Over a
    stroke that begins at 0, a(t) = amount · 8/T · sin⁴(3π t/T), so that it begins and ends gently, and the
    crests of the wave move by `amount` in all. Lengths grow exponentially with the number of strokes.

    Source: the sine flow, in three dimensions: Liu, Muzzio & Peskin, *Quantification of mixing in aperiodic
    chaotic flows*, Chaos, Solitons & Fractals 4 (1994); the gentle strokes are ours.
    """

    centre: Annotated[Place, Sense("a crossing of the waves, which stays", "units")] = ORIGIN
    scale: Annotated[Positive, Sense("length of a wave", "units")] = 4.0
    amount: Annotated[Number, Sense("how far a stroke moves the crests", "units")] = 1.0
    period: Annotated[PositiveConstant, Sense("of three strokes", "s")] = 3.0

    @property
    def kind(self) -> int:
        return op.KNEADING

    def row(self, time: float) -> tuple[float, ...]:
        stroke, speed = self._stroke(time)
        speeds = [speed if stroke == axis else 0.0 for axis in range(3)]
        return (*place_at(self.centre, time), self._wave(time), *speeds)

    def gradient_bound(self, time: float) -> float:
        """At the height of a stroke, so that no stroke passes unseen between two looks."""
        return self._wave(time) * abs(number_at(self.amount, time)) * 8.0 / self.period

    def _wave(self, time: float) -> float:
        return 2 * math.pi / number_at(self.scale, time)

    def _stroke(self, time: float) -> tuple[int, float]:
        """Which of the three it is, and its speed."""
        strokes = 3.0 * time / self.period
        speed = number_at(self.amount, time) * 8.0 / self.period * math.sin(math.pi * strokes) ** 4
        return math.floor(strokes) % 3, speed
