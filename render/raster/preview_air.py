"""Hazy air in quick previews: the light that it scatters towards the lens, with the shadows of the key light.

The light is summed along some rays of the picture, and interpolated between.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.raster.lighting import Lighting
from flowsculpt.render.raster.raster_shapes import Floats, ScreenProjection, Shape
from flowsculpt.render.raster.shadows import ShadowMap
from flowsculpt.render.scene.fog import Fog, density, passed
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import pixel_places

COLUMNS, ROWS, STEPS = 64, 40, 80
"""Rays across and down the picture, and steps along each."""

Light = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class SeenAir:
    """The air that a camera sees.

    light  (STEPS + 1, ROWS, COLUMNS, 3), what it scatters from the lens up to each step
    """

    fog: Fog
    lighting: Lighting
    projection: ScreenProjection
    light: Light

    @classmethod
    def of(cls, fog: Fog, lighting: Lighting, projection: ScreenProjection, shadow: ShadowMap) -> SeenAir:
        """Sum the light along rays."""
        air = cls(fog, lighting, projection, np.zeros((STEPS + 1, ROWS, COLUMNS, 3), np.float32))
        across, down = np.linspace(-1.0, 1.0, COLUMNS), np.linspace(1.0, -1.0, ROWS)
        ways = air._ways(np.stack(np.meshgrid(across, down), axis=-1))
        step = (ways.last - ways.first) / STEPS
        along = ways.first + step * (np.arange(STEPS)[:, None, None] + 0.5)
        depth, size = fog.rate * fog.radius, fog.radius * lighting.setup.placement.size
        seen = np.exp(-depth * (passed(ways.closest, along) - passed(ways.closest, ways.first)))
        share = depth * density(ways.closest, along) * step * seen
        points = projection.origin + ((along + ways.nearest) * size)[..., None] * ways.towards
        lit = air._lit(points.reshape(-1, 3), shadow).reshape(*points.shape)
        air.light[1:] = np.cumsum(share[..., None] * lit, axis=0)
        return air

    def over(self, picture: Light, nearness: NDArray[np.float32]) -> Light:
        """Return a picture of linear light (H, W, 3) seen through the air.

        nearness  (H, W), one over the depth of what is there, 0 for nothing
        """
        rows, columns = nearness.shape
        ways = self._ways(pixel_places(columns, rows))
        with np.errstate(divide="ignore"):
            distance = ways.length / nearness / (self.fog.radius * self.lighting.setup.placement.size)
        last = np.clip(distance - ways.nearest, ways.first, ways.last)
        share = (last - ways.first) / np.maximum(ways.last - ways.first, 1e-9)
        depth = self.fog.rate * self.fog.radius
        clear = np.exp(-depth * (passed(ways.closest, last) - passed(ways.closest, ways.first)))
        i, down = _between((np.arange(rows) + 0.5) / rows, ROWS)
        j, right = _between((np.arange(columns) + 0.5) / columns, COLUMNS)
        k, further = _between(share, STEPS + 1)
        scattered = np.zeros_like(picture)
        for a, of_step in ((0, 1.0 - further), (1, further)):
            for b, of_row in ((0, 1.0 - down), (1, down)):
                for c, of_column in ((0, 1.0 - right), (1, right)):
                    weight = of_step * of_row[:, None] * of_column
                    scattered += weight[..., None] * self.light[k + a, i[:, None] + b, j + c]
        return np.asarray(clear[..., None] * picture + scattered, np.float32)

    def _ways(self, places: Floats) -> _Ways:
        """Return the ways through the air of rays to places (…, 2) of the picture."""
        axes = self.projection.axes / np.sum(self.projection.axes**2, axis=1, keepdims=True)
        towards = places @ axes[:2] + axes[2]
        length = np.linalg.norm(towards, axis=-1)
        towards /= length[..., None]
        placement = self.lighting.setup.placement
        middle = np.add(placement.origin, (0.0, self.fog.height * placement.size, 0.0))
        start = (self.projection.origin - middle) / (self.fog.radius * placement.size)
        nearest = -(towards @ start)
        closest = np.minimum(start @ start - nearest**2, 1.0)
        half = np.sqrt(1.0 - closest)
        first = np.minimum(np.maximum(-half, -nearest), half)
        return _Ways(towards, length, nearest, closest, first, half)

    def _lit(self, points: Floats, shadow: ShadowMap) -> Light:
        """Return the light (N, 3) that air at points (N, 3) scatters in each direction."""
        shape = Shape(
            points.astype(np.float32),
            np.zeros((len(points), 3), np.float32),
            np.empty((0, 3), np.int32),
            LOOKS["clay"],
        )
        visible = shadow.visibility(shadow.coordinates(shape, np.arange(len(points)), 1))
        if (in_beam := self.lighting.in_beam(points)) is not None:
            visible *= in_beam
        light = np.zeros((len(points), 3))
        for index, row in enumerate(self.lighting.lights):
            strength = np.ones(len(points))
            if row[9] > 0.0:
                away = row[:3] - points
                distance = np.linalg.norm(away, axis=1)
                strength = np.maximum(-(away @ row[3:6]), 0.0) / distance**3
            light += (strength if index else strength * visible)[:, None] * row[6:9]
        return np.asarray(light * (0.25 / math.pi), np.float32)


@dataclass(frozen=True, eq=False)
class _Ways:
    """Ways of rays through a ball of air, over its radius; all (…,), as of `flowsculpt.render.scene.fog`.

    towards      (…, 3), unit directions
    length       of the rays to depth 1, scene units
    nearest      from the lens to the closest point
    first, last  where the way begins and ends
    """

    towards: Floats
    length: Floats
    nearest: Floats
    closest: Floats
    first: Floats
    last: Floats


def _between(share: Floats, count: int) -> tuple[NDArray[np.intp], Floats]:
    """Return the index below places from 0 to 1 among `count` even ones, and how far to the next they are."""
    place = share * (count - 1)
    index = np.clip(place.astype(np.intp), 0, count - 2)
    return index, place - index
