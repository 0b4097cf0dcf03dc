"""Point-normal triangles: curved patches cut finely for rendering, so that no silhouette shows facets (P37).

Vlachos, Peters, Boyd & Mitchell, *Curved PN Triangles*, Symposium on Interactive 3D Graphics 2001. Each patch
needs its own corners and normals only; its geometry is cubic, its normal quadratic.
"""

from __future__ import annotations

import math

import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices
from pipeline.errors import UsageError
from pipeline.mesh.kernels.pn_triangles import border_controls, fill_edges, fill_faces
from pipeline.mesh.normals import ShadedMesh, twins_of
from pipeline.mesh.triangle_mesh import TriangleMesh

MOST_PIECES = 16


def tessellate(shaded: ShadedMesh, pieces: int) -> ShadedMesh:
    """Return the surface with every triangle bent to a patch and cut into pieces² triangles.

    shaded  a result of `split_at_creases`
    pieces  pieces of every edge; 1 leaves the surface as it is

    The first N vertices are the given ones; a new one has the source vertex of the nearest corner. Face f
    becomes faces pieces² f and the ones after. Patches meet without cracks, bit for bit, also at creases,
    where both sides share a border curve that follows the crease. A flat side with straight edges stays flat.

    Raises UsageError for other numbers of pieces than 1 to 16, and MeshError where the mesh is not an
    oriented manifold.
    """
    if not 1 <= pieces <= MOST_PIECES:
        raise UsageError(f"tessellate {pieces} must be from 1 (off) to {MOST_PIECES} pieces of an edge")
    if pieces == 1 or not len(shaded.faces):
        return shaded
    corners = shaded.faces.reshape(-1).copy()
    twin = twins_of(TriangleMesh(shaded.vertices, shaded.source_vertex[shaded.faces]))
    places, inside = _places(len(shaded.vertices), corners, twin, pieces)
    total = inside + len(shaded.faces) * (pieces - 1) * (pieces - 2) // 2
    points, normals = np.zeros((total, 3)), np.zeros((total, 3))
    points[: len(shaded.vertices)], normals[: len(shaded.vertices)] = shaded.vertices, shaded.normals
    controls = np.empty((2 * len(corners), 3))
    border_controls(points, normals, corners, twin, controls, np.empty(3))
    fill_edges(corners, twin, controls, places, pieces, points, normals)
    fill_faces(corners.reshape(-1, 3), controls, pieces, inside, points, normals)
    grids = _grids(corners, twin, places, pieces, inside)
    cells, nearest = _pattern(pieces)
    source = np.empty(total, np.int32)
    source[grids] = shaded.source_vertex[shaded.faces[:, nearest]]
    source[: len(shaded.vertices)] = shaded.source_vertex
    return ShadedMesh(points, normals, grids[:, cells].reshape(-1, 3).astype(np.int32), source)


def spread(values: AnyArray, shaded: ShadedMesh, fine: ShadedMesh) -> Floats:
    """Interpolate vertex values (V, k) of a mesh linearly to its tessellation, (N, k).

    shaded, fine  the argument and the result of `tessellate`
    """
    corners = values[shaded.source_vertex]
    if fine is shaded or not len(shaded.faces):
        return np.asarray(corners, np.float64)
    pieces = math.isqrt(len(fine.faces) // len(shaded.faces))
    cells, (triangles, _) = _cells(pieces), _pattern(pieces)
    weights = np.column_stack([pieces - cells.sum(axis=1), cells]) / pieces
    _, once = np.unique(triangles, return_index=True)  # where each cell is among the corners of the pieces
    spread = np.empty((len(fine.vertices), values.shape[1]))
    grids = fine.faces.reshape(len(shaded.faces), -1)[:, once]
    spread[grids] = np.einsum("cw,fwk->fck", weights, corners[shaded.faces])
    spread[: len(corners)] = corners
    return spread


def _places(vertices: int, corners: Indices, twin: Indices, pieces: int) -> tuple[Indices, int]:
    """Return the first new vertex of each half-edge (3F,), -1 where its twin makes them; and the end of all.

    Two half-edges share new vertices where their ends are shared: not along a crease, whose sides differ in
    normals.
    """
    half, ends = np.arange(len(corners)), corners.reshape(-1, 3)[:, (1, 2, 0)].reshape(-1)
    shared = (twin >= 0) & (corners == ends[twin]) & (ends == corners[twin])
    makes = ~shared | (half < twin)
    places = np.where(makes, vertices + (pieces - 1) * (np.cumsum(makes) - 1), -1)
    return places.astype(np.int32), vertices + (pieces - 1) * int(makes.sum())


def _grids(corners: Indices, twin: Indices, places: Indices, pieces: int, inside: int) -> AnyArray:
    """Return the vertices of each face's patch, (F, (n + 1)(n + 2) / 2), in the order of `_cells`."""
    faces, n = len(corners) // 3, pieces
    steps = np.arange(n - 1)
    forward = places[:, None] + steps
    backward = places[twin][:, None] + steps[::-1]
    along = np.where(places[:, None] >= 0, forward, backward).reshape(faces, 3, n - 1)
    grid = np.empty((faces, n + 1, n + 1), np.int64)
    grid[:, 0, 0], grid[:, n, 0], grid[:, 0, n] = corners.reshape(-1, 3).T
    k = np.arange(1, n)
    grid[:, k, 0], grid[:, n - k, k], grid[:, 0, n - k] = along[:, 0], along[:, 1], along[:, 2]
    i, j = _cells(n).T
    inner = (i > 0) & (j > 0) & (i + j < n)
    grid[:, i[inner], j[inner]] = inside + np.arange(faces * inner.sum()).reshape(faces, -1)
    return grid[:, i, j]


def _cells(n: int) -> AnyArray:
    """Return steps ((n + 1)(n + 2) / 2, 2) towards the second and the third corner."""
    return np.array([(i, j) for i in range(n + 1) for j in range(n + 1 - i)])


def _pattern(n: int) -> tuple[AnyArray, AnyArray]:
    """Return the triangles of a patch (n², 3) by its cells; and the nearest corner of each cell, 0 to 2."""
    cells = _cells(n)
    at = {(i, j): index for index, (i, j) in enumerate(cells.tolist())}
    triangles = []
    for i, j in at:
        if i + j < n:
            triangles.append((at[i, j], at[i + 1, j], at[i, j + 1]))
        if i + j < n - 1:
            triangles.append((at[i + 1, j], at[i + 1, j + 1], at[i, j + 1]))
    return np.array(triangles), np.argmax(np.column_stack([n - cells.sum(axis=1), cells]), axis=1)
