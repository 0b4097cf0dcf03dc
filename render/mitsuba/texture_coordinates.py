"""Texture coordinates of a surface's vertices, and Mitsuba bitmaps placed by them.

The first coordinate is the phase of a pattern, or the first coordinate of a texture. The second is 1 on the
subject and 0 elsewhere, so that its mean over a pixel is the matte. The second coordinate of a texture is
added to it, scaled down so far that it does not show in the matte.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.scene.materials import Material
from render.scene.surface import Surface
from render.scene.texture_projection import Projection, project_texture
from render.scene.vertex_colours import vertex_phases

Floats = NDArray[np.float64]

SUBJECT, SURROUNDINGS = 1.0, 0.0
"""The second coordinate, which becomes the matte."""

_SCRATCH_RANGE = 2.0**-10
"""Range of the second coordinate that scratches use. A float32 near 1 has 8000 steps there."""

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
        return surface, planar_coordinates(surface.require_rest("look is brushed"), axes)
    if material.texture_projection is not None:
        return _projected(surface, material.texture_projection)
    phases = vertex_phases(surface, material)
    first = np.zeros(len(surface.vertices)) if phases is None else phases
    return surface, TextureCoordinates(np.stack([first, np.full(len(first), SUBJECT)], axis=1))


def planar_coordinates(points: Floats, axes: Floats) -> TextureCoordinates:
    """Return the coordinates of points (V, 3) along axes (2, 3), each 1 / the size of the texture long."""
    along, across = (points.astype(np.float64) @ axes.T).T
    reach = max(float(np.abs(across).max(initial=0.0)), 1.0)
    scale = 2.0 ** math.ceil(math.log2(reach)) / _SCRATCH_RANGE
    return TextureCoordinates(np.stack([along, SUBJECT + across / scale], axis=1), scale)


def _projected(surface: Surface, projection: Projection) -> tuple[Surface, TextureCoordinates]:
    split, coordinates = project_texture(surface, surface.require_rest("look has a picture"), projection)
    right, up = coordinates.T
    reach = 2.0 ** math.ceil(math.log2(max(float(np.abs(up).max(initial=0.0)), 1.0)))
    scale = 2.0 * reach / _TEXTURE_RANGE
    values = np.stack([right, SUBJECT + (up + reach) / scale], axis=1)
    return split, TextureCoordinates(values, scale, -scale * SUBJECT - reach)


def bitmap(
    pixels: NDArray[np.floating], coordinates: TextureCoordinates, projection: Projection
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


def to_uv(coordinates: TextureCoordinates, projection: Projection, aspect: float = 1.0) -> Any:
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
