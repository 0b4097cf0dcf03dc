"""Sample the light of a sky: the bright part and the rest, by distributions of their own.

A sun gives most of the light from a hundred-thousandth of the directions. One distribution over all
directions would send nearly all samples there, and too few of them to the sky. So directions come from two
distributions, which multiple importance sampling weighs against each other (Veach 1997).

Importing this imports Mitsuba, so an engine of a compiled variant must have been started.
"""

from __future__ import annotations

import math
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from render.base.serialise import Triple
from render.scene.sky import Daylight

MAX_COLUMNS, REST_COLUMNS = 2048, 128
"""Most columns of the table of bright directions, and columns of the table of the rest."""

BRIGHT = 2.0
"""Luminance from which a direction is bright, over the mean."""

LEAST_BRIGHT_FRACTION = 0.2
"""Least fraction of the light that makes a distribution of the bright part worth its shadow rays."""

_WIDENING = 1.01
"""Width of the cone of a sun over that of its disc: rounding never puts the rim outside."""

_RIM_SAMPLES = 1 << 18
"""Directions that measure a sun's disc."""

_TOGETHER = 1 << 20
"""Directions whose light is computed together."""

_GLARE = 0.01
"""Angle around a sun's disc that is not asked for the light of the sky, radians."""


class Cone:
    """Equal density in all directions of a sun's disc.

    direction  unit vector to the sun
    width      angular diameter, radians
    emitter    Mitsuba's daylight
    """

    def __init__(self, direction: Triple, width: float, emitter: Any) -> None:
        height = 1.0 - math.cos(_WIDENING * width / 2.0)
        self._axis = _opaque(mi.Vector3f, direction)
        self._height = _opaque(mi.Float, height)
        self._density = _opaque(mi.Float, 1.0 / (2.0 * math.pi * height))
        self.correction = _opaque(mi.Float, self._correction(emitter, width))

    def _correction(self, emitter: Any, width: float) -> float:
        """Return the area of the disc by Mitsuba's samples over that by its radiance.

        Mitsuba finds the rim in single precision, which makes both differ by up to 0.4%.
        """
        numbers = np.arange(_RIM_SAMPLES)
        places = (numbers + 0.5) / _RIM_SAMPLES, numbers * ((math.sqrt(5.0) - 1.0) / 2.0) % 1.0
        direction, _ = self.sample(mi.Point2f(*(place.astype(np.float32) for place in places)))
        si = dr.zeros(mi.SurfaceInteraction3f, _RIM_SAMPLES)
        si.wi = -direction
        light = np.array(mi.luminance(emitter.eval(si)))
        inside = float((light > 0.1 * light.max()).mean())
        if inside > 1.0 - (_WIDENING - 1.0) / 2.0:
            return 1.0  # the sun is off
        rounded = float(np.float32(1.0) - np.cos(np.float32(width / 2.0)))
        return rounded / (inside * (1.0 - math.cos(_WIDENING * width / 2.0)))

    def sample(self, position: Any) -> tuple[Any, Any]:
        """Return a direction and its density, by two numbers from 0 to 1."""
        disc = mi.warp.square_to_uniform_disk_concentric(position)
        depth = dr.squared_norm(disc) * self._height  # 1 - cosine, which keeps its digits
        factor = dr.sqrt(self._height * (2.0 - depth))  # from a radius on the disc to the sine of the angle
        local = mi.Vector3f(disc.x * factor, disc.y * factor, 1.0 - depth)
        return mi.Frame3f(self._axis).to_world(local), self._density

    def pdf(self, direction: Any) -> Any:
        """Return the density of a direction."""
        depth = 0.5 * dr.squared_norm(direction - self._axis)
        return dr.select(depth <= self._height, self._density, 0.0)


class Table:
    """Density by a table of luminances.

    Rows go from the zenith to the nadir, columns from +z towards +x and on to +z again. The density is above
    0 everywhere.
    """

    def __init__(self, luminance: NDArray[np.float64]) -> None:
        if not luminance.any():
            luminance = np.ones_like(luminance)  # a sky that is turned off still has a density
        sine = np.sin(np.linspace(0.0, math.pi, len(luminance)))
        weights = np.maximum(luminance, 1e-4 * luminance.mean()) * np.maximum(sine, 0.25 * sine[1])[:, None]
        self.correction = 1.0
        self._warp: Any = mi.Hierarchical2D0(
            np.ascontiguousarray(weights, dtype=np.float32), [], normalize=True
        )

    def sample(self, position: Any) -> tuple[Any, Any]:
        """Return a direction and its density, by two numbers from 0 to 1."""
        uv, density = self._warp.sample(position)
        sine, cosine = dr.sincos(uv.y * math.pi)
        across, along = dr.sincos(uv.x * (2.0 * math.pi))
        return mi.Vector3f(sine * across, cosine, sine * along), density * _jacobian(sine)

    def pdf(self, direction: Any) -> Any:
        """Return the density of a direction."""
        turn = dr.atan2(direction.x, direction.z) * (0.5 / math.pi)
        uv = mi.Point2f(turn - dr.floor(turn), dr.safe_acos(direction.y) / math.pi)
        return self._warp.eval(uv) * _jacobian(dr.safe_sqrt(1.0 - direction.y * direction.y))


def _jacobian(sine: Any) -> Any:
    """Return the density over directions for a density of 1 in the table."""
    return dr.select(sine > 1e-5, dr.rcp(2.0 * math.pi**2 * sine), 0.0)


def is_map(emitter: Any) -> bool:
    """Return True for an environment map, which daylight is in a working space that Mitsuba's sky lacks."""
    return "data" in mi.traverse(emitter)


_latest: dict[Daylight, tuple[Cone, Table]] = {}
"""Distributions of the latest daylight, which most frames of a shot share: to measure them takes as long as
ten thousand paths."""


def sun_and_sky(emitter: Any, daylight: Daylight) -> tuple[Cone, Table]:
    """Return the distributions of a sun's disc, and of the sky around it. emitter: Mitsuba's daylight"""
    if daylight not in _latest:
        _latest.clear()
        _latest[daylight] = _measured(emitter, daylight.direction, daylight.width)
    return _latest[daylight]


def _measured(emitter: Any, direction: Triple, width: float) -> tuple[Cone, Table]:
    """Measure the distributions of daylight with a sun in a direction, `width` radians wide."""
    luminance = _luminance(emitter, REST_COLUMNS)
    near = _directions(REST_COLUMNS, slice(None)) @ np.array(direction) > math.cos(width / 2.0 + _GLARE)
    luminance[near] = luminance[~near].max()
    return Cone(direction, width, emitter), Table(_dilated(luminance))


def bright_and_rest(emitter: Any) -> tuple[Table | None, Table]:
    """Return the distributions of the bright part of an environment map, or None, and of the rest."""
    columns = int(mi.traverse(emitter)["data"].shape[1])
    kept = min(MAX_COLUMNS, 1 << (columns - 1).bit_length())
    luminance = _luminance(emitter, kept * max(2, columns // kept))
    area = np.sin(np.linspace(0.0, math.pi, len(luminance)))[:, None] * np.ones(luminance.shape[1])
    limit = BRIGHT * float(np.average(luminance, weights=area))
    excess = np.maximum(luminance - limit, 0.0)
    rest = Table(_coarser(luminance - excess, REST_COLUMNS))
    if (excess * area).sum() < LEAST_BRIGHT_FRACTION * (luminance * area).sum():
        return None, Table(_coarser(luminance, kept))
    return Table(_coarser(excess, kept)), rest


def _directions(columns: int, rows: slice) -> NDArray[np.float64]:
    """Return the directions (rows, columns + 1, 3) of some rows of a table, which has columns / 2 + 1."""
    tilt = np.linspace(0.0, math.pi, columns // 2 + 1)[rows, None]
    turn = np.linspace(0.0, 2.0 * math.pi, columns + 1)
    parts = np.sin(tilt) * np.sin(turn), np.cos(tilt), np.sin(tilt) * np.cos(turn)
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


def _luminance(emitter: Any, columns: int) -> NDArray[np.float64]:
    """Return the luminance of a distant emitter for the entries (columns / 2 + 1, columns + 1) of a table."""
    luminance = np.empty((columns // 2 + 1, columns + 1))
    step = max(1, _TOGETHER // columns)
    for first in range(0, len(luminance), step):
        rows = slice(first, first + step)
        directions = _directions(columns, rows).reshape(-1, 3)
        si = dr.zeros(mi.SurfaceInteraction3f, len(directions))
        si.wi = -mi.Vector3f(np.ascontiguousarray(directions.T, dtype=np.float32))
        luminance[rows] = np.array(mi.luminance(emitter.eval(si))).reshape(-1, columns + 1)
    return luminance


def _coarser(values: NDArray[np.float64], columns: int) -> NDArray[np.float64]:
    """Return means of a table around the entries of one with fewer columns."""
    step = max(1, (values.shape[1] - 1) // columns)
    if step == 1:
        return values
    rows = (len(values) - 1) // step
    cells = values[:-1, :-1].reshape(rows, step, -1, step).mean(axis=(1, 3))
    cells = np.pad(np.pad(cells, ((0, 0), (1, 1)), mode="wrap"), ((1, 1), (0, 0)), mode="edge")
    return np.asarray((cells[1:, 1:] + cells[:-1, 1:] + cells[1:, :-1] + cells[:-1, :-1]) / 4.0)


def _dilated(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the greatest of each entry and its eight neighbours: the light ends at the horizon."""
    padded = np.pad(np.pad(values, ((0, 0), (1, 1)), mode="wrap"), ((1, 1), (0, 0)), mode="edge")
    across = np.maximum(np.maximum(padded[:, 2:], padded[:, :-2]), padded[:, 1:-1])
    return np.asarray(np.maximum(np.maximum(across[2:], across[:-2]), across[1:-1]))


def _opaque(kind: Any, value: Any) -> Any:
    """Return a value as data of the compiled code, which would otherwise be compiled for each value."""
    data = kind(value)
    dr.make_opaque(data)
    return data
