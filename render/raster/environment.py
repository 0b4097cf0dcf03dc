"""The surroundings of a subject in quick previews: the light that stage and sky send to it, by direction.

Tables hold it on an octahedron that is unfolded to a square (Engelhardt and Dachsbacher 2008).
They are those of a stage, whatever its size and place, so that a shot needs them once.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from render.raster.raster_projection import Array, fast
from render.scene.scene_lights import Sky
from render.scene.scene_stage import Stage

SIDE = 33
"""Directions along each side of a table: about 8° apart."""

EYE_HEIGHT = 0.8
"""Height over the floor from which the surroundings are seen, stage units."""

Table = NDArray[np.float32]

FloorLight = Callable[[NDArray[np.float32], NDArray[np.float32]], NDArray[np.float32]]
"""Returns the radiance (N, 3) of points (N, 3) of the stage with normals (N, 3), stage units."""


class Surroundings(NamedTuple):
    """Tables (SIDE, SIDE, 3): what a mirror shows of a direction, and what a matt white surface sends that
    faces it.
    """

    mirrored: Table
    matt: Table


def surroundings_of(radiance: NDArray[np.float64], roughness: float) -> Surroundings:
    """Return tables of the radiance (SIDE², 3) of directions. roughness: of the mirror"""
    exponent = _exponent(roughness)
    mirrored = radiance if exponent is None else _lobe(exponent) @ radiance
    return Surroundings(_grid(mirrored), _grid(_lobe(1.0) @ radiance))


def sky_radiance(sky: Sky) -> NDArray[np.float64]:
    """Return the radiance (SIDE², 3) of a sky, without a stage. Below the horizon it is the horizon's."""
    height = np.clip(directions()[:, 1:2], 0.0, 1.0)
    return np.array(sky.horizon) + height * (np.array(sky.zenith) - np.array(sky.horizon))


def stage_radiance(stage: Stage, sky: Sky, light: FloorLight) -> NDArray[np.float64]:
    """Return the radiance (SIDE², 3) of the stage and of the sky over it, seen from above its middle."""
    profile, slopes = stage.profile()
    seen_at = np.arctan2(profile[:, 1] - EYE_HEIGHT, profile[:, 0])
    towards = directions()
    elevation = np.arcsin(np.clip(towards[:, 1], -1.0, 1.0))
    radius, height, inward, upward = (
        np.interp(elevation, seen_at, column) for column in (*profile.T, *slopes.T)
    )
    on_floor = height == 0.0
    radius[on_floor] = EYE_HEIGHT / np.tan(np.maximum(-elevation[on_floor], 1e-3))
    level = np.hypot(towards[:, 0], towards[:, 2])
    x, z = (towards[:, k] / np.maximum(level, 1e-12) for k in (0, 2))
    points = np.stack([radius * x, height, radius * z], axis=1).astype(np.float32)
    normals = np.stack([inward * x, upward, inward * z], axis=1).astype(np.float32)
    hidden = (elevation > seen_at[-1])[:, None]
    return np.where(hidden, sky_radiance(sky), light(points, normals))


@lru_cache(maxsize=1)
def directions() -> NDArray[np.float64]:
    """Return the unit directions (SIDE², 3) of a table, in its order."""
    points = _octahedron()
    return np.asarray(points / np.linalg.norm(points, axis=1, keepdims=True))


def _octahedron() -> NDArray[np.float64]:
    across = np.linspace(-1.0, 1.0, SIDE)
    x, z = (part.ravel() for part in np.meshgrid(across, across, indexing="ij"))
    y = 1.0 - np.abs(x) - np.abs(z)
    below = y < 0.0
    folded_x, folded_z = (1.0 - np.abs(z)) * np.sign(x), (1.0 - np.abs(x)) * np.sign(z)
    return np.stack([np.where(below, folded_x, x), y, np.where(below, folded_z, z)], axis=1)


@lru_cache(maxsize=8)
def _lobe(exponent: float) -> NDArray[np.float64]:
    """Return weights (SIDE², SIDE²) that average radiance over a cosine lobe around each direction."""
    edges = np.full(SIDE, 1.0)
    edges[[0, -1]] = 0.5
    solid_angle = np.outer(edges, edges).ravel() / np.linalg.norm(_octahedron(), axis=1) ** 3
    weights = np.maximum(directions() @ directions().T, 0.0) ** exponent * solid_angle
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _exponent(roughness: float) -> float | None:
    """Return the exponent of the lobe that a rough mirror reflects, or None for less than a table's step."""
    exponent = 0.5 / max(roughness, 1e-3) ** 2
    return None if exponent > 200.0 else max(1.0, round(exponent, 1))


def _grid(radiance: NDArray[np.float64]) -> Table:
    return np.ascontiguousarray(radiance.reshape(SIDE, SIDE, 3), np.float32)


@fast
def table_place(x: float, y: float, z: float) -> tuple[int, int, float, float]:
    """Return the row and column of a unit direction in a table, and the weights of the next ones."""
    scale = 1.0 / (math.fabs(x) + math.fabs(y) + math.fabs(z))
    u, v = x * scale, z * scale
    if y < 0.0:
        u, v = math.copysign(1.0 - math.fabs(v), u), math.copysign(1.0 - math.fabs(u), v)
    u, v = (0.5 + 0.5 * u) * (SIDE - 1), (0.5 + 0.5 * v) * (SIDE - 1)
    row, column = min(max(int(u), 0), SIDE - 2), min(max(int(v), 0), SIDE - 2)
    return row, column, u - row, v - column


@fast
def table_value(table: Array, row: int, column: int, down: float, right: float, k: int) -> float:
    """Return channel k of a table between four of its directions."""
    near = table[row, column, k] + right * (table[row, column + 1, k] - table[row, column, k])
    far = table[row + 1, column, k] + right * (table[row + 1, column + 1, k] - table[row + 1, column, k])
    return float(near + down * (far - near))
