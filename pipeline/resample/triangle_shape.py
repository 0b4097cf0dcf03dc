"""The wanted shape of triangles (P36)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from pipeline.errors import UsageError

DEFAULT_ROUNDNESS = 0.6
"""At this value one triangle in a hundred falls short. Improving more would show as flicker (P38)."""

_DEMANDING = 0.7  # from here on one round of relaxation is not enough


@dataclass(frozen=True)
class TriangleShape:
    """Triangles below a roundness are improved by flipping edges and moving vertices.

    min_roundness  twice the inradius over the circumradius: 1 for an equilateral triangle, 0 for a needle; 0
                   improves only what splits and collapses touched

    Raises UsageError for a number outside 0 to 1.
    """

    min_roundness: float = DEFAULT_ROUNDNESS

    def __post_init__(self) -> None:
        if not 0 <= self.min_roundness < 1:
            raise UsageError(
                f"min_roundness {self.min_roundness:g} must lie between 0 (as it comes) and 1 (equilateral); "
                f"{DEFAULT_ROUNDNESS:g} is usual, 0.85 is demanding"
            )

    @property
    def rounds(self) -> int:
        """Rounds of moving vertices in a frame."""
        if self.min_roundness == 0:
            return 0
        return 1 if self.min_roundness < _DEMANDING else 3

    @cached_property
    def longest_share(self) -> float:
        """Share of the longest side in the summed squared sides of an isosceles triangle with this roundness.

        With the angle θ at its apex its roundness is 8 sin(θ/2) sin²((π - θ)/4), which falls from 60° on.
        """
        if self.min_roundness == 0:
            return 1.0
        low, high = math.pi / 2, math.pi
        while high - low > 1e-6:
            angle = 0.5 * (low + high)
            round_enough = 8 * math.sin(angle / 2) * math.sin((math.pi - angle) / 4) ** 2 > self.min_roundness
            low, high = (angle, high) if round_enough else (low, angle)
        return (1 - math.cos(low)) / (2 - math.cos(low))
