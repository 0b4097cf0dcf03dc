"""Regions that swell or shrink (figure B of the paper)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.directions import ORIGIN, Z, unit
from pipeline.flow.choreography import Number, Place, number_at, place_at
from pipeline.flow.parameters import Direction, Positive, Sense
from pipeline.flow.velocity import Term


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

    def steepness(self, time: float) -> float:
        return abs(number_at(self.rate, time))
