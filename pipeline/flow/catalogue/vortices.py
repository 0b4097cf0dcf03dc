"""Vortices, which turn about an axis, fast within a core and slow outside."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from flowsculpt.pipeline.flow.catalogue.basic import Strain
from flowsculpt.pipeline.flow.kernels import field_kernels as kernels
from flowsculpt.pipeline.flow.parameters import (
    ORIGIN,
    Direction,
    Number,
    ParameterDoc,
    PositiveNumber,
    Vector,
    VectorParameter,
    X,
    Y,
    Z,
    across,
    number_at,
    unit,
    vector_at,
)
from flowsculpt.pipeline.flow.velocity import BasicField, Program, VelocityField

Profile = Literal["lamb_oseen", "gaussian", "rankine"]

_OPCODES = {"lamb_oseen": kernels.LAMB_OSEEN, "gaussian": kernels.GAUSSIAN, "rankine": kernels.RANKINE}

_CIRCULATION = ParameterDoc("circulation, counter-clockwise seen against the axis", "units²/s")


@dataclass(frozen=True)
class Vortex(BasicField):
    """Turns about a line, fast in the core and slow outside; keeps volume.

    At the distance r from the axis, with the core's radius R and the circulation Γ, it turns at

        lamb_oseen  Γ / (2 π r²) · (1 − exp(−r²/R²))      in radians per second
        gaussian    Γ / (2 π R²) · exp(−r²/R²)
        rankine     Γ / (2 π R²) within the core, Γ / (2 π r²) outside

    so all turn at Γ / (2 π R²) on the axis. The first and the last reach far (their speed falls as 1/r), the
    second hardly moves what is beyond two radii. The last has a kink at the core's rim.

    Source: Lamb, *Hydrodynamics* (6th ed., 1932), §334a; Oseen (1912); Rankine (1858). P3.
    """

    axis: Annotated[Direction, ParameterDoc("of the line")] = Z
    centre: Annotated[VectorParameter, ParameterDoc("a point on the line", "units")] = ORIGIN
    radius: Annotated[PositiveNumber, ParameterDoc("of the core", "units")] = 1.0
    strength: Annotated[Number, _CIRCULATION] = 1.0
    profile: Annotated[Profile, ParameterDoc("how the turning falls with the distance")] = "lamb_oseen"

    @property
    def opcode(self) -> int:
        return _OPCODES[self.profile]

    def row(self, time: float) -> tuple[float, ...]:
        narrowness = number_at(self.radius, time) ** -2.0
        spin = number_at(self.strength, time) / (2 * math.pi) * narrowness
        return (*vector_at(self.centre, time), *unit(self.axis), narrowness, spin)

    def gradient_bound(self, time: float) -> float:
        """Return 1.3 times the angular speed on the axis, which the gradient nowhere exceeds."""
        return 1.3 * abs(number_at(self.strength, time)) / (2 * math.pi * number_at(self.radius, time) ** 2)

    def length_scale(self, time: float) -> float:
        """Return the core's radius; a tenth of it for the profile with a kink, which few steps cross then."""
        return (0.1 if self.profile == "rankine" else 1.0) * number_at(self.radius, time)


class _Composite(VelocityField):
    """A sum of basic fields with common parameters."""

    @abstractmethod
    def parts(self, time: float) -> tuple[BasicField, ...]:
        """Return the basic fields at a time."""

    def program(self, time: float) -> Program:
        return tuple(row for part in self.parts(time) for row in part.program(time))

    def gradient_bound(self, time: float) -> float:
        return sum(part.gradient_bound(time) for part in self.parts(time))

    def length_scale(self, time: float) -> float:
        return min(part.length_scale(time) for part in self.parts(time))


@dataclass(frozen=True)
class VortexPair(_Composite):
    """Two Lamb–Oseen vortices with parallel axes, against each other or together; keeps volume.

    Against each other they drive a jet between them; together they stir the space around both. They stay
    in place: a free pair with circulations ±Γ at the distance d would move at Γ / (2 π d).

    Source: Lamb, *Hydrodynamics* (6th ed., 1932), §155.
    """

    axis: Annotated[Direction, ParameterDoc("of both lines")] = Z
    centre: Annotated[VectorParameter, ParameterDoc("half way between them", "units")] = ORIGIN
    direction: Annotated[Direction, ParameterDoc("from the second to the first, across the axis")] = X
    distance: Annotated[PositiveNumber, ParameterDoc("between the lines", "units")] = 1.8
    radius: Annotated[PositiveNumber, ParameterDoc("of each core", "units")] = 0.8
    strength: Annotated[Number, ParameterDoc("circulation of the first", "units²/s")] = 1.0
    turning: Annotated[Literal["against", "together"], ParameterDoc("how the second turns")] = "against"

    def parts(self, time: float) -> tuple[Vortex, Vortex]:
        strength, radius = number_at(self.strength, time), number_at(self.radius, time)
        other = -strength if self.turning == "against" else strength
        one, two = self._centres(time)
        return Vortex(self.axis, one, radius, strength), Vortex(self.axis, two, radius, other)

    def _centres(self, time: float) -> tuple[Vector, Vector]:
        half = 0.5 * number_at(self.distance, time)
        (x, y, z), (a, b, c) = vector_at(self.centre, time), across(self.axis, self.direction)
        return (x + half * a, y + half * b, z + half * c), (x - half * a, y - half * b, z - half * c)


@dataclass(frozen=True)
class VortexRing(BasicField):
    """Rolls about a circle, up through its middle and down outside; keeps volume.

    The velocity that a line vortex of the circulation Γ, bent to a circle of the radius R, induces by the law
    of Biot and Savart, with distances d softened to √(d² + δ²): it is the curl of a vector potential, which
    complete elliptic integrals express, and so has no divergence. The ring stays at `centre`; a free one
    moves along its axis at Γ / (4 π R) · (ln(8 R/δ) − 1), so key the centre to send it on its way.

    Source: Rosenhead, *The spread of vorticity in the wake behind a cylinder*, Proc. R. Soc. A 127 (1930);
    Saffman, *Vortex Dynamics* (1992), §10.1, §11.1; Abramowitz & Stegun (1964), §17.6 for the integrals.
    """

    opcode: ClassVar[int] = kernels.RING

    axis: Annotated[Direction, ParameterDoc("along which its middle flows")] = Y
    centre: Annotated[VectorParameter, ParameterDoc("of the circle", "units")] = ORIGIN
    radius: Annotated[PositiveNumber, ParameterDoc("of the circle", "units")] = 1.0
    core: Annotated[PositiveNumber, ParameterDoc("radius of the core", "units")] = 0.3
    strength: Annotated[Number, ParameterDoc("circulation", "units²/s")] = 1.0

    def row(self, time: float) -> tuple[float, ...]:
        radius, core = number_at(self.radius, time), number_at(self.core, time)
        turning = number_at(self.strength, time) / (2 * math.pi)
        return (*vector_at(self.centre, time), *unit(self.axis), radius, core * core, turning)

    def gradient_bound(self, time: float) -> float:
        """Return the bound of a straight vortex, with a factor for the bend where the core is thick."""
        radius, core = number_at(self.radius, time), number_at(self.core, time)
        straight = abs(number_at(self.strength, time)) / (2 * math.pi * core * core)
        return straight * min(1.0 + core / radius, math.pi * radius / core)

    def length_scale(self, time: float) -> float:
        return min(number_at(self.radius, time), number_at(self.core, time))


@dataclass(frozen=True)
class SpiralVortex(_Composite):
    """Turns about a line, draws in and sends out along the line; keeps volume.

    A Lamb–Oseen vortex of the circulation Γ and the core's radius R, with the velocity −inflow/2 · r across
    the axis and inflow · height along it. In a fluid of the viscosity inflow · R² / 4 it is Burgers' steady
    vortex. A negative inflow spirals outwards and down.

    Source: Burgers, *A mathematical model illustrating the theory of turbulence*, Adv. Appl. Mech. 1 (1948).
    """

    axis: Annotated[Direction, ParameterDoc("of the line")] = Y
    centre: Annotated[VectorParameter, ParameterDoc("the fixed point", "units")] = ORIGIN
    radius: Annotated[PositiveNumber, ParameterDoc("of the core", "units")] = 0.5
    strength: Annotated[Number, _CIRCULATION] = 1.0
    inflow: Annotated[Number, ParameterDoc("lengthening along the axis; negative flows out", "1/s")] = 0.5

    def parts(self, time: float) -> tuple[Vortex, Strain]:
        return (
            Vortex(self.axis, self.centre, self.radius, self.strength),
            Strain(self.axis, self.centre, self.inflow),
        )


FLOWS: tuple[type, ...] = (Vortex, VortexPair, VortexRing, SpiralVortex)
