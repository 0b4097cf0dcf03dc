"""Texture coordinates of a surface's vertices, and Mitsuba bitmaps placed by them.

The first coordinate is the phase of a pattern, the position across scratches, or the first coordinate of a
texture. The second is 1 on the subject and 0 elsewhere, so that its mean over a pixel is the matte. The
second coordinate of a texture is added to it, scaled down so far that it does not show in the matte, and so
is the position along scratches, from which Mitsuba makes tangents.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.scene.materials import Material
from render.scene.scratches import scratch_corners
from render.scene.surface import Surface
from render.scene.texture_projection import TextureProjection, project_texture
from render.scene.vertex_colours import vertex_phases

Floats = NDArray[np.float64]

SUBJECT, SURROUNDINGS = 1.0, 0.0
"""The second coordinate, which becomes the matte."""

_SCRATCH_RANGE = 2.0**-10
"""Range above 1 that scratches use on each face: 8000 steps."""

SCRATCH_TANGENT = "scratch_tangent"
"""Name of the vertex attribute (V, 3) of unit tangents along scratches."""

_TEXTURE_RANGE = 2.0**-8
"""Range above 1 that textures use: 32000 steps, and a matte clipped at 1 is correct within 0.2%."""


@dataclass(frozen=True, eq=False)
class TextureCoordinates:
    """Texture coordinates (V, 2), and how a texture gets its second coordinate back: `v * scale + offset`.

    The scale is a power of two, so that repeating textures repeat in step with the subject's 1.
    """

    values: Floats
    scale: float = 1.0
    offset: float = 0.0


def texture_coordinates(surface: Surface, material: Material) -> tuple[Surface, TextureCoordinates]:
    """Return the subject, split where a texture needs it, and the coordinates of its vertices.

    Raises BadInputError where the material needs rest positions and the surface has none.
    """
    axes = material.scratch_axes
    if axes is not None:
        return _along_scratches(surface, axes)
    if material.texture_projection is not None:
        return _projected(surface, material.texture_projection)
    phases = vertex_phases(surface, material)
    first = np.zeros(len(surface.vertices)) if phases is None else phases
    return surface, TextureCoordinates(np.stack([first, np.full(len(first), SUBJECT)], axis=1))


def _along_scratches(surface: Surface, axes: Floats) -> tuple[Surface, TextureCoordinates]:
    """Return the surface with tangents along its scratches as vertex attribute SCRATCH_TANGENT.

    The coordinates go across the scratches and along them. On each face the second is constant across
    scratches, which is where Mitsuba's first tangent then points.
    """
    split, tangents, across = scratch_corners(surface, axes)
    corners = split.vertices.astype(np.float64).reshape(-1, 3, 3)
    along = np.einsum("fcx,fx->fc", corners - corners[:, :1], tangents.reshape(-1, 3, 3).sum(axis=1))
    along -= along.min(axis=1, keepdims=True)
    along *= _SCRATCH_RANGE / np.maximum(along.max(axis=1, keepdims=True), 1e-30)
    attributes = {**split.attributes, SCRATCH_TANGENT: tangents.astype(np.float32)}
    values = np.stack([across, SUBJECT + along.reshape(-1)], axis=1)
    return replace(split, attributes=attributes), TextureCoordinates(values)


def _projected(surface: Surface, projection: TextureProjection) -> tuple[Surface, TextureCoordinates]:
    split, coordinates = project_texture(surface, surface.require_rest("look has a picture"), projection)
    right, up = coordinates.T
    reach = 2.0 ** math.ceil(math.log2(max(float(np.abs(up).max(initial=0.0)), 1.0)))
    scale = 2.0 * reach / _TEXTURE_RANGE
    values = np.stack([right, SUBJECT + (up + reach) / scale], axis=1)
    return split, TextureCoordinates(values, scale, -scale * SUBJECT - reach)


def bitmap(
    pixels: NDArray[np.floating], coordinates: TextureCoordinates, projection: TextureProjection
) -> dict[str, Any]:
    """Return a Mitsuba texture of pixels (H, W, k), linear colours or data. Needs a started engine."""
    import mitsuba as mi

    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.array(pixels, dtype=np.float32, order="C")),
        "raw": True,
        "filter_type": "bilinear",
        "wrap_mode": "repeat",
        "to_uv": to_uv(coordinates, projection, pixels.shape[1] / pixels.shape[0]),
    }


def to_uv(coordinates: TextureCoordinates, projection: TextureProjection, aspect: float = 1.0) -> Any:
    """Return the transform from our coordinates to Mitsuba's, which go from the upper left right and down.

    aspect  width over height of the texture
    """
    import mitsuba as mi

    right, up = projection.offset
    height = aspect if projection.keeps_shape else 1.0
    matrix = np.eye(3, dtype=np.float32)
    matrix[0, 2] = 0.5 - right
    matrix[1, 1:] = -height * coordinates.scale, 0.5 + up - height * coordinates.offset
    return mi.ScalarTransform3f(matrix)
