"""Vortices: turning about an axis, fast within a core and slow outside."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.directions import ORIGIN, Z, unit
from pipeline.flow.choreography import Number, Place, number_at, place_at
from pipeline.flow.parameters import Direction, Positive, Sense
from pipeline.flow.velocity import Term

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

    def steepness(self, time: float) -> float:
        """The turning on the axis; nowhere is the gradient steeper than that times 1.3."""
        return 1.3 * abs(number_at(self.strength, time)) / (2 * math.pi * number_at(self.radius, time) ** 2)
