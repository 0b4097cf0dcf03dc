"""Fluid that wells up at a point, or drains there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.directions import ORIGIN
from pipeline.flow.choreography import Number, Place, number_at, place_at
from pipeline.flow.parameters import Positive, Sense
from pipeline.flow.velocity import Term


@dataclass(frozen=True)
class Source(Term):
    """Pushes everything away from a point, the less the farther.

    Velocity = Q / (4 π) · r / (r² + R²)^(3/2) for a flux Q: far away that of a point source. Within about the
    core's radius R volume is made; the divergence is 3 Q R² / (4 π (r² + R²)^(5/2)), which is all of Q.

    Source: Lamb, *Hydrodynamics* (6th ed., 1932), §56; the core is Plummer's (1911).
    """

    centre: Annotated[Place, Sense("the point", "units")] = ORIGIN
    radius: Annotated[Positive, Sense("of the core", "units")] = 0.3
    flux: Annotated[Number, Sense("volume that comes out", "units³/s")] = 1.0

    @property
    def kind(self) -> int:
        return op.SOURCE

    def row(self, time: float) -> tuple[float, ...]:
        radius, flux = number_at(self.radius, time), self._outwards * number_at(self.flux, time)
        return (*place_at(self.centre, time), radius * radius, flux / (4 * math.pi))

    def steepness(self, time: float) -> float:
        """That at the centre, where it is steepest."""
        return abs(number_at(self.flux, time)) / (4 * math.pi * number_at(self.radius, time) ** 3)

    @property
    def _outwards(self) -> float:
        return 1.0


@dataclass(frozen=True)
class Sink(Source):
    """Draws everything towards a point, the more the nearer: a source run backwards."""

    flux: Annotated[Number, Sense("volume that goes in", "units³/s")] = 1.0

    @property
    def _outwards(self) -> float:
        return -1.0
