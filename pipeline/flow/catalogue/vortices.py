"""Vortices: turning about an axis, fast within a core and slow outside."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.linear import Strain
from pipeline.flow.keyframes import Number, Place, Vector, number_at, place_at
from pipeline.flow.parameters import Direction, Positive, Sense
from pipeline.flow.program import Program
from pipeline.flow.vectors import ORIGIN, X, Y, Z, across, unit
from pipeline.flow.velocity import Term, VelocityField

Profile = Literal["lamb_oseen", "gaussian", "rankine"]

_KINDS = {"lamb_oseen": op.LAMB_OSEEN, "gaussian": op.GAUSSIAN, "rankine": op.RANKINE}


@dataclass(frozen=True)
class Vortex(Term):
    """Turns about a line, fast in the core and slow outside; keeps volume.

    At the distance r from the axis, with the core's radius R and the circulation Γ, it turns at

        lamb_oseen  Γ / (2 π r²) · (1 − exp(−r²/R²))      in radians per second
        gaussian    Γ / (2 π R²) · exp(−r²/R²)
        rankine     Γ / (2 π R²) within the core, Γ / (2 π r²) outside

    so all turn at Γ / (2 π R²) on the axis. The first and the last reach far (their speed falls as 1/r), the
    second leaves alone what is beyond two radii. The last has a kink at the core's rim.

    Source: Lamb, *Hydrodynamics* (6th ed., 1932), §334a; Oseen (1912); Rankine (1858). P3.
    """

    axis: Annotated[Direction, Sense("of the line")] = Z
    centre: Annotated[Place, Sense("a point on the line", "units")] = ORIGIN
    radius: Annotated[Positive, Sense("of the core", "units")] = 1.0
    strength: Annotated[Number, Sense("circulation, counter-clockwise seen against the axis", "units²/s")] = (
        1.0
    )
    profile: Annotated[Profile, Sense("how the turning falls with the distance")] = "lamb_oseen"

    @property
    def kind(self) -> int:
        return _KINDS[self.profile]

    def row(self, time: float) -> tuple[float, ...]:
        narrowness = number_at(self.radius, time) ** -2.0
        spin = number_at(self.strength, time) / (2 * math.pi) * narrowness
        return (*place_at(self.centre, time), *unit(self.axis), narrowness, spin)

    def gradient_bound(self, time: float) -> float:
        """The turning on the axis; nowhere is the gradient steeper than that times 1.3."""
        return 1.3 * abs(number_at(self.strength, time)) / (2 * math.pi * number_at(self.radius, time) ** 2)


@dataclass(frozen=True)
class VortexPair(VelocityField):
    """Two Lamb–Oseen vortices with parallel axes, against each other or together; keeps volume.

    Against each other they drive a jet between them; together they stir what lies around both. They stay
    where they are put: a free pair with circulations ±Γ at the distance d would move at Γ / (2 π d).

    Source: Lamb, *Hydrodynamics* (6th ed., 1932), §155.
    """

    axis: Annotated[Direction, Sense("of both lines")] = Z
    centre: Annotated[Place, Sense("half way between them", "units")] = ORIGIN
    direction: Annotated[Direction, Sense("from the second to the first, across the axis")] = X
    distance: Annotated[Positive, Sense("between the lines", "units")] = 1.8
    radius: Annotated[Positive, Sense("of each core", "units")] = 0.8
    strength: Annotated[Number, Sense("circulation of the first", "units²/s")] = 1.0
    turning: Annotated[Literal["against", "together"], Sense("how the second turns")] = "against"

    def program(self, time: float) -> Program:
        return tuple(row for vortex in self._vortices(time) for row in vortex.program(time))

    def gradient_bound(self, time: float) -> float:
        return sum(vortex.gradient_bound(time) for vortex in self._vortices(time))

    def _vortices(self, time: float) -> tuple[Vortex, Vortex]:
        strength, radius = number_at(self.strength, time), number_at(self.radius, time)
        other = -strength if self.turning == "against" else strength
        one, two = self._centres(time)
        return Vortex(self.axis, one, radius, strength), Vortex(self.axis, two, radius, other)

    def _centres(self, time: float) -> tuple[Vector, Vector]:
        half = 0.5 * number_at(self.distance, time)
        (x, y, z), (a, b, c) = place_at(self.centre, time), across(self.axis, self.direction)
        return (x + half * a, y + half * b, z + half * c), (x - half * a, y - half * b, z - half * c)


@dataclass(frozen=True)
class VortexRing(Term):
    """Rolls about a circle, up through its middle and down outside; keeps volume.

    The velocity that a line vortex of the circulation Γ, bent to a circle of the radius R, induces by the law
    of Biot and Savart, with distances d softened to √(d² + δ²): it is the curl of a vector potential, which
    complete elliptic integrals express, and so has no divergence. The ring stays at `centre`; a free one
    moves along its axis at Γ / (4 π R) · (ln(8 R/δ) − 1), so key the centre to send it on its way.

    Source: Rosenhead, *The spread of vorticity in the wake behind a cylinder*, Proc. R. Soc. A 127 (1930);
    Saffman, *Vortex Dynamics* (1992), §10.1, §11.1; Abramowitz & Stegun (1964), §17.6 for the integrals.
    """

    axis: Annotated[Direction, Sense("along which its middle flows")] = Y
    centre: Annotated[Place, Sense("of the circle", "units")] = ORIGIN
    radius: Annotated[Positive, Sense("of the circle", "units")] = 1.0
    core: Annotated[Positive, Sense("radius of the core", "units")] = 0.3
    strength: Annotated[Number, Sense("circulation", "units²/s")] = 1.0

    @property
    def kind(self) -> int:
        return op.RING

    def row(self, time: float) -> tuple[float, ...]:
        radius, core = number_at(self.radius, time), number_at(self.core, time)
        turning = number_at(self.strength, time) / (2 * math.pi)
        return (*place_at(self.centre, time), *unit(self.axis), radius, core * core, turning)

    def gradient_bound(self, time: float) -> float:
        """That of a straight vortex on its axis, and what the bend adds where the core is not thin."""
        radius, core = number_at(self.radius, time), number_at(self.core, time)
        straight = abs(number_at(self.strength, time)) / (2 * math.pi * core * core)
        return straight * min(1.0 + core / radius, math.pi * radius / core)


@dataclass(frozen=True)
class SpiralVortex(VelocityField):
    """Turns about a line, draws in and sends out along the line; keeps volume.

    A Lamb–Oseen vortex of the circulation Γ and the core's radius R, with the velocity −inflow/2 · r across
    the axis and inflow · height along it. In a fluid of the viscosity inflow · R² / 4 it is Burgers' steady
    vortex. A negative inflow spirals outwards and down.

    Source: Burgers, *A mathematical model illustrating the theory of turbulence*, Adv. Appl. Mech. 1 (1948).
    """

    axis: Annotated[Direction, Sense("of the line")] = Y
    centre: Annotated[Place, Sense("where nothing moves", "units")] = ORIGIN
    radius: Annotated[Positive, Sense("of the core", "units")] = 0.5
    strength: Annotated[Number, Sense("circulation, counter-clockwise seen against the axis", "units²/s")] = (
        1.0
    )
    inflow: Annotated[Number, Sense("lengthening along the axis; negative flows out", "1/s")] = 0.5

    def program(self, time: float) -> Program:
        return tuple(row for part in self._parts for row in part.program(time))

    def gradient_bound(self, time: float) -> float:
        return sum(part.gradient_bound(time) for part in self._parts)

    @property
    def _parts(self) -> tuple[Vortex, Strain]:
        return (
            Vortex(self.axis, self.centre, self.radius, self.strength),
            Strain(self.axis, self.centre, self.inflow),
        )
