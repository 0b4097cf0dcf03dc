"""A grip around the middle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.directions import ORIGIN, Y, unit
from pipeline.flow.choreography import Number, Place, number_at, place_at
from pipeline.flow.parameters import Direction, Positive, Sense
from pipeline.flow.velocity import Term


@dataclass(frozen=True)
class Squeeze(Term):
    """Narrows a waist and drives what was there out to both sides, as a hand does; keeps volume.

    With ϖ the distance from the axis and h the height along it, L the length and R the radius of the grip,

        across  − rate/2 · ϖ · (1 − 2 h²/L²) · exp(−h²/L² − ϖ²/R²)
        along     rate · h · (1 − ϖ²/R²) · exp(−h²/L² − ϖ²/R²)

    from the stream function rate/2 · ϖ² h exp(−h²/L² − ϖ²/R²): a strain at the centre that fades away. Beyond
    R it flows back. A negative rate makes a bulge.

    Source: Stokes' stream function, Lamb, *Hydrodynamics* (6th ed., 1932), §94; the fading is ours.
    """

    axis: Annotated[Direction, Sense("along which it gives way")] = Y
    centre: Annotated[Place, Sense("of the grip", "units")] = ORIGIN
    radius: Annotated[Positive, Sense("of the grip, across the axis", "units")] = 2.0
    length: Annotated[Positive, Sense("of the grip, along the axis", "units")] = 0.7
    rate: Annotated[Number, Sense("of lengthening at the centre; negative bulges", "1/s", required=True)] = (
        1.0
    )

    @property
    def kind(self) -> int:
        return op.SQUEEZE

    def row(self, time: float) -> tuple[float, ...]:
        wide, long = number_at(self.radius, time) ** -2.0, number_at(self.length, time) ** -2.0
        return (*place_at(self.centre, time), *unit(self.axis), long, wide, number_at(self.rate, time))

    def steepness(self, time: float) -> float:
        """At the centre it is the rate; the slanting parts grow with how far the grip is from round."""
        slender = number_at(self.radius, time) / number_at(self.length, time)
        return abs(number_at(self.rate, time)) * (1.0 + 0.75 * slender + 0.75 / slender)
