"""Two vortices side by side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pipeline.flow.catalogue.directions import ORIGIN, X, Z, across
from pipeline.flow.catalogue.vortex import Vortex
from pipeline.flow.choreography import Number, Place, Vector, number_at, place_at
from pipeline.flow.parameters import Direction, Positive, Sense
from pipeline.flow.program import Program
from pipeline.flow.velocity import VelocityField


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

    def steepness(self, time: float) -> float:
        return sum(vortex.steepness(time) for vortex in self._vortices(time))

    def _vortices(self, time: float) -> tuple[Vortex, Vortex]:
        strength, radius = number_at(self.strength, time), number_at(self.radius, time)
        other = -strength if self.turning == "against" else strength
        one, two = self._centres(time)
        return Vortex(self.axis, one, radius, strength), Vortex(self.axis, two, radius, other)

    def _centres(self, time: float) -> tuple[Vector, Vector]:
        half = 0.5 * number_at(self.distance, time)
        (x, y, z), (a, b, c) = place_at(self.centre, time), across(self.axis, self.direction)
        return (x + half * a, y + half * b, z + half * c), (x - half * a, y - half * b, z - half * c)
