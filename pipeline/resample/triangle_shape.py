"""How much is done for well-shaped triangles (P36)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from pipeline.errors import UsageError

DEFAULT_ROUNDNESS = 0.6
"""What a hundredth of the triangles may fall short of. Mending more would show as sizzle (P38)."""

_DEMANDING = 0.7  # from here on one round of moving vertices is not enough


@dataclass(frozen=True)
class Shape:
    """Triangles less round than `roundness` are mended by turning edges and moving vertices.

    roundness  twice the inradius over the circumradius: 1 for an equilateral triangle, 0 for a needle.
               0 mends only what splits and collapses touched

    Raises UsageError for a number outside of 0 to 1.
    """

    roundness: float = DEFAULT_ROUNDNESS

    def __post_init__(self) -> None:
        if not 0 <= self.roundness < 1:
            raise UsageError(
                f"shape {self.roundness:g} must lie between 0 (as it comes) and 1 (equilateral); "
                f"{DEFAULT_ROUNDNESS:g} is usual, 0.85 is demanding"
            )

    @property
    def rounds(self) -> int:
        """How often vertices are moved in a frame."""
        if self.roundness == 0:
            return 0
        return 1 if self.roundness < _DEMANDING else 3

    @cached_property
    def longest_share(self) -> float:
        """The longest side's share in the sum of squared sides, in an isosceles triangle just round enough.

        With the angle θ at its apex its roundness is 8 sin(θ/2) sin²((π - θ)/4), which falls from 60° on.
        """
        if self.roundness == 0:
            return 1.0
        low, high = math.pi / 2, math.pi
        while high - low > 1e-6:
            angle = 0.5 * (low + high)
            round_enough = 8 * math.sin(angle / 2) * math.sin((math.pi - angle) / 4) ** 2 > self.roundness
            low, high = (angle, high) if round_enough else (low, angle)
        return (1 - math.cos(low)) / (2 - math.cos(low))
