"""Air that scatters light: densest around the subject, thinner outwards to nothing, so that it has no edge.

Light is scattered once: the light of lamps, towards the lens. What the lens sees through it is dimmer.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Fog:
    """A ball of hazy air. Its density falls from the middle as (1 - (distance / radius)²)².

    rate    of light that is scattered in the middle, per stage unit
    radius  stage units
    height  of its middle above the subject's base, stage units
    """

    rate: float = 0.06
    radius: float = 7.5
    height: float = 1.5


def density(closest: Any, along: Any) -> Any:
    """Return the density of air, over that of the middle, on a line through a ball of radius 1.

    closest  square of the least distance of the line from the middle
    along    the line, from its closest point
    """
    left = 1.0 - closest - along * along
    return left * left


def passed(closest: Any, along: Any) -> Any:
    """Return the integral of `density` from the closest point on."""
    left, square = 1.0 - closest, along * along
    return along * (left * left - square * (2.0 / 3.0 * left - square / 5.0))
