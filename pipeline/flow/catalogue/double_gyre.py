"""Two gyres whose border swings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.directions import ORIGIN
from pipeline.flow.choreography import Number, Place, number_at, place_at
from pipeline.flow.parameters import Positive, PositiveConstant, Sense
from pipeline.flow.velocity import Term


@dataclass(frozen=True)
class DoubleGyre(Term):
    """Two gyres side by side in x and y, whose border swings to and fro; keeps volume.

    From the stream function ψ = speed · scale · sin(π f) sin(π y), with 0 < x < 2 and 0 < y < 1 in heights of
    a gyre,

        f = ε sin(2π t/T) x² + (1 − 2 ε sin(2π t/T)) x    u = −∂ψ/∂y    v = ∂ψ/∂x

    Points that the border passes change sides: it mixes. Nothing crosses the frame of the two; beyond it, to
    the left and right, their mirror images follow (the formula's own cells grow ever narrower and steeper).

    Source: Shadden, Lekien & Marsden, *Definition and properties of Lagrangian coherent structures*,
    Physica D 212 (2005), §5.
    """

    centre: Annotated[Place, Sense("the middle of both", "units")] = ORIGIN
    scale: Annotated[Positive, Sense("height of a gyre, and about its width", "units")] = 1.0
    speed: Annotated[Number, Sense("π times it is the greatest there is", "units/s")] = 0.3
    swing: Annotated[Number, Sense("ε, how far the border swings")] = 0.25
    period: Annotated[PositiveConstant, Sense("of the swinging", "s")] = 3.0

    @property
    def kind(self) -> int:
        return op.DOUBLE_GYRE

    def row(self, time: float) -> tuple[float, ...]:
        scale, speed = number_at(self.scale, time), math.pi * number_at(self.speed, time)
        return (*place_at(self.centre, time), 1.0 / scale, speed, self._swing(time))

    def steepness(self, time: float) -> float:
        """Everywhere: with F = 1 + 2 ε the steepest of f, π² F² of the waves, and 2 π ε where f bends."""
        rate = math.pi * abs(number_at(self.speed, time)) / number_at(self.scale, time)
        swing = abs(self._swing(time))
        return rate * (math.pi * (1.0 + 2.0 * swing) ** 2 + 2.0 * swing)

    def _swing(self, time: float) -> float:
        return number_at(self.swing, time) * math.sin(2 * math.pi * time / self.period)
