"""What all attractors share: how their equations stand in a scene."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Annotated, ClassVar

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.keyframes import Number, Place, Vector, number_at, place_at
from pipeline.flow.parameters import Positive, Sense
from pipeline.flow.vectors import ORIGIN
from pipeline.flow.velocity import Term


@dataclass(frozen=True)
class Attractor(Term):
    """Every point follows a system of three equations. It stands upright: its z is our y, its y our −z.

    Far from the attractor many systems fly apart: keep the subject about as large as the attractor is. The
    gradient grows with the distance; its bound holds up to `reach` of its own units from the centre along
    each axis, which is a little further than the attractor goes.
    """

    reach: ClassVar[float] = math.inf

    centre: Annotated[Place, Sense("of the attractor", "units")] = ORIGIN
    scale: Annotated[Positive, Sense("of its units in one of the scene's")] = 1.0
    time_scale: Annotated[Number, Sense("of its time units in a second")] = 0.1

    @abstractmethod
    def _numbers(self, time: float) -> tuple[float, ...]:
        """Its own parameters, in the kernel's order."""

    @abstractmethod
    def _gradient(self, time: float) -> float:
        """A bound of its Jacobian's norm within `reach` of the middle, in its own units; far away is more."""

    def _middle(self, time: float) -> Vector:
        """What lies at `centre`, in its own coordinates."""
        return ORIGIN

    def row(self, time: float) -> tuple[float, ...]:
        (cx, cy, cz), (x, y, z) = place_at(self.centre, time), self._middle(time)
        scale = number_at(self.scale, time)
        origin = cx - x / scale, cy - z / scale, cz + y / scale
        return (*origin, scale, number_at(self.time_scale, time) / scale, *self._numbers(time))

    def gradient_bound(self, time: float) -> float:
        return abs(number_at(self.time_scale, time)) * self._gradient(time)


@dataclass(frozen=True)
class Lorenz(Attractor):
    """The butterfly of 1963: two eyes that points change between at no one's guess.

        x' = σ (y − x)    y' = x (ρ − z) − y    z' = x y − β z

    (0, 0, ρ − 1), the height of its two eyes, is at `centre`. It is about 40 of its units wide and 50 high,
    so a scale of 20 makes it fit a subject of half-size 1. One turn about an eye takes about 0.7 of its time.
    The divergence is −(σ + 1 + β) × time_scale: everything is drawn to a thin sheet within a fraction of its
    time unit, so a sculpture wants a small time scale.

    Source: Lorenz, *Deterministic Nonperiodic Flow*, J. Atmos. Sci. 20 (1963). P3, P33.
    """

    reach: ClassVar[float] = 27.0

    sigma: Annotated[Number, Sense("σ")] = 10.0
    rho: Annotated[Number, Sense("ρ")] = 28.0
    beta: Annotated[Number, Sense("β")] = 8.0 / 3.0
    scale: Annotated[Positive, Sense("of its units in one of the scene's")] = 20.0
    time_scale: Annotated[Number, Sense("of its time units in a second")] = 0.1

    @property
    def kind(self) -> int:
        return op.LORENZ

    def _numbers(self, time: float) -> tuple[float, ...]:
        return (number_at(self.sigma, time), number_at(self.rho, time), number_at(self.beta, time))

    def _middle(self, time: float) -> Vector:
        return 0.0, 0.0, number_at(self.rho, time) - 1.0

    def _gradient(self, time: float) -> float:
        """The root of the sum of squares, with ρ − z = 1 in the middle; and never less than for |x| < 20."""
        sigma, rho, beta = (number_at(number, time) for number in (self.sigma, self.rho, self.beta))
        bound = math.hypot(math.sqrt(2.0) * sigma, 1.0 + self.reach, 1.0, math.sqrt(3.0) * self.reach, beta)
        return max(bound, abs(sigma) + abs(rho) + 20.0)


@dataclass(frozen=True)
class Rossler(Attractor):
    """A disc that spirals outwards and folds over itself: the simplest of the strange attractors.

        x' = −y − z    y' = x + a y    z' = b + z (x − c)

    Its disc is about 20 of its units wide and lies level at `centre`; a turn takes about 6 of its time.

    Source: Rössler, *An Equation for Continuous Chaos*, Physics Letters A 57 (1976).
    """

    reach: ClassVar[float] = 23.0

    a: Annotated[Number, Sense("a")] = 0.2
    b: Annotated[Number, Sense("b")] = 0.2
    c: Annotated[Number, Sense("c: how far it spirals before it folds")] = 5.7
    scale: Annotated[Positive, Sense("of its units in one of the scene's")] = 10.0
    time_scale: Annotated[Number, Sense("of its time units in a second")] = 1.0

    @property
    def kind(self) -> int:
        return op.ROSSLER

    def _numbers(self, time: float) -> tuple[float, ...]:
        return (number_at(self.a, time), number_at(self.b, time), number_at(self.c, time))

    def _gradient(self, time: float) -> float:
        a, c = number_at(self.a, time), number_at(self.c, time)
        return math.hypot(math.sqrt(3.0), a, self.reach, self.reach + abs(c))


@dataclass(frozen=True)
class Aizawa(Attractor):
    """A ball that turns, with a channel down its axis through which everything comes back.

        x' = (z − b) x − d y    y' = d x + (z − b) y
        z' = c + a z − z³/3 − (x² + y²)(1 + e z) + f z x³

    It is about 3 of its units wide and 2.2 high, its middle (0, 0, 0.7) at `centre`.

    Source: Langford, *Numerical Studies of Torus Bifurcations*, in Küpper et al., *Numerical Methods for
    Bifurcation Problems* (1984), whose system it is; named after Aizawa since.
    """

    reach: ClassVar[float] = 1.7

    a: Annotated[Number, Sense("a")] = 0.95
    b: Annotated[Number, Sense("b")] = 0.7
    c: Annotated[Number, Sense("c")] = 0.6
    d: Annotated[Number, Sense("d: turns it")] = 3.5
    e: Annotated[Number, Sense("e")] = 0.25
    f: Annotated[Number, Sense("f")] = 0.1
    scale: Annotated[Positive, Sense("of its units in one of the scene's")] = 1.5
    time_scale: Annotated[Number, Sense("of its time units in a second")] = 0.4

    @property
    def kind(self) -> int:
        return op.AIZAWA

    def _numbers(self, time: float) -> tuple[float, ...]:
        return tuple(number_at(number, time) for number in (self.a, self.b, self.c, self.d, self.e, self.f))

    def _middle(self, time: float) -> Vector:
        return 0.0, 0.0, 0.7

    def _gradient(self, time: float) -> float:
        """The turning, and the root of the sum of squares of the rest, row by row."""
        a, d, e, f = (abs(number_at(number, time)) for number in (self.a, self.d, self.e, self.f))
        x, z = self.reach, self.reach + 0.7
        rising = self.reach + abs(0.7 - number_at(self.b, time))
        radius = math.sqrt(2.0) * x
        across = 2.0 * radius * (1.0 + e * z) + 3.0 * f * z * x * x
        along = max(a, z * z) + e * radius * radius + f * x**3
        return math.hypot(rising, d) + math.hypot(radius, across, along)


@dataclass(frozen=True)
class Thomas(Attractor):
    """A lattice of coils that points wander through, the same along all three axes.

        x' = sin y − b x    y' = sin z − b y    z' = sin x − b z

    It is about 8 of its units wide. The divergence is −3 b × time_scale: near b = 0 it keeps volume and
    fills space.

    Source: Thomas, *Deterministic chaos seen in terms of feedback circuits*, Int. J. Bifurcation and Chaos 9
    (1999).
    """

    b: Annotated[Number, Sense("b: how strongly it is held together")] = 0.208186
    scale: Annotated[Positive, Sense("of its units in one of the scene's")] = 4.0
    time_scale: Annotated[Number, Sense("of its time units in a second")] = 1.5

    @property
    def kind(self) -> int:
        return op.THOMAS

    def _numbers(self, time: float) -> tuple[float, ...]:
        return (number_at(self.b, time),)

    def _gradient(self, time: float) -> float:
        return 1.0 + abs(number_at(self.b, time))


@dataclass(frozen=True)
class Chua(Attractor):
    """The double scroll of an electric circuit, with a smooth cubic for its resistor.

        x' = α (y − x³ − c x)    y' = x − y + z    z' = −β y

    It is about 1 of its units wide, 1.5 high, and flat: 0.16 deep.

    Source: Zhong, *Implementation of Chua's circuit with a cubic nonlinearity*, IEEE Trans. Circuits and
    Systems I 41 (1994).
    """

    reach: ClassVar[float] = 1.0

    alpha: Annotated[Number, Sense("α")] = 10.0
    beta: Annotated[Number, Sense("β")] = 16.0
    c: Annotated[Number, Sense("c of the cubic")] = -0.143
    scale: Annotated[Positive, Sense("of its units in one of the scene's")] = 0.7
    time_scale: Annotated[Number, Sense("of its time units in a second")] = 0.5

    @property
    def kind(self) -> int:
        return op.CHUA

    def _numbers(self, time: float) -> tuple[float, ...]:
        return (number_at(self.alpha, time), number_at(self.beta, time), number_at(self.c, time))

    def _gradient(self, time: float) -> float:
        """It changes with x alone; along y and z the reach has no end."""
        alpha = number_at(self.alpha, time)
        bend = alpha * (3.0 * self.reach**2 + abs(number_at(self.c, time)))
        return math.hypot(bend, alpha, number_at(self.beta, time), 2.0)


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


@dataclass(frozen=True)
class Chen(Attractor):
    """Lorenz's dual: two eyes again, more tightly wound.

        x' = a (y − x)    y' = (c − a) x − x z + c y    z' = x y − b z

    (0, 0, 2 c − a), the height of its eyes, is at `centre`; it is about 50 of its units wide and 40 high. The
    divergence is (c − a − b) × time_scale.

    Source: Chen & Ueta, *Yet Another Chaotic Attractor*, Int. J. Bifurcation and Chaos 9 (1999).
    """

    reach: ClassVar[float] = 27.0

    a: Annotated[Number, Sense("a")] = 35.0
    b: Annotated[Number, Sense("b")] = 3.0
    c: Annotated[Number, Sense("c")] = 28.0
    scale: Annotated[Positive, Sense("of its units in one of the scene's")] = 25.0
    time_scale: Annotated[Number, Sense("of its time units in a second")] = 0.04

    @property
    def kind(self) -> int:
        return op.CHEN

    def _numbers(self, time: float) -> tuple[float, ...]:
        return (number_at(self.a, time), number_at(self.b, time), number_at(self.c, time))

    def _middle(self, time: float) -> Vector:
        return 0.0, 0.0, 2.0 * number_at(self.c, time) - number_at(self.a, time)

    def _gradient(self, time: float) -> float:
        """The root of the sum of squares, where c − a − z is −c in the middle."""
        a, b, c = (number_at(number, time) for number in (self.a, self.b, self.c))
        reach = self.reach
        return math.hypot(math.sqrt(2.0) * a, abs(c) + reach, c, math.sqrt(3.0) * reach, b)
