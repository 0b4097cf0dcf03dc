"""The flow `marbling.comb`, with an equation of its own that is compiled."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

from flowsculpt.api.flows import ExternalField, Number, ParameterDoc, PositiveNumber, block_kernel, number_at


@block_kernel
def comb(numbers: Any, count: int, x: Any, y: Any, z: Any, t: float, u: Any, v: Any, w: Any) -> None:
    """Add the velocity at `count` points: along y, by the distance from the nearest tine along x."""
    strength, wave, sharpness = numbers[0], numbers[1], numbers[2]
    for i in range(count):
        v[i] += strength * math.exp(sharpness * (math.cos(wave * x[i]) - 1.0))


@dataclass(frozen=True)
class Comb(ExternalField):
    """Draws a comb through the material, upwards: its tines stand along x and drag what is near.

    The speed is strength · exp(sharpness · (cos(2π x / spacing) − 1)): greatest at a tine.
    """

    strength: Annotated[Number, ParameterDoc("speed of the tines", "units/s")] = 1.0
    spacing: Annotated[PositiveNumber, ParameterDoc("from tine to tine", "units")] = 0.5
    sharpness: Annotated[PositiveNumber, ParameterDoc("2 is a wave, 20 a fine tine")] = 6.0

    block = comb

    def numbers(self, time: float) -> tuple[float, ...]:
        return number_at(self.strength, time), self._wave(time), number_at(self.sharpness, time)

    def gradient_bound(self, time: float) -> float:
        """Return the steepest slope across the tines: where cos = (√(1 + 4 s²) − 1) / 2 s."""
        strength, wave, s = self.numbers(time)
        cosine = (math.sqrt(1.0 + 4.0 * s * s) - 1.0) / (2.0 * s)
        return abs(strength) * wave * s * math.sqrt(1.0 - cosine * cosine) * math.exp(s * (cosine - 1.0))

    def length_scale(self, time: float) -> float:
        """Return the width of a tine."""
        return 1.0 / (self._wave(time) * math.sqrt(number_at(self.sharpness, time)))

    def _wave(self, time: float) -> float:
        return 2.0 * math.pi / number_at(self.spacing, time)
