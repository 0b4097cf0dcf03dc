"""The light of skies in quick previews: by direction, and from the sun, which casts a shadow.

An environment map is averaged. What is far brighter than the rest of it shines from one place, as a sun.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.raster.raster_shapes import Floats
from flowsculpt.render.scene import clear_sky
from flowsculpt.render.scene.rgb_spaces import LUMA
from flowsculpt.render.scene.scene_lights import LightRig, Sky, Sun, sun_of
from flowsculpt.render.scene.sky import Daylight, Environment

_COLUMNS = 256
"""Columns of an averaged map, at most."""

_SUN_OVER_MEAN = 30.0
"""Luminance over the mean of a map from which on light is a sun's."""


def with_suns(rig: LightRig) -> LightRig:
    """Return the rig with the sun of its daylight, or of its environment map, as a sun of its own."""
    if rig.daylight:
        return replace(rig, suns=(*rig.suns, sun_of(rig.daylight)))
    if rig.environment and (sun := _map(rig.environment)[1]):
        return replace(rig, suns=(*rig.suns, sun))
    return rig


def facing_stage(rig: LightRig, turn: float) -> LightRig:
    """Return the rig with what keeps its place in the scene seen from a stage that is turned by radians."""
    if turn == 0.0 or not (rig.daylight or rig.environment):
        return rig
    return replace(replace(rig, softboxes=()).turned(-turn), softboxes=rig.softboxes)


def radiance(rig: LightRig, directions: Floats) -> Floats:
    """Return the radiance (N, 3) of a rig's sky, without suns, from unit directions (N, 3)."""
    if rig.daylight:
        return clear_sky.sky_radiance(rig.daylight, directions)
    if rig.environment:
        return _looked_up(_map(rig.environment)[0], directions, rig.environment.turn)
    return _gradient(rig.sky, directions[:, 1:2])


def seen_radiance(rig: LightRig, directions: Floats) -> Floats:
    """Return the radiance (N, 3) that the lens sees of a rig's sky with its sun; black if it is hidden."""
    if not rig.shows_sky:
        return np.zeros((len(directions), 3))
    if rig.environment:
        light = _looked_up(rig.environment.pixels(), directions, rig.environment.turn)
        return light * rig.environment.intensity
    light = radiance(rig, directions)
    if rig.daylight:
        light[directions @ np.array(rig.daylight.direction) > math.cos(rig.daylight.width / 2.0)] += _disc(
            rig.daylight
        )
    return light


def _disc(daylight: Daylight) -> Floats:
    """Return the mean radiance (3,) of the sun's disc."""
    solid_angle = 2.0 * math.pi * (1.0 - math.cos(daylight.width / 2.0))
    return np.array(clear_sky.sun_irradiance(daylight)) / solid_angle


def _gradient(sky: Sky, height: Floats) -> Floats:
    """Return the radiance (N, 3) of a gradient sky at sines of elevations (N, 1); see `Sky.pixels`."""
    end = np.where(height > 0.0, np.array(sky.zenith), np.array(sky.nadir))
    return np.asarray(np.array(sky.horizon) + np.abs(height) ** 0.6 * (end - np.array(sky.horizon)))


@lru_cache(maxsize=2)
def _map(environment: Environment) -> tuple[NDArray[np.float32], Sun | None]:
    """Return an averaged map (H, W, 3) with its intensity, without its sun, and its sun, if it has one.

    The sun is where the map is brightest, of the light that exceeds _SUN_OVER_MEAN times the mean.
    """
    pixels = environment.pixels() * np.float32(environment.intensity)
    rows, columns = pixels.shape[:2]
    tilt = (np.arange(rows) + 0.5) / rows * math.pi
    weights = np.broadcast_to(np.sin(tilt)[:, None] * (math.pi / rows) ** 2, (rows, columns))
    luminance = pixels @ np.asarray(LUMA, np.float32)
    limit = _SUN_OVER_MEAN * float((luminance * weights).sum() / weights.sum())
    bright, sun = luminance > limit, None
    if bright.any():
        excess = pixels[bright] * (1.0 - limit / luminance[bright])[:, None]
        row, column = np.nonzero(bright)
        places = _direction((column + 0.5) / rows * math.pi, tilt[row], environment.turn)
        share = weights[bright][:, None]
        middle = (places * share * (excess @ LUMA)[:, None]).sum(axis=0)
        red, green, blue = (excess * share).sum(axis=0).tolist()
        x, y, z = (-middle / np.linalg.norm(middle)).tolist()
        sun = Sun((x, y, z), (red, green, blue))
        pixels = pixels.copy()
        pixels[bright] -= excess
    step = max(1, columns // _COLUMNS)
    even = pixels[: rows // step * step, : columns // step * step]
    blocks = even.reshape(rows // step, step, columns // step, step, 3)
    return blocks.mean(axis=(1, 3), dtype=np.float32), sun


def _direction(longitude: Floats, tilt: Floats, turn: float) -> Floats:
    """Return the directions (N, 3) of places of a map, as Mitsuba has them, turned by a half and `turn`."""
    angle = longitude + math.pi - turn
    return np.stack([np.sin(tilt) * np.sin(angle), np.cos(tilt), -np.sin(tilt) * np.cos(angle)], axis=1)


def _looked_up(pixels: NDArray[np.float32], directions: Floats, turn: float) -> Floats:
    """Return the pixels (N, 3) of a map (H, 2H, 3) in unit directions (N, 3)."""
    rows, columns = pixels.shape[:2]
    longitude = np.arctan2(directions[:, 0], -directions[:, 2]) - math.pi + turn
    column = (longitude / math.pi * rows).astype(int) % columns
    row = (np.arccos(np.clip(directions[:, 1], -1.0, 1.0)) / math.pi * rows).astype(int)
    return np.asarray(pixels[np.minimum(row, rows - 1), column], np.float64)
