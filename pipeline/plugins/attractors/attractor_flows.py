"""Strange attractors besides Lorenz's: every point follows a system of three differential equations."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Annotated, Any, ClassVar

from flowsculpt.api.flows import (
    ExternalField,
    Number,
    ParameterDoc,
    PositiveNumber,
    VectorParameter,
    number_at,
    vector_at,
)
from flowsculpt.pipeline.plugins.attractors import attractor_kernels as kernels

Vector = tuple[float, float, float]

ORIGIN: Vector = (0.0, 0.0, 0.0)

_SCALE = ParameterDoc("of its units in one of the scene's")
_TIME_SCALE = ParameterDoc("of its time units in a second")


@dataclass(frozen=True)
class Attractor(ExternalField):
    """The base of all attractors. An attractor stands upright: its z is our y, its y our −z.

    The fields that a subclass adds are the parameters of its equations, in the kernel's order.

    Far from the attractor many systems diverge: keep the subject about as large as the attractor is. The
    gradient grows with the distance; its bound holds up to `reach` of the attractor's units from the centre
    along each axis, a little further than the attractor extends.
    """

    gains_from_order: ClassVar[bool] = False
    reach: ClassVar[float] = math.inf

    centre: Annotated[VectorParameter, ParameterDoc("of the attractor", "units")] = ORIGIN
    scale: Annotated[PositiveNumber, _SCALE] = 1.0
    time_scale: Annotated[Number, _TIME_SCALE] = 0.1

    @abstractmethod
    def _gradient(self, parameters: tuple[float, ...]) -> float:
        """Bound the norm of the Jacobian within `reach` of the middle, in the attractor's units."""

    def _middle(self, parameters: tuple[float, ...]) -> Vector:
        """Return the point, in the attractor's coordinates, that lies at `centre`."""
        return ORIGIN

    def _parameters(self, time: float) -> tuple[float, ...]:
        """Return the parameters of the equations, in the kernel's order."""
        return tuple(number_at(getattr(self, name), time) for name in self._own)

    @cached_property
    def _own(self) -> list[str]:
        """The names of the parameters that a subclass adds."""
        return [field.name for field in fields(self) if field.name not in Attractor.__dataclass_fields__]

    def numbers(self, time: float) -> tuple[float, ...]:
        parameters = self._parameters(time)
        (cx, cy, cz), (x, y, z) = vector_at(self.centre, time), self._middle(parameters)
        scale = number_at(self.scale, time)
        origin = cx - x / scale, cy - z / scale, cz + y / scale
        return (*origin, scale, number_at(self.time_scale, time) / scale, *parameters)

    def cache_data(self, time: float) -> Any:
        """Return what decides its velocities: none depends on the time itself."""
        return list(self.numbers(time))

    def gradient_bound(self, time: float) -> float:
        return abs(number_at(self.time_scale, time)) * self._gradient(self._parameters(time))

    def length_scale(self, time: float) -> float:
        """Return half the `reach`: over it the gradient, linear in the position or about so, changes."""
        return 0.5 * self.reach / number_at(self.scale, time)


@dataclass(frozen=True)
class Rossler(Attractor):
    """A disc that spirals outwards and folds over itself: the simplest of the strange attractors.

        x' = −y − z    y' = x + a y    z' = b + z (x − c)

    Its disc is about 20 of its units wide and lies level at `centre`; a turn takes about 6 of its time.

    Source: Rössler, *An Equation for Continuous Chaos*, Physics Letters A 57 (1976).
    """

    block = kernels.rossler
    reach: ClassVar[float] = 23.0

    a: Annotated[Number, ParameterDoc("a")] = 0.2
    b: Annotated[Number, ParameterDoc("b")] = 0.2
    c: Annotated[Number, ParameterDoc("c: how far it spirals before it folds")] = 5.7
    scale: Annotated[PositiveNumber, _SCALE] = 10.0
    time_scale: Annotated[Number, _TIME_SCALE] = 1.0

    def _gradient(self, parameters: tuple[float, ...]) -> float:
        a, _, c = parameters
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

    block = kernels.aizawa
    reach: ClassVar[float] = 1.7

    a: Annotated[Number, ParameterDoc("a")] = 0.95
    b: Annotated[Number, ParameterDoc("b")] = 0.7
    c: Annotated[Number, ParameterDoc("c")] = 0.6
    d: Annotated[Number, ParameterDoc("d: turns it")] = 3.5
    e: Annotated[Number, ParameterDoc("e")] = 0.25
    f: Annotated[Number, ParameterDoc("f")] = 0.1
    scale: Annotated[PositiveNumber, _SCALE] = 1.5
    time_scale: Annotated[Number, _TIME_SCALE] = 0.4

    def _middle(self, parameters: tuple[float, ...]) -> Vector:
        return 0.0, 0.0, 0.7

    def _gradient(self, parameters: tuple[float, ...]) -> float:
        """Bound the gradient by that of the turning, plus the Frobenius norm of the rest, row by row."""
        b, (a, _, _, d, e, f) = parameters[1], map(abs, parameters)
        x, z = self.reach, self.reach + 0.7
        rising = self.reach + abs(0.7 - b)
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

    block = kernels.thomas

    b: Annotated[Number, ParameterDoc("b: damping")] = 0.208186
    scale: Annotated[PositiveNumber, _SCALE] = 4.0
    time_scale: Annotated[Number, _TIME_SCALE] = 1.5

    def _gradient(self, parameters: tuple[float, ...]) -> float:
        (b,) = parameters
        return 1.0 + abs(b)

    def length_scale(self, time: float) -> float:
        return 1.0 / number_at(self.scale, time)


@dataclass(frozen=True)
class Chua(Attractor):
    """The double scroll of an electric circuit, with a smooth cubic for its resistor.

        x' = α (y − x³ − c x)    y' = x − y + z    z' = −β y

    It is about 1 of its units wide, 1.5 high, and flat: 0.16 deep.

    Source: Zhong, *Implementation of Chua's circuit with a cubic nonlinearity*, IEEE Trans. Circuits and
    Systems I 41 (1994).
    """

    block = kernels.chua
    reach: ClassVar[float] = 1.0

    alpha: Annotated[Number, ParameterDoc("α")] = 10.0
    beta: Annotated[Number, ParameterDoc("β")] = 16.0
    c: Annotated[Number, ParameterDoc("c of the cubic")] = -0.143
    scale: Annotated[PositiveNumber, _SCALE] = 0.7
    time_scale: Annotated[Number, _TIME_SCALE] = 0.5

    def _gradient(self, parameters: tuple[float, ...]) -> float:
        """Bound the gradient, which varies with x alone; along y and z there is no limit."""
        alpha, beta, c = parameters
        bend = alpha * (3.0 * self.reach**2 + abs(c))
        return math.hypot(bend, alpha, beta, 2.0)


@dataclass(frozen=True)
class Halvorsen(Attractor):
    """Three wings that feed each other around a diagonal.

        x' = −a x − 4 y − 4 z − y²    y' = −a y − 4 z − 4 x − z²    z' = −a z − 4 x − 4 y − x²

    It is about 20 of its units wide, with (−3.5, −3.5, −3.5) at `centre`. The divergence is
    −3 a × time_scale.

    Source: Sprott, *Chaos and Time-Series Analysis* (2003), appendix A.5, who names it after Halvorsen.
    """

    block = kernels.halvorsen
    reach: ClassVar[float] = 11.0

    a: Annotated[Number, ParameterDoc("a: damping")] = 1.4
    scale: Annotated[PositiveNumber, _SCALE] = 10.0
    time_scale: Annotated[Number, _TIME_SCALE] = 0.1

    def _middle(self, parameters: tuple[float, ...]) -> Vector:
        return -3.5, -3.5, -3.5

    def _gradient(self, parameters: tuple[float, ...]) -> float:
        """Bound the gradient by its diagonal, its constant part and the part that grows with a coordinate."""
        (a,) = parameters
        return abs(a) + 4.0 + (3.0 + 2.0 * self.reach)


@dataclass(frozen=True)
class Chen(Attractor):
    """Lorenz's dual: two eyes again, more tightly wound.

        x' = a (y − x)    y' = (c − a) x − x z + c y    z' = x y − b z

    (0, 0, 2 c − a), the height of its eyes, is at `centre`; it is about 50 of its units wide and 40 high. The
    divergence is (c − a − b) × time_scale.

    Source: Chen & Ueta, *Yet Another Chaotic Attractor*, Int. J. Bifurcation and Chaos 9 (1999).
    """

    block = kernels.chen
    reach: ClassVar[float] = 27.0

    a: Annotated[Number, ParameterDoc("a")] = 35.0
    b: Annotated[Number, ParameterDoc("b")] = 3.0
    c: Annotated[Number, ParameterDoc("c")] = 28.0
    scale: Annotated[PositiveNumber, _SCALE] = 25.0
    time_scale: Annotated[Number, _TIME_SCALE] = 0.04

    def _middle(self, parameters: tuple[float, ...]) -> Vector:
        a, _, c = parameters
        return 0.0, 0.0, 2.0 * c - a

    def _gradient(self, parameters: tuple[float, ...]) -> float:
        """Bound the gradient by its Frobenius norm, where c − a − z is −c in the middle."""
        a, b, c = parameters
        reach = self.reach
        return math.hypot(math.sqrt(2.0) * a, abs(c) + reach, c, math.sqrt(3.0) * reach, b)
