"""Vortices: turning about an axis, fast within a core and slow outside."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.directions import ORIGIN, Z, unit
from pipeline.flow.choreography import Number, Place, Vector, number_at, place_at
from pipeline.flow.velocity import Term

Profile = Literal["lamb_oseen", "gaussian"]


@dataclass(frozen=True)
class Vortex(Term):
    """A vortex about a line; free of divergence.

    At the distance r from the axis, with the core's radius R and the circulation Γ, it turns at

        lamb_oseen  Γ / (2 π r²) · (1 − exp(−r²/R²))      in radians per second
        gaussian    Γ / (2 π R²) · exp(−r²/R²)

    so both turn at Γ / (2 π R²) on the axis. The first reaches far (its speed falls as 1/r), the second
    leaves alone what is beyond two radii.

    strength  Γ, square units per second; positive turns counter-clockwise seen against the axis

    Source: Lamb, *Hydrodynamics* (6th ed., 1932), §334a; Oseen (1912). P3.
    """

    axis: Vector = Z
    centre: Place = ORIGIN
    radius: Number = 1.0
    strength: Number = 1.0
    profile: Profile = "lamb_oseen"

    @property
    def kind(self) -> int:
        return op.GAUSSIAN if self.profile == "gaussian" else op.LAMB_OSEEN

    def row(self, time: float) -> tuple[float, ...]:
        narrowness = number_at(self.radius, time) ** -2.0
        spin = number_at(self.strength, time) / (2 * math.pi) * narrowness
        return (*place_at(self.centre, time), *unit(self.axis), narrowness, spin)

    def steepness(self, time: float) -> float:
        """The turning on the axis; nowhere is the gradient steeper than that times 1.3."""
        return 1.3 * abs(number_at(self.strength, time)) / (2 * math.pi * number_at(self.radius, time) ** 2)
