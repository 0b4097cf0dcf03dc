"""The light of a clear sky by direction, without Mitsuba's engine: for quick previews and for exports.

The model is that of Mitsuba's emitter `sunsky` (Hošek and Wilkie, *An analytic model for full spectral sky
dome radiance*, 2012), from the tables in Mitsuba's package, so that both have the sky of the render.
"""

from __future__ import annotations

import importlib.machinery
import math
import struct
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import Triple
from flowsculpt.render.scene.rgb_spaces import LUMA
from flowsculpt.render.scene.sky import SUN_WIDTH, Daylight, exposure_of

Floats = NDArray[np.float64]

_TABLES = "data/sunsky/sunsky_datasets.bin"

_ALBEDO = 0.3
"""Reflectance of the ground that lights the sky from below, Mitsuba's default."""

_SKY_SCALE = 1.0 / 106.75
"""From the tables to Mitsuba's units: one over the integral of the colour-matching function y."""

_SUN_SCALE = np.array([3.61, 3.48, 3.32]) * 2.0 * math.pi * (1.0 - math.cos(SUN_WIDTH / 2.0))
"""From the radiance of the middle of the sun's disc in the tables to irradiance in Mitsuba's units."""


@lru_cache(maxsize=1)
def _tables() -> dict[str, Floats]:
    """Read the tables, by name. Raises BadInputError where Mitsuba is not installed."""
    found = importlib.machinery.PathFinder.find_spec("mitsuba")
    if found is None or not found.submodule_search_locations:
        raise BadInputError("pictures of daylight need the package mitsuba; install flowsculpt[film]")
    content = Path(found.submodule_search_locations[0], _TABLES).read_bytes()
    (count,), place, tables = struct.unpack_from("<I", content, 14), 18, {}
    for _ in range(count):
        (length,) = struct.unpack_from("<H", content, place)
        name = content[place + 2 : place + 2 + length].decode()
        dimensions, _, start = struct.unpack_from("<HBQ", content, place + 2 + length)
        shape = struct.unpack_from(f"<{dimensions}Q", content, place + 13 + length)
        place += 13 + length + 8 * dimensions
        tables[name] = np.frombuffer(content, "<f8", math.prod(shape), start).reshape(shape)
    return tables


def _by_haze(table: Floats, turbidity: float) -> Floats:
    """Return a table (10, …) between its whole turbidities, 1 to 10."""
    low = min(int(turbidity), 9) - 1
    return np.asarray(table[low] + (turbidity - 1.0 - low) * (table[low + 1] - table[low]))


@lru_cache(maxsize=8)
def _coefficients(elevation: float, turbidity: float) -> tuple[Floats, Floats]:
    """Return the model's nine coefficients (9, 3) and its radiance (3,) for a place of the sun."""
    x = (elevation / (math.pi / 2.0)) ** (1.0 / 3.0)
    weights = np.array([math.comb(5, k) * x**k * (1.0 - x) ** (5 - k) for k in range(6)])

    def at_sun(name: str) -> Floats:
        dark, bright = _by_haze(_tables()[name], turbidity)
        return np.tensordot(weights, dark + _ALBEDO * (bright - dark), 1)

    return at_sun("sky_params_rgb").T, at_sun("sky_rad_rgb")


def _bare_radiance(daylight: Daylight, directions: Floats) -> Floats:
    """Return radiance (N, 3) of the sky from unit directions (N, 3), in Mitsuba's units; 0 from below."""
    (a, b, c, d, e, f, g, h, i), radiance = _coefficients(daylight.elevation, daylight.turbidity)
    height = np.clip(directions[:, 1:2], 0.0, 1.0)
    cosine = np.clip(directions @ np.array(daylight.direction), -1.0, 1.0)[:, None]
    squared = cosine * cosine
    halo = (1.0 + squared) / (1.0 + i * i - 2.0 * i * cosine) ** 1.5
    around_sun = c + d * np.exp(e * np.arccos(cosine)) + f * squared + g * halo + h * np.sqrt(height)
    light = (1.0 + a * np.exp(b / (height + 0.01))) * around_sun * (radiance * _SKY_SCALE)
    return np.where(directions[:, 1:2] >= 0.0, np.maximum(light, 0.0), 0.0)


def _bare_sun(daylight: Daylight) -> Floats:
    """Return the irradiance (3,) of a surface that faces the sun, in Mitsuba's units."""
    part = min(int((daylight.elevation / (math.pi / 2.0)) ** (1.0 / 3.0) * 45), 44)
    beyond = daylight.elevation - (part / 45.0) ** 3 * math.pi / 2.0
    table = _by_haze(_tables()["sun_rad_rgb"], daylight.turbidity)[part].sum(axis=2)
    return np.maximum(table @ beyond ** np.arange(4), 0.0) * _SUN_SCALE


@lru_cache(maxsize=8)
def _exposure(daylight: Daylight) -> float:
    rows, columns = 24, 48
    tilt = np.repeat((np.arange(rows) + 0.5) / rows * math.pi / 2.0, columns)
    turn = np.tile((np.arange(columns) + 0.5) / columns * 2.0 * math.pi, rows)
    sine, cosine = np.sin(tilt), np.cos(tilt)
    directions = np.stack([sine * np.sin(turn), cosine, sine * np.cos(turn)], axis=1)
    weights = sine * cosine * (math.pi / 2.0 / rows) * (2.0 * math.pi / columns)
    sky = weights @ _bare_radiance(daylight, directions)
    return exposure_of(float((_bare_sun(daylight) + sky / 2.0) @ LUMA))


def sky_radiance(daylight: Daylight, directions: Floats) -> Floats:
    """Return the radiance (N, 3) of the sky without its sun from unit directions (N, 3), scene axes."""
    return _exposure(daylight) * daylight.sky * _bare_radiance(daylight, directions)


def map_directions(rows: int) -> Floats:
    """Return the directions (rows, 2 rows, 3) of the pixels of a map whose middle is at +z, as Mitsuba's."""
    tilt = (np.arange(rows)[:, None] + 0.5) / rows * math.pi
    turn = (np.arange(2 * rows) + 0.5) / rows * math.pi
    along = np.sin(tilt) * np.sin(turn), np.cos(tilt) + 0.0 * turn, -np.sin(tilt) * np.cos(turn)
    return np.stack(along, axis=-1)


def sky_pixels(daylight: Daylight, rows: int = 128) -> NDArray[np.float32]:
    """Return the sky without its sun as a map (rows, 2 rows, 3), whose middle is at +z."""
    light = sky_radiance(daylight, map_directions(rows).reshape(-1, 3))
    return light.reshape(rows, 2 * rows, 3).astype(np.float32)


def gradient(daylight: Daylight) -> tuple[Triple, Triple]:
    """Return zenith and horizon of the gradient (`Sky.pixels`) that comes nearest to the sky.

    Level ground receives the same light from both.
    """
    rows = sky_pixels(daylight)[:64].mean(axis=1, dtype=np.float64)
    height = np.cos((np.arange(64) + 0.5) / 128 * math.pi)
    share = np.stack([height**0.6, 1.0 - height**0.6], axis=1)
    weights = height * np.sqrt(1.0 - height**2)  # cosine times solid angle
    roots = np.sqrt(weights)[:, None]
    ends = np.maximum(np.linalg.lstsq(roots * share, roots * rows)[0], 0.0)
    ends *= weights @ rows / np.maximum(weights @ (share @ ends), 1e-12)
    zenith, horizon = ends.tolist()
    return tuple(zenith), tuple(horizon)


def sun_irradiance(daylight: Daylight) -> Triple:
    """Return the irradiance of a surface that faces the sun."""
    red, green, blue = (_exposure(daylight) * daylight.sun * _bare_sun(daylight)).tolist()
    return red, green, blue
