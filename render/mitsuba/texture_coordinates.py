"""Texture coordinates of a surface's vertices, and Mitsuba bitmaps placed by them.

The first coordinate is the phase of a pattern, the position across scratches, or the first coordinate of a
texture. The second is 1 on the subject and 0 elsewhere, so that its mean over a pixel is the matte. The
second coordinate of a texture is added to it, scaled down so far that it does not show in the matte, and so
is the position along scratches, from which Mitsuba makes tangents.

Scratches lie in planes across an axis, the grain, on the undeformed surface, and the deformation carries them
along. On a triangle their direction is a contour line of the corners' coordinate along the grain. Where the
rest surface is nearly perpendicular to the grain, such as on the end of a bar, contour lines have no stable
direction; there scratches are parallel to one fixed direction. Lines have no sign, so directions d are
averaged as tensors d dᵀ (Zhang, Hays and Turk, *Interactive tensor field design and visualization on
surfaces*, 2007): over the triangles around each vertex, several times. Triangles weigh by the squared
gradient of the coordinate, so that those without a clear direction take that of their neighbours.

Normal maps need the direction in which a texture goes right, at every vertex: the mean over its triangles,
weighted by their angles there (Mikkelsen, *Simulation of wrinkled surfaces revisited*, 2008). Textures go up
at a right angle to it, on the left or, where the texture is mirrored, on the right.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.mitsuba.engine import is_compiled
from flowsculpt.render.scene.materials import Material
from flowsculpt.render.scene.measured_colours import MISSING, shows_values
from flowsculpt.render.scene.patterns import Pigment
from flowsculpt.render.scene.surface import Surface
from flowsculpt.render.scene.texture_projection import TextureProjection, project_texture
from flowsculpt.render.scene.textures import BLACK, MIRROR, REPEAT, REPEATED

Floats = NDArray[np.float64]

SUBJECT, SURROUNDINGS = 1.0, 0.0
"""The second coordinate, which becomes the matte."""

_SCRATCH_RANGE = 2.0**-10
"""Range above 1 that scratches use on each face: 8000 steps."""

SCRATCH_TANGENT = "scratch_tangent"
"""Name of the vertex attribute (V, 3) of unit tangents along scratches."""

TEXTURE_TANGENT, MIRRORED = "texture_tangent", "texture_is_mirrored"
"""Names of the vertex attributes with the direction in which a texture goes right (V, 3), a unit vector or 0
where it has none, and 1 where the texture is mirrored, else 0 (V, 1)."""

_TEXTURE_RANGE = 2.0**-8
"""Range above 1 that textures use: 32000 steps, and a matte clipped at 1 is correct within 0.2%."""


@dataclass(frozen=True, eq=False)
class ScaledCoordinates:
    """Texture coordinates (V, 2), and how a texture gets its second coordinate back: `v * scale + offset`.

    The scale is a power of two, so that repeating textures repeat in step with the subject's 1.
    """

    values: Floats
    scale: float = 1.0
    offset: float = 0.0


def texture_coordinates(surface: Surface, material: Material) -> tuple[Surface, ScaledCoordinates]:
    """Return the subject, split where a texture needs it, and the coordinates of its vertices.

    Raises BadInputError where the material needs rest positions and the surface has none.
    """
    axes = material.scratch_axes
    if axes is not None:
        return _along_scratches(surface, axes)
    if material.texture_projection is not None:
        return _project(surface, material.texture_projection, material.has_normal_map)
    pigment = material.pattern
    if isinstance(pigment, Pigment):
        if is_compiled():
            from flowsculpt.render.mitsuba.pattern_textures import with_places  # needs a compiled variant

            sampled = with_places(surface, pigment)
            return sampled, ScaledCoordinates(np.tile([0.0, SUBJECT], (len(surface.vertices), 1)))
        if pigment.needs_samples:
            raise BadInputError(
                "spots, chips, and heights and roughness of a pigment need a compiled variant of Mitsuba. "
                "Take another pigment, or see what flowsculpt doctor says about libLLVM"
            )
    phases = material.phases(surface)
    if phases is not None and shows_values(pigment):
        surface, phases = _split_at_missing(surface, phases)
        phases = pigment.places_of(phases)
    first = np.zeros(len(surface.vertices)) if phases is None else phases
    return surface, ScaledCoordinates(np.stack([first, np.full(len(first), SUBJECT)], axis=1))


def _split_at_missing(surface: Surface, phases: Floats) -> tuple[Surface, Floats]:
    """Return the surface with faces that lack a value split off, and phases (V,), MISSING all over these.

    Between a value and none a face would show colours of the palette that stand for neither.
    """
    missing = phases == MISSING
    if not missing.any() or missing.all():
        return surface, phases
    lacks = missing[surface.faces].any(axis=1)
    vertices, corner = np.unique(2 * surface.faces.astype(np.int64) + lacks[:, None], return_inverse=True)
    split = surface.with_copied_vertices(vertices // 2, corner.reshape(-1, 3).astype(np.int32))
    return split, np.where(vertices % 2, MISSING, phases[vertices // 2])


def _along_scratches(surface: Surface, axes: Floats) -> tuple[Surface, ScaledCoordinates]:
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
    return replace(split, attributes=attributes), ScaledCoordinates(values)


def _project(
    surface: Surface, projection: TextureProjection, has_normal_map: bool
) -> tuple[Surface, ScaledCoordinates]:
    split, coordinates = project_texture(surface, surface.require_rest("look has a picture"), projection)
    if has_normal_map:
        split, coordinates = with_texture_tangents(split, coordinates)
    right, up = coordinates.T
    reach = 2.0 ** math.ceil(math.log2(max(float(np.abs(up).max(initial=0.0)), 1.0)))
    scale = 2.0 * reach / _TEXTURE_RANGE
    values = np.stack([right, SUBJECT + (up + reach) / scale], axis=1)
    return split, ScaledCoordinates(values, scale, -scale * SUBJECT - reach)


def with_texture_tangents(surface: Surface, coordinates: Floats) -> tuple[Surface, Floats]:
    """Return the surface with the attributes TEXTURE_TANGENT and MIRRORED, and its coordinates (V, 2).

    It is split where mirrored faces meet others.
    """
    corners = surface.vertices.astype(np.float64)[surface.faces]
    sides, steps = (np.roll(values, -1, axis=1) - values for values in (corners, coordinates[surface.faces]))
    area = steps[:, 0, 0] * steps[:, 1, 1] - steps[:, 0, 1] * steps[:, 1, 0]
    across = np.cross(sides[:, 0], sides[:, 1])
    outside = np.einsum("fx,fcx->f", across, surface.normals[surface.faces])
    is_mirrored = area * outside < 0.0
    right = sides[:, 0] * steps[:, 1, 1, None] - sides[:, 1] * steps[:, 0, 1, None]
    right = _unit(right * np.sign(area)[:, None])
    away = _unit(sides)
    angles = np.arccos(np.clip(-np.einsum("fcx,fcx->fc", away, np.roll(away, 1, axis=1)), -1.0, 1.0))
    vertices, corner = np.unique(
        2 * surface.faces.astype(np.int64) + is_mirrored[:, None], return_inverse=True
    )
    faces = corner.reshape(-1, 3).astype(np.int32)
    tangents = np.zeros((len(vertices), 3))
    np.add.at(tangents, faces, angles[..., None] * right[:, None])
    split = surface.with_copied_vertices(vertices // 2, faces)
    attributes = {
        **split.attributes,
        TEXTURE_TANGENT: _unit(tangents).astype(np.float32),
        MIRRORED: (vertices % 2).astype(np.float32)[:, None],
    }
    return replace(split, attributes=attributes), coordinates[vertices // 2]


def _unit(vectors: Floats) -> Floats:
    """Return vectors (..., 3) of length 1; those without a direction are 0."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(length > 1e-30, vectors / np.maximum(length, 1e-30), 0.0)


MOST_TEXELS = 1 << 26
"""Texels of a picture that is repeated along one side for Mitsuba, which repeats both or none."""


def bitmap(
    pixels: NDArray[np.floating],
    coordinates: ScaledCoordinates,
    projection: TextureProjection,
    wrap: tuple[str, str] = REPEATED,
) -> dict[str, Any]:
    """Return a Mitsuba texture of pixels (H, W, k), linear colours or data. Needs a started engine.

    Raises BadInputError where it would have over MOST_TEXELS.
    """
    import mitsuba as mi

    transform = to_uv(coordinates, projection, pixels.shape[1] / pixels.shape[0])
    if wrap != REPEATED:
        matrix = np.array(transform.matrix)
        pixels, placed = _unwrap(pixels, coordinates.values @ matrix[:2, :2].T + matrix[:2, 2], wrap)
        transform = mi.ScalarTransform3f((placed @ matrix).astype(np.float32))
    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.array(pixels, dtype=np.float32, order="C")),
        "raw": True,
        "filter_type": "bilinear",
        "wrap_mode": "repeat" if wrap in _REPEATING else "clamp",
        "to_uv": transform,
    }


_REPEATING = tuple((across, up) for across in (REPEAT, MIRROR) for up in (REPEAT, MIRROR))


def _unwrap(
    pixels: NDArray[np.floating], places: Floats, wrap: tuple[str, str]
) -> tuple[NDArray[np.floating], Floats]:
    """Return pixels that repeat or end alike at all sides, and the matrix (3, 3) that places them.

    A mirrored side is there twice, one that black surrounds gets a border of it, and one that repeats beside
    one that ends is there as often as it is seen.

    places  (V, 2) where the picture is seen, from its upper left
    """
    matrix = np.eye(3)
    for axis, mode in (1, wrap[0]), (0, wrap[1]):
        along = 1 - axis
        first, count, size = 0, 1, pixels.shape[axis]
        if mode == MIRROR:
            pixels, count = np.concatenate([pixels, np.flip(pixels, axis)], axis), 2
        if mode in (REPEAT, MIRROR) and wrap not in _REPEATING:
            low, high = places[:, along].min(initial=0.0), places[:, along].max(initial=1.0)
            first, last = count * math.floor(low / count), count * math.ceil(high / count)
            if (last - first) * size * pixels.shape[along] > MOST_TEXELS:
                raise BadInputError(
                    f"a picture of its materials repeats {last - first} times along one side and not along "
                    "the other, which takes too much memory; make the picture smaller"
                )
            pixels = np.concatenate([pixels] * ((last - first) // count), axis)
            count = last - first
        matrix[along] /= count
        matrix[along, 2] -= first / count
        if mode == BLACK:
            border = [(0, 0)] * 3
            border[axis] = (1, 1)
            pixels = np.pad(pixels, border)
            matrix[along] *= size / (size + 2.0)
            matrix[along, 2] += 1.0 / (size + 2.0)
    return pixels, matrix


def to_uv(coordinates: ScaledCoordinates, projection: TextureProjection, aspect: float = 1.0) -> Any:
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


END_SLOPE = 0.1
"""Sine of the angle between rest normal and grain below which scratches take the fixed direction."""

_ROUNDS = 3
"""Times that tensors are averaged, from triangles to vertices and back."""


def scratch_corners(surface: Surface, axes: Floats) -> tuple[Surface, Floats, Floats]:
    """Return the surface with three vertices of its own for each face, which differ in two further results.

    axes  (2, 3) unit axes: the direction of scratches where they have none, and the grain

    The results are the surface, unit tangents (3F, 3) along the scratches, those of a face within a right
    angle of each other, and positions across the scratches (3F,) in scene units at rest. The surface needs
    rest positions.
    """
    rest = surface.require_rest("look is brushed")
    heights = rest @ np.stack([axes[1], np.cross(axes[0], axes[1])]).T  # along the grain; across ends of bars
    vertices, faces = surface.vertices.astype(np.float64), surface.faces
    directions = [_contours(vertices, height, faces) for height in heights.T]
    tangents = _tangents(_mean_tensors(directions, faces, len(vertices)), surface.normals)[faces]
    tangents[:, 1:] *= np.where(np.einsum("fcx,fx->fc", tangents[:, 1:], tangents[:, 0]) < 0, -1.0, 1.0)[
        ..., None
    ]
    slope, end_slope = (np.einsum("fx,fx->f", each, each) for each in directions)
    is_end = slope < END_SLOPE**2 * end_slope
    across = np.where(is_end[:, None], heights[faces, 1], heights[faces, 0])
    corner = faces.reshape(-1)
    split = surface.with_copied_vertices(corner, np.arange(len(corner), dtype=np.int32).reshape(-1, 3))
    return split, tangents.reshape(-1, 3), across.reshape(-1)


def _contours(vertices: Floats, height: Floats, faces: NDArray[np.int32]) -> Floats:
    """Return directions (F, 3) of the faces' contour lines; their squares are weights of the averages."""
    a, b, c = faces.T
    rise_b, rise_c = (height[corner] - height[a] for corner in (b, c))
    edge_b, edge_c = (vertices[corner] - vertices[a] for corner in (b, c))
    return np.asarray(rise_c[:, None] * edge_b - rise_b[:, None] * edge_c)


def _mean_tensors(directions: list[Floats], faces: NDArray[np.int32], count: int) -> Floats:
    """Return the tensors (V, 3, 3) of vertices."""
    clear, end = directions[0], END_SLOPE * directions[1]
    upper, corner = np.triu_indices(3), faces.reshape(-1)
    of_faces = np.stack(
        [clear[:, i] * clear[:, j] + end[:, i] * end[:, j] for i, j in zip(*upper, strict=True)]
    )
    of_vertices = _vertex_sums(of_faces, corner, count)
    for _ in range(_ROUNDS - 1):
        of_vertices = _vertex_sums(of_vertices[:, faces].mean(axis=2), corner, count)
    tensors = np.empty((count, 3, 3))
    tensors[:, upper[0], upper[1]] = tensors[:, upper[1], upper[0]] = of_vertices.T
    return tensors


def _vertex_sums(of_faces: Floats, corner: NDArray[np.int32], count: int) -> Floats:
    """Return the sums (k, V) of numbers of faces (k, F) around vertices."""
    return np.stack([np.bincount(corner, np.repeat(part, 3), count) for part in of_faces])


def _tangents(tensors: Floats, normals: NDArray[np.float32]) -> Floats:
    """Return the unit tangents (V, 3) along which tensors (V, 3, 3) are largest."""
    n = normals.astype(np.float64)
    other = np.eye(3)[np.abs(n).argmin(axis=1)]
    x = np.cross(n, other)
    x /= np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-12)
    y = np.cross(n, x)
    xx, xy, yy = (np.einsum("vi,vij,vj->v", a, tensors, b) for a, b in ((x, x), (x, y), (y, y)))
    angle = (0.5 * np.arctan2(2.0 * xy, xx - yy))[:, None]
    return np.asarray(np.cos(angle) * x + np.sin(angle) * y)
