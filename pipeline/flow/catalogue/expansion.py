"""Fluid that wells up at a point, or drains there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.keyframes import Number, Place, number_at, place_at
from pipeline.flow.parameters import Direction, Positive, Sense
from pipeline.flow.vectors import ORIGIN, Z, unit
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

    def gradient_bound(self, time: float) -> float:
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


@dataclass(frozen=True)
class Expansion(Term):
    """A ball or disc that swells, or shrinks; nothing moves outside of it.

    Within the radius R, velocity = rate · (1 − r²/R²)² · r; outside, and on the rim, nothing moves. A disc
    moves points away from its axis, at any height; a ball away from its centre. Overlapping discs of both
    signs, added up, are figure B. Near the centre distances grow as exp(rate × seconds).

    Source: the discs of expansion and contraction of Reynolds 1991, figure B (P15); the falloff is ours.
    """

    shape: Annotated[Literal["disc", "ball"], Sense("away from an axis, or from a centre")] = "ball"
    axis: Annotated[Direction, Sense("of a disc")] = Z
    centre: Annotated[Place, Sense("what stays where it is", "units")] = ORIGIN
    radius: Annotated[Positive, Sense("of the region", "units")] = 1.0
    rate: Annotated[Number, Sense("at the centre; negative shrinks", "1/s", required=True)] = 1.0

    @property
    def kind(self) -> int:
        return op.DISC if self.shape == "disc" else op.BALL

    def row(self, time: float) -> tuple[float, ...]:
        narrowness = number_at(self.radius, time) ** -2.0
        return (*place_at(self.centre, time), *unit(self.axis), narrowness, number_at(self.rate, time))

    def gradient_bound(self, time: float) -> float:
        return abs(number_at(self.rate, time))
