"""Point-normal triangles: curved patches cut finely for rendering, so that no silhouette shows facets (P37).

Vlachos, Peters, Boyd & Mitchell, *Curved PN Triangles*, Symposium on Interactive 3D Graphics 2001. Each patch
needs its own corners and normals only; its geometry is cubic, its normal quadratic.
"""

from __future__ import annotations

import math

import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices
from pipeline.errors import UsageError
from pipeline.kernels import readable
from pipeline.mesh.kernels.normal_kernels import scale_known
from pipeline.mesh.kernels.pn_triangle_kernels import (
    cut_faces,
    fill_edges,
    fill_faces,
    number_edges,
    spread_values,
)
from pipeline.mesh.normals import ShadedMesh, twins_of
from pipeline.mesh.triangle_mesh import TriangleMesh

MOST_PIECES = 16


def tessellate(shaded: ShadedMesh, pieces: int, twin: Indices | None = None) -> ShadedMesh:
    """Return the surface with every triangle bent to a patch and cut into pieces² triangles.

    shaded  a result of `split_at_creases`
    pieces  pieces of every edge; 1 leaves the surface as it is
    twin    (3F,) of the mesh, by `twins_of`, if it is known

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
    corners, known = shaded.faces.reshape(-1).copy(), len(shaded.vertices)
    if twin is None:
        twin = twins_of(TriangleMesh(shaded.vertices, shaded.source_vertex[shaded.faces]))
    places = np.empty(len(corners), np.int32)
    inside = number_edges(corners, twin, known, pieces, places)
    total = inside + len(shaded.faces) * (pieces - 1) * (pieces - 2) // 2
    points, normals, source = np.empty((total, 3)), np.empty((total, 3)), np.empty(total, np.int32)
    points[:known], normals[:known], source[:known] = shaded.vertices, shaded.normals, shaded.source_vertex
    axes = np.empty((known, 3))
    scale_known(readable(2.0 * shaded.normals), axes)
    fill_edges(corners, twin, axes, places, pieces, points, normals)
    fill_faces(corners, twin, axes, pieces, inside, points, normals)
    cut = np.empty((pieces**2 * len(shaded.faces), 3), np.int32)
    grid = np.empty((pieces + 1, pieces + 1), np.int32)
    cut_faces(corners, twin, places, pieces, inside, source, grid, cut)
    return ShadedMesh(points, normals, cut, source)


def spread(values: AnyArray, shaded: ShadedMesh, fine: ShadedMesh) -> Floats:
    """Interpolate vertex values (V, k) of a mesh linearly to its tessellation, (N, k).

    shaded, fine  the argument and the result of `tessellate`
    """
    corners = values[shaded.source_vertex]
    if fine is shaded or not len(shaded.faces):
        return np.asarray(corners, np.float64)
    pieces = math.isqrt(len(fine.faces) // len(shaded.faces))
    spread = np.empty((len(fine.vertices), values.shape[1]))
    spread[: len(corners)] = corners
    faces, cut = readable(shaded.faces, np.int32), readable(fine.faces, np.int32)
    spread_values(faces, cut, pieces, readable(shaded.source_vertex, np.int32), readable(values), spread)
    return spread
