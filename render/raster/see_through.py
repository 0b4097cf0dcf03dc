"""Clear subjects in quick previews: glass, honey and smoke let the stage behind them be seen.

The stage is drawn first. Of the subject its normals are drawn, and its thickness along each line of sight
(`visible_points.py`): by it light is absorbed or scattered. Glass shifts what is behind it, as a ball of its
refraction does, and rough glass blurs it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from render.raster.environment import table_place, table_value
from render.raster.lighting import Lighting
from render.raster.raster_projection import Array, fast
from render.raster.raster_shapes import Floats, ScreenProjection, Shape
from render.raster.visible_points import VisiblePoints
from render.scene.materials import Glass, Material, Smoke

SHARPNESS = (6.0, 400.0)
"""Least and greatest exponent of highlights: they are computed for each pixel."""

TOE, STOPS = 2.0**-8, 14.0
"""Linear light is packed as log2(1 + light / TOE) / STOPS."""

_STEEPEST = 2.0
"""Largest tangent of the angle by which glass bends a line of sight."""

_BEHIND = 1.5
"""Distance of the stage behind the subject, in halves of its size."""

_THICK = 0.4
"""Thickness from which glass bends as much as a ball, in halves of the subject's size."""

_ASIDE = 1.4
"""Rate at which light from the surroundings replaces that of the picture, by the sine of glass's bend."""

_DETOUR = 1.3
"""Length of light's way inside glass, over the thickness: it is reflected and bent there."""

_FORWARD = 0.15
"""Weight of the light on the near side of dense smoke, over that on both sides."""


class ClearBody(NamedTuple):
    """The optical properties of a clear material.

    tint        (3,), transmitted by each pair of surfaces
    rate        (3,), absorbed or scattered, per scene unit
    refraction  index of refraction; 1 for smoke, which has no surface
    """

    tint: Floats
    rate: Floats
    refraction: float

    @classmethod
    def of(cls, material: Material, size: float) -> ClearBody:
        """Return the properties of a material. size: half the subject's, scene units"""
        if isinstance(material, Smoke):
            return cls(np.ones(3), np.full(3, material.density / size), 1.0)
        if isinstance(material, Glass):
            rate = np.array(material.absorption.rate if material.absorption else (0.0, 0.0, 0.0))
            return cls(np.array(material.colour) ** 2, rate / size, material.refraction)
        return cls(np.array(material.colour), np.zeros(3), 1.5)


def seen_through(
    points: VisiblePoints,
    shape: Shape,
    lighting: Lighting,
    projection: ScreenProjection,
    thickness: NDArray[np.float32],
    layers: NDArray[np.int32],
    background: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Return the linear light (N, 3) of a clear subject.

    thickness, layers  as `add_thickness` computes them
    background         (H, W, 3), the linear light of the stage
    """
    material, size = shape.material, lighting.setup.placement.size
    roughness = material.roughness if isinstance(material, Glass) else 0.0
    across = float(np.linalg.norm(projection.axes[0]) * points.depth.mean()) if len(points.depth) else 1.0
    reach = roughness * _BEHIND * size / across / 2.0
    surface = _surface_light(points, material, lighting)
    light = np.empty_like(surface)
    mix_light(
        points.pixels,
        points.depth,
        points.normals,
        projection.axes,
        thickness,
        layers,
        _blurred(background, round(reach * background.shape[1])),
        surface,
        *ClearBody.of(material, size),
        lighting.mirrored(roughness),
        lighting.contact.frame[4:],
        size,
        light,
    )
    return light


def _blurred(picture: NDArray[np.float32], reach: int) -> NDArray[np.float32]:
    """Return a picture (H, W, 3) whose pixels are means over squares of 2 reach + 1 pixels."""
    for axis in (0, 1) if reach > 0 else ():
        sides = [(reach + 1, reach) if side == axis else (0, 0) for side in range(3)]
        sums = np.pad(picture, sides, mode="edge").cumsum(axis=axis, dtype=np.float64)
        last, first = (
            np.split(sums, [2 * reach + 1], axis=axis)[1],
            sums.take(range(picture.shape[axis]), axis),
        )
        picture = ((last - first) / (2 * reach + 1)).astype(np.float32)
    return picture


def _surface_light(points: VisiblePoints, material: Material, lighting: Lighting) -> NDArray[np.float32]:
    """Return the light (N, 3) that the surface reflects, or that smoke scatters to the eye."""
    which, no_faces = np.arange(len(points.points)), np.empty((0, 3), np.int32)
    near = Shape(points.points, points.normals, no_faces, material)
    if not isinstance(material, Smoke):
        return np.ascontiguousarray(lighting.shade(near, which, 0, sharpness=SHARPNESS)[:, :3])
    front = lighting.shade(near, which, 1)[:, :3]
    back = lighting.shade(near._replace(normals=-points.normals), which, 1)[:, :3]
    return np.asarray((0.5 + _FORWARD) * front + (0.5 - _FORWARD) * back)


@fast
def pack_light(light: Array, packed: Array) -> None:
    """Write linear light (N, 3) as values from 0 to 1 into packed (N, 3)."""
    scale = 1.0 / (STOPS * math.log(2.0))
    for n in range(light.shape[0]):
        for k in range(3):
            packed[n, k] = min(math.log(1.0 + max(light[n, k], 0.0) / TOE) * scale, 1.0)


@fast
def unpack_light(packed: Array, light: Array) -> None:
    """Write the linear light of packed values (H, W, 3) into light (H, W, 3)."""
    scale = np.float32(STOPS * math.log(2.0))
    for i in range(packed.shape[0]):
        for j in range(packed.shape[1]):
            for k in range(3):
                light[i, j, k] = np.float32(TOE) * (math.exp(packed[i, j, k] * scale) - np.float32(1.0))


@fast
def mix_light(
    pixels: Array,
    depth: Array,
    normals: Array,
    axes: Array,
    thickness: Array,
    layers: Array,
    background: Array,
    surface: Array,
    tint: Array,
    rate: Array,
    refraction: float,
    around: Array,
    turn: Array,
    size: float,
    light: Array,
) -> None:
    """Add what is behind a clear body to the light of its surface (N, 3), into light (N, 3).

    axes                    as of `ScreenProjection`
    tint, rate, refraction  the fields of `ClearBody`
    around                  the table `Surroundings.mirrored` of a smooth mirror: what glass shows that bends
                            a line of sight far aside
    turn                    (2,), cosine and sine of the stage's turn
    size                    half the subject's, scene units
    """
    rows, columns = thickness.shape
    across = math.sqrt(axes[0, 0] ** 2 + axes[0, 1] ** 2 + axes[0, 2] ** 2)
    upwards = math.sqrt(axes[1, 0] ** 2 + axes[1, 1] ** 2 + axes[1, 2] ** 2)
    opaque = np.empty(3)
    for k in range(3):
        opaque[k] = -math.log(max(tint[k], 1e-6))
    for p in range(pixels.shape[0]):
        i, j = pixels[p, 0], pixels[p, 1]
        long, front = 0.0, max(layers[i, j, 0], 1)
        if layers[i, j, 0] == layers[i, j, 1]:
            long = max(thickness[i, j], 0.0)
        row, column, way, lets_pass, aside = float(i), float(j), long, 1.0, 0.0
        a, b, a_weight, b_weight = 0, 0, 0.0, 0.0
        if refraction > 1.0:
            x, y, z = normals[p, 0], normals[p, 1], normals[p, 2]
            right = (axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z) / across
            up = (axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z) / upwards
            squared = min(right * right + up * up, 0.998)
            cosine, inside = math.sqrt(1.0 - squared), math.sqrt(1.0 - squared / (refraction * refraction))
            sine = math.sqrt(max(squared, 1e-12))
            # a ball bends a line of sight by twice the angle between the line outside and the line inside
            tangent = sine * (inside - cosine / refraction) / (cosine * inside + squared / refraction)
            tangent *= min(long / (_THICK * size), 1.0)
            along = (1.0 - tangent * tangent) / (1.0 + tangent * tangent)
            across_by = 2.0 * tangent / (1.0 + tangent * tangent)
            aside = min(_ASIDE * across_by, 1.0)
            u, v = -across_by * right / (sine * across), -across_by * up / (sine * upwards)
            x = along * axes[2, 0] + u * axes[0, 0] + v * axes[1, 0]
            y = along * axes[2, 1] + u * axes[0, 1] + v * axes[1, 1]
            z = along * axes[2, 2] + u * axes[0, 2] + v * axes[1, 2]
            x, z = turn[0] * x - turn[1] * z, turn[1] * x + turn[0] * z
            a, b, a_weight, b_weight = table_place(x, y, z)
            shift = min(2.0 * tangent / max(1.0 - tangent * tangent, 0.1), _STEEPEST)
            shift *= _BEHIND * size / (depth[p] * sine)
            column -= 0.5 * columns * across * shift * right
            row += 0.5 * rows * upwards * shift * up
            way = _DETOUR * long
            lets_pass = (0.96 - 0.96 * (1.0 - cosine) ** 5) ** 2
        row, column = min(max(row, 0.0), rows - 1.001), min(max(column, 0.0), columns - 1.001)
        m, n = int(row), int(column)
        down, beside = row - m, column - n
        for k in range(3):
            near = background[m, n, k] + beside * (background[m, n + 1, k] - background[m, n, k])
            far = background[m + 1, n, k] + beside * (background[m + 1, n + 1, k] - background[m + 1, n, k])
            passed = lets_pass * math.exp(-rate[k] * way - front * opaque[k])
            own = surface[p, k] if refraction > 1.0 else (1.0 - passed) * surface[p, k]
            behind = near + down * (far - near)
            if aside > 0.0:
                behind += aside * (table_value(around, a, b, a_weight, b_weight, k) - behind)
            light[p, k] = own + passed * behind


@fast
def lay_over(pixels: Array, coverage: Array, shown: Array, picture: Array) -> None:
    """Mix the display values (N, 3) of pixels into a picture (H, W, 3) by their coverage (N,)."""
    for p in range(pixels.shape[0]):
        i, j = pixels[p, 0], pixels[p, 1]
        for k in range(3):
            picture[i, j, k] += coverage[p] * (shown[p, k] - picture[i, j, k])
