"""Light that hazy air scatters towards the lens. Importing this imports Mitsuba."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from flowsculpt.render.scene.fog import Fog, density, passed
from flowsculpt.render.scene.scene_stage import StagePlacement


class Air:
    """Hazy air around a subject, in scene units. Its values are data of the compiled code."""

    def __init__(self, fog: Fog, placement: StagePlacement) -> None:
        size, (x, y, z) = placement.size, placement.origin
        self._middle = dr.opaque(mi.Point3f, [x, y + fog.height * size, z])
        self._radius = dr.opaque(mi.Float, fog.radius * size)
        self._depth = dr.opaque(mi.Float, fog.rate * fog.radius)

    def scatters(self, ray: Any, distance: Any, chance: Any) -> AirPoint:
        """Return a point of the air on each ray before `distance`. chance: random numbers from 0 to 1"""
        start = (ray.o - self._middle) / self._radius
        nearest = -dr.dot(start, ray.d)
        closest = dr.squared_norm(start + nearest * ray.d)
        half = dr.safe_sqrt(1.0 - closest)
        first, last = dr.maximum(-half, -nearest), dr.minimum(half, distance / self._radius - nearest)
        length = dr.maximum(last - first, 0.0)
        along = first + chance * length
        before = passed(closest, first)
        seen = dr.exp(-self._depth * (passed(closest, along) - before))
        clear = dr.select(length > 0.0, dr.exp(-self._depth * (passed(closest, last) - before)), 1.0)
        share = self._depth * density(closest, along) * length * seen
        si = dr.zeros(mi.SurfaceInteraction3f)
        si.p = ray.o + ray.d * ((along + nearest) * self._radius)
        valid: Any = dr.select(length > 0.0, 1.0, dr.inf)  # infinitely far: no point was chosen
        si.t = valid
        return AirPoint(si, share, clear)


@dataclass(frozen=True, eq=False)
class AirPoint:
    """A point of the air on each ray; a BSDF for the light that is scattered there.

    si     where it is
    share  of the light there that the lens gets, over the density of the points
    clear  share of the light from behind the air that the lens gets
    """

    si: Any
    share: Any
    clear: Any

    def eval_pdf(self, _context: Any, _si: Any, _direction: Any, _active: Any) -> tuple[Any, Any]:
        """Return the scattered share of light from a direction, the same from all, and no density."""
        return mi.Color3f(0.25 / math.pi), mi.Float(0.0)
