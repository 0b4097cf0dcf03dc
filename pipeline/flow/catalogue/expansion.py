"""Regions that swell or shrink (figure B of the paper)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.directions import ORIGIN, Z, unit
from pipeline.flow.choreography import Number, Place, Vector, number_at, place_at
from pipeline.flow.velocity import Term


@dataclass(frozen=True)
class Expansion(Term):
    """Expansion from a centre, or contraction towards it where the rate is negative.

    Within the radius R, velocity = rate · (1 − r²/R²)² · r; outside, and on the rim, nothing moves.
    A `disc` moves points away from its axis, at any height; a `ball` away from its centre.

    rate  per second: near the centre distances grow as exp(rate × seconds)

    Source: the discs of expansion and contraction of Reynolds 1991, figure B (P15); the falloff is ours.
    """

    shape: Literal["disc", "ball"] = "ball"
    axis: Vector = Z
    centre: Place = ORIGIN
    radius: Number = 1.0
    rate: Number = 1.0

    @property
    def kind(self) -> int:
        return op.DISC if self.shape == "disc" else op.BALL

    def row(self, time: float) -> tuple[float, ...]:
        narrowness = number_at(self.radius, time) ** -2.0
        return (*place_at(self.centre, time), *unit(self.axis), narrowness, number_at(self.rate, time))

    def steepness(self, time: float) -> float:
        return abs(number_at(self.rate, time))
