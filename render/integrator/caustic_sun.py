"""A wider sun for caustics, so that paths find it.

Light of a small sun that glass or a mirror throws on a matt surface is found only by paths that leave the
surface in just the right direction: once in a hundred thousand, and then it is a firefly. Seen from such a
path the sun is a wider disc of the same light, which blurs the caustic by as much. Kaplanyan and Dachsbacher
(*Path Space Regularization for Holistic and Robust Light Transport*, 2013) widen the reflection instead; for
a distant light this is the same.

Importing this imports Mitsuba, so an engine of a compiled variant must have been started.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from render.base.serialise import Triple

WIDTH = math.radians(6.0)
"""Angular diameter of the sun in caustics, radians."""

_RIM = 1.01
"""Distance from the middle of a disc, over its radius, that rounding never puts the rim beyond."""


@dataclass(frozen=True, eq=False)
class CausticSun:
    """The sun of a sky, for paths that left a matt surface and came through glass or by a mirror.

    direction  unit vector to the sun
    radius     of its disc, radians
    factor     width in caustics over that of the disc, at least 1
    """

    direction: Any
    radius: Any
    factor: Any

    @classmethod
    def of(cls, direction: Triple, width: float) -> CausticSun:
        """Return the sun in a direction; width: angular diameter of its disc, radians."""
        sun = cls(mi.Vector3f(direction), mi.Float(width / 2.0), mi.Float(max(1.0, WIDTH / width)))
        dr.make_opaque(sun.direction, sun.radius, sun.factor)
        return sun

    def widened(self, direction: Any, active: Any) -> tuple[Any, Any]:
        """Return where a path that leaves the scene looks, and the factor on the light from there.

        direction  unit vector along the path
        active     True for paths that are part of a caustic

        In the wider disc this is the place on the disc, at the same fraction of its radius. The sky behind,
        a ten-thousandth of the sun's light, is left out.
        """
        offset = direction - self.direction
        in_disc = active & (dr.norm(offset) < _RIM * self.factor * self.radius)
        on_disc = dr.normalize(self.direction + offset / self.factor)
        return dr.select(in_disc, on_disc, direction), dr.select(in_disc, dr.rcp(dr.square(self.factor)), 1.0)

    def is_on(self, direction: Any) -> Any:
        """Tell whether a direction leads to the disc."""
        return dr.norm(direction - self.direction) < _RIM * self.radius

    def spread(self, direction: Any) -> Any:
        """Return directions in the wider disc, for unit vectors to the disc; others stay."""
        offset = direction - self.direction
        in_disc = dr.norm(offset) < _RIM * self.radius
        return dr.select(in_disc, dr.normalize(self.direction + offset * self.factor), direction)
