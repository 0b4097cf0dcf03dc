"""A smoke ring."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.directions import ORIGIN, Y, unit
from pipeline.flow.choreography import Number, Place, number_at, place_at
from pipeline.flow.parameters import Direction, Positive, Sense
from pipeline.flow.velocity import Term


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

    def steepness(self, time: float) -> float:
        """That of a straight vortex on its axis, and what the bend adds where the core is not thin."""
        radius, core = number_at(self.radius, time), number_at(self.core, time)
        straight = abs(number_at(self.strength, time)) / (2 * math.pi * core * core)
        return straight * min(1.0 + core / radius, math.pi * radius / core)
