"""Normals where a surface has slivers: these turn by any angle, without a crease of the surface.

Marching cubes makes slivers, and faces much smaller than those around them, wherever the surface passes near
a node of its grid. Their edges look hard, in other places in each frame, so highlights flicker. An edge of a
sliver is a crease if the faces on its two long sides turn from each other.
"""

from __future__ import annotations

import math

import numpy as np

from flowsculpt import PolygonMesh
from flowsculpt.api.meshes import Floats, Indices, edge_keys

THIN = 0.08
"""The height of a triangle over its longest side below which it is a sliver."""

SMALL = 1 / 32
"""The area of a triangle over that of the largest one that touches it below which it counts as a sliver."""

TURN = math.radians(40)
"""The angle of two faces from which on the edge between them is a crease: the usual hard angle."""

MOST_CROSSED = 4
"""Slivers next to each other that are looked across."""


def sliver_normals(mesh: PolygonMesh) -> Floats | None:
    """Return unit normals (V, 3) of vertices of slivers where the surface has no crease, zero elsewhere.

    They are means over the other faces, weighted by area: the other faces at slivers are small ones, too,
    whose normals are poor. None where the mesh has no slivers, or faces of more sides.
    """
    if len(mesh.corners) != 3 * (len(mesh.offsets) - 1) or not len(mesh.corners):
        return None
    faces = mesh.corners.reshape(-1, 3)
    corners = mesh.vertices[faces]
    sides = np.roll(corners, -1, axis=1) - corners
    crosses, lengths = np.cross(sides[:, 0], sides[:, 1]), np.linalg.norm(sides, axis=2)
    areas, longest = np.linalg.norm(crosses, axis=1), lengths.max(axis=1)
    largest = np.zeros(len(mesh.vertices))
    for corner in faces.T:
        np.maximum.at(largest, corner, areas)
    is_thin = (areas < THIN * longest**2) | (areas < SMALL * largest[faces].max(axis=1))
    if not is_thin.any():
        return None
    is_near = np.zeros(len(mesh.vertices), bool)
    is_near[faces[is_thin]] = True
    near = np.flatnonzero(is_near[faces].any(axis=1))
    faces, crosses, is_thin = faces[near], crosses[near], is_thin[near]
    is_crease = np.zeros(len(mesh.vertices), bool)
    is_crease[_creases(faces, crosses, lengths[near], is_thin)] = True
    normals = np.zeros_like(mesh.vertices)
    for corner in faces[~is_thin].T:
        np.add.at(normals, corner, crosses[~is_thin])
    normals[~is_near | is_crease] = 0.0
    sizes = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.where(sizes > 0.0, sizes, 1.0))


def _creases(faces: Indices, crosses: Floats, lengths: Floats, is_thin: np.ndarray) -> Indices:
    """Return the ends (K, 2) of edges across which the surface turns, slivers left out."""
    twin = _twins(faces)
    start = np.flatnonzero(~np.repeat(is_thin, 3))
    side = twin[start]
    for _ in range(MOST_CROSSED):
        thin = np.flatnonzero((side >= 0) & is_thin[side // 3])
        face, entered = np.divmod(side[thin], 3)
        other = lengths[face]
        other[np.arange(len(face)), entered] = -1.0
        side[thin] = twin[3 * face + other.argmax(axis=1)]
    start, side = start[side >= 0], side[side >= 0]
    one, two = crosses[start // 3], crosses[side // 3]
    cosine = np.einsum("ij,ij->i", one, two)
    limit = math.cos(TURN) * np.linalg.norm(one, axis=1) * np.linalg.norm(two, axis=1)
    face, corner = np.divmod(start[(cosine < limit) & ~is_thin[side // 3]], 3)
    return np.stack([faces[face, corner], faces[face, (corner + 1) % 3]], axis=1)


def _twins(faces: Indices) -> np.ndarray:
    """Return the other half-edge (3F,) of each edge; -1 where there is none."""
    keys = edge_keys(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2))
    order, twin = np.argsort(keys, kind="stable"), np.full(len(keys), -1)
    first = np.flatnonzero(keys[order[1:]] == keys[order[:-1]])
    twin[order[first]], twin[order[first + 1]] = order[first + 1], order[first]
    return twin
