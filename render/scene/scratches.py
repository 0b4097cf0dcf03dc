"""Directions of scratches on a surface: a field of lines, continuous inside each crease patch.

Scratches lie in planes across an axis, the grain, on the undeformed surface, and the deformation carries them
along. On a triangle their direction is a contour line of the corners' coordinate along the grain. Where the
rest surface is nearly perpendicular to the grain, such as on the end of a bar, contour lines have no stable
direction; there scratches are parallel to one fixed direction.

Lines have no sign, so directions d are averaged as tensors d dᵀ (Zhang, Hays and Turk, *Interactive tensor
field design and visualization on surfaces*, 2007): over the triangles around each vertex, several times.
Triangles weigh by the squared gradient of the coordinate, so that those without a clear direction take that
of their neighbours.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from render.scene.surface import Surface

Floats = NDArray[np.float64]

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
