"""Normals: of faces, of vertices split at creases (Gouraud; P39), and carried through a flow.

Point-normal triangles are curved patches over them, cut finely for rendering, so that no silhouette shows
facets (P37): Vlachos, Peters, Boyd & Mitchell, *Curved PN Triangles*, Symposium on Interactive 3D Graphics
2001. Each patch needs its own corners and normals only; its geometry is cubic, its normal quadratic.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Faces, Floats, Indices, Points, Vectors
from flowsculpt.pipeline.errors import MeshError, UsageError
from flowsculpt.pipeline.kernels import readable
from flowsculpt.pipeline.mesh.kernels.halfedge import SOUND, match_twins
from flowsculpt.pipeline.mesh.kernels.normal_kernels import (
    count_known,
    cross_beside,
    cut_faces,
    fill_edges,
    fill_faces,
    find_hard,
    flag_trusted,
    longest_side,
    number_edges,
    number_fans,
    place_beside,
    prefer_known,
    scale_known,
    spread_values,
    sum_normals,
)
from flowsculpt.pipeline.mesh.meshes import TriangleMesh, edge_keys
from flowsculpt.pipeline.mesh.validation import validate

NORMAL = "normal"
"""Vertex attribute (V, 3): known normals, carried through a flow for example; unit, or zero where unknown."""

HARD_ANGLE = math.radians(40)

_FACES_TOGETHER = 1 << 16  # faces whose angles to their neighbours are computed together


class ShadedMesh(NamedTuple):
    """A surface as renderers take it: a vertex at a crease appears once for every smooth side.

    vertices       float64 (N, 3), N >= V; the first V are the mesh's own
    normals        float64 (N, 3), unit
    faces          int32 (F, 3) into these vertices, in the mesh's order
    source_vertex  int32 (N,): the vertex of the mesh that each was made from
    """

    vertices: Points
    normals: Vectors
    faces: Faces
    source_vertex: Indices


def dihedral_angles(mesh: TriangleMesh) -> Floats:
    """Return the angle between the normals of the two faces at each half-edge ``3f + i``, (3F,), radians.

    0 where the surface is flat, pi where it doubles back on itself, nan on a boundary.
    Raises MeshError where the mesh is not an oriented manifold.
    """
    return _turns(mesh.face_normals, twins_of(mesh))


def _turns(normals: Vectors, twin: Indices) -> Floats:
    """Return the angles (3F,) across half-edges, computed by blocks, which takes less memory."""
    turns = np.empty(len(twin))
    for first in range(0, len(twin), 3 * _FACES_TOGETHER):
        block = slice(first, first + 3 * _FACES_TOGETHER)
        mine = np.repeat(normals[first // 3 : first // 3 + _FACES_TOGETHER], 3, axis=0)
        turns[block] = angles_between(mine, normals[twin[block] // 3], twin[block])
    return turns


def angles_between(mine: Vectors, theirs: Vectors, twin: AnyArray) -> Floats:
    """Return the angles (N,) between unit normals (N, 3), radians; nan where `twin` is negative."""
    sine = np.linalg.norm(np.cross(mine, theirs), axis=1)
    angles: Floats = np.arctan2(sine, np.einsum("ij,ij->i", mine, theirs))
    angles[twin < 0] = math.nan
    return angles


def split_at_creases(
    mesh: TriangleMesh, hard_angle: float | Floats = HARD_ANGLE, twin: Indices | None = None
) -> ShadedMesh:
    """Give every vertex the normal of the smooth surface around it, and one for each side of a crease.

    Creases are edges where the surface turns by more than `hard_angle` (radians; if (V,), the mean of both
    ends; P29), and edges that the mesh tags (P31). Normals are means over the surrounding faces, weighted by
    their angle at the vertex (Thürmer & Wüthrich 1998), so that they depend little on the triangulation. A
    crease that ends within the surface leaves no seam: it takes two hard edges to divide a closed fan. Faces
    without area are ignored; normals are always unit.

    A vertex with a trusted normal (`trusted_normals`) keeps it and is not divided, however its faces turn.
    Other known normals replace those of the smooth sides that they agree with.

    twin  (3F,) of the mesh, by `twins_of`, if it is known

    Raises MeshError where the mesh is not an oriented manifold, or the attribute is not (V, 3).
    """
    twin = twins_of(mesh) if twin is None else twin
    face, known = mesh.face_normals, _known(mesh)
    trusted, hard = _trusted(mesh, known, face), tagged_halfedges(mesh, mesh.creases)
    if not isinstance(hard_angle, float):
        hard |= np.nan_to_num(_turns(face, twin)) > hard_angle[mesh.halfedge_ends].mean(axis=1)
        hard_angle = math.pi
    find_hard(face, twin, math.cos(hard_angle), hard.view(np.uint8))
    corner, source = np.empty(mesh.faces.size, np.int32), np.empty(len(mesh.vertices) + len(twin), np.int32)
    count = number_fans(mesh.faces.reshape(-1), twin, hard.view(np.uint8), trusted, corner, source)
    faces, source = corner.reshape(-1, 3), source[:count].copy()
    smooth = _smooth(mesh, faces, face, trusted, count)
    if known is not None:
        prefer_known(known, trusted, source, smooth)
    return ShadedMesh(mesh.vertices[source], smooth, faces, source)


def trusted_normals(mesh: TriangleMesh) -> AnyArray:
    """Return flags (V,) of the vertices to be shaded with their attribute `normal`.

    A normal is not trusted where it is zero or not finite, at tagged creases, or far from that of a
    surrounding face (`AGREEMENT`). A sheet thinner than its triangles has a rim that they do not show, and a
    visible face must not be shaded with the normal of its back or of the rim.
    """
    return _trusted(mesh, _known(mesh), mesh.face_normals).view(bool)


def vertex_normals(mesh: TriangleMesh, corners: Faces | None = None) -> Vectors:
    """Return unit normals (V, 3), one a vertex, smooth everywhere; angle-weighted.

    corners  (F, 3) as `split_at_creases` has numbered them before the mesh was moved. Then there is a normal
             (N, 3) for each number, and the attribute `normal` gives the first V where it is trusted.
    """
    count = len(mesh.vertices) if corners is None else int(corners.max()) + 1
    normals = _smooth(mesh, mesh.faces if corners is None else corners, mesh.face_normals, None, count)
    if corners is not None and NORMAL in mesh.attributes:
        trusted = np.flatnonzero(trusted_normals(mesh))
        normals[trusted] = mesh.attributes[NORMAL][trusted]
    return normals


def _smooth(mesh: TriangleMesh, fans: Faces, face: Vectors, known: AnyArray | None, count: int) -> Vectors:
    """Return unit normals (count, 3) of fans (F, 3), except at vertices (V,) whose normal is `known`."""
    smooth = np.empty((count, 3))
    known = np.zeros(len(mesh.vertices), np.uint8) if known is None else known
    sum_normals(mesh.vertices, mesh.faces, readable(fans, np.int32), face, known, smooth)
    return smooth


def twins_of(mesh: TriangleMesh) -> Indices:
    """Return the half-edge that runs back along the same edge, (3F,), -1 on a boundary. Raises MeshError."""
    twin = np.empty(mesh.faces.size, np.int32)
    problem, _ = match_twins(mesh.faces.reshape(-1), len(mesh.vertices), twin)
    if problem != SOUND:
        validate(mesh).require()
        raise MeshError("mesh: it is not an oriented manifold")
    return twin


def tagged_halfedges(mesh: TriangleMesh, edges: Indices) -> AnyArray:
    """Return flags (3F,) of the half-edges of edges (K, 2), which are the mesh's creases or seams."""
    if not len(edges):
        return np.zeros(mesh.faces.size, bool)
    at_edge = np.zeros(len(mesh.vertices), bool)
    at_edge[edges.ravel()] = True
    corners = at_edge[mesh.faces]
    near = np.flatnonzero(corners & np.roll(corners, -1, axis=1))
    tagged = np.zeros(mesh.faces.size, bool)
    tagged[near] = np.isin(edge_keys(mesh.ends_of(near)), edge_keys(edges))
    return tagged


def _known(mesh: TriangleMesh) -> Vectors | None:
    """Return the unit normals (V, 3) of the mesh's attribute; zero where there is none and at tagged creases.

    None if the mesh has no such attribute or no faces.
    """
    if NORMAL not in mesh.attributes or not len(mesh.faces):
        return None
    given, known = readable(mesh.attributes[NORMAL]), np.empty((len(mesh.vertices), 3))
    if given.shape != known.shape:
        raise MeshError(f"attribute {NORMAL!r} has shape {given.shape}; normals must be {known.shape}")
    scale_known(given, known)
    known[mesh.creases.ravel()] = 0.0
    return known


def _trusted(mesh: TriangleMesh, known: Vectors | None, face: Vectors) -> AnyArray:
    """Return `trusted_normals` as uint8 (V,)."""
    trusted = np.zeros(len(mesh.vertices), np.uint8)
    if known is not None:
        flag_trusted(mesh.faces, face, known, trusted)
    return trusted


STEP = 1e-7
"""Distance of tangent points from their vertex, in sizes of the surface.

A one-sided difference errs by about STEP (truncation) + 2e-16 / STEP (rounding), least near 1.5e-8; a little
more allows for a surface off the origin. A frame then turns a normal by a millionth of a degree too much
(docs/normals.md); two-sided differences would cost twice as many points.
"""


def carried_normals(
    move: Callable[[Points], Points],
    points: Points,
    moved: Points,
    normals: Vectors,
    apart: Floats | None = None,
) -> Vectors:
    """Return unit normals (V, 3) of a surface after a flow has moved it.

    move     the flow over the step: points (N, 3) to their new positions; called once, with at most 2V points
    points   (V, 3) vertices before the step
    moved    (V, 3) the same vertices after it
    normals  (V, 3) unit normals before it; zero where there is none, which stays so
    apart    (V,) distance of tangent points from their vertex; by default STEP sizes of the surface

    A vertex whose ring the flow has collapsed to a line gets zero: it has no normal any more.
    """
    if not count_known(readable(normals)):
        return np.zeros((len(normals), 3))
    if apart is None:
        apart = np.full(len(points), tangent_distance(points))
    return normals_from_tangents(normals, moved, move(tangent_points(points, normals, apart)))


def normals_from_tangents(normals: Vectors, moved: Points, beside: Points) -> Vectors:
    """Return unit normals (V, 3), given where a flow has moved vertices and their tangent points.

    normals  (V, 3) unit normals before, as `tangent_points` took them; where zero, the result is zero
    moved    (V, 3) the vertices now
    beside   (2K, 3) the points of `tangent_points` now
    """
    carried = np.zeros((len(normals), 3))
    cross_beside(readable(normals), readable(moved), readable(beside), carried)
    return carried


def tangent_distance(points: Points) -> float:
    """Return the distance of tangent points from the vertices (V, 3) of a surface: STEP of its size."""
    return STEP * float(longest_side(readable(points))) if len(points) else 0.0


def tangents(normals: Vectors) -> tuple[Vectors, Vectors]:
    """Return two unit vectors (N, 3) each, with t₁ × t₂ = n, for unit normals (N, 3)."""
    beside = tangent_points(np.zeros((len(normals), 3)), normals, np.ones(len(normals)))
    return beside[: len(beside) // 2], beside[len(beside) // 2 :]


def tangent_points(points: Points, normals: Vectors, apart: Floats) -> Points:
    """Return tangent points (2K, 3) of the K vertices with a normal: first all along one tangent.

    normals  (V, 3) unit, or zero where there is none
    apart    (V,) their distance from their vertex
    """
    known = readable(normals)
    beside = np.empty((2 * count_known(known), 3))
    place_beside(readable(points), known, readable(apart), beside)
    return beside


def unit(vectors: Vectors, otherwise: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Vectors:
    """Return vectors (N, 3) of length 1; `otherwise` for those without a length, or not finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        lengths: Floats = np.linalg.norm(vectors, axis=1, keepdims=True)
        good = (lengths > 0) & np.isfinite(lengths)
        scaled: Vectors = np.divide(vectors, lengths, out=np.tile(otherwise, (len(vectors), 1)), where=good)
    return scaled


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


def spread_curved(values: AnyArray, shaded: ShadedMesh, fine: ShadedMesh) -> Floats:
    """Interpolate smooth values (N, k) of the vertices of a shaded mesh to its tessellation along curves.

    shaded, fine  the argument and the result of `tessellate`

    On each face the values are a cubic Bézier triangle: along an edge they leave a vertex as the linear map
    does that fits its neighbours best, and the middle is that of point-normal triangles. Linear values are
    exact, and so are those at vertices.
    """
    if fine is shaded or not len(shaded.faces):
        return np.asarray(values, np.float64)
    pieces = math.isqrt(len(fine.faces) // len(shaded.faces))
    grid = [(i, j) for i in range(pieces + 1) for j in range(pieces + 1 - i)]
    number = {place: k for k, place in enumerate(grid)}
    cut = []
    for i, j in (place for place in grid if sum(place) < pieces):  # in the order of `cut_faces`
        cut.append([number[i, j], number[i + 1, j], number[i, j + 1]])
        if i + j < pieces - 1:
            cut.append([number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]])
    _, first = np.unique(np.array(cut).ravel(), return_index=True)  # a corner at each place of the grid
    y, z = np.array(grid).T / pieces
    x = 1.0 - y - z
    weights = [x**3, y**3, z**3, x * x * y, x * y * y, y * y * z, y * z * z, z * z * x, z * x * x, x * y * z]
    weights[3:] = [3.0 * weight for weight in weights[3:9]] + [6.0 * weights[9]]
    spread: Floats = np.empty((len(fine.vertices), values.shape[1]))
    vertices = fine.faces.reshape(len(shaded.faces), -1)[:, first]
    spread[vertices] = np.einsum("pw,wfk->fpk", np.stack(weights, axis=1), _bezier_values(values, shaded))
    return spread


def _bezier_values(values: AnyArray, shaded: ShadedMesh) -> Floats:
    """Return the control values (10, F, k) of faces: of corners, two along each edge, and of the middle."""
    ends = values[shaded.faces].astype(np.float64).transpose(1, 0, 2)
    slopes, borders = _slopes(values, shaded), []
    for start, end in ((0, 1), (1, 2), (2, 0)):
        edge = shaded.vertices[shaded.faces[:, end]] - shaded.vertices[shaded.faces[:, start]]
        rise = ends[end] - ends[start]
        for corner, sign in ((start, 1.0), (end, -1.0)):
            off = sign * np.einsum("fkx,fx->fk", slopes[shaded.faces[:, corner]], edge) - sign * rise
            size, most = (np.linalg.norm(part, axis=1, keepdims=True) for part in (off, rise))
            off *= np.minimum(1.0, most / np.maximum(size, 1e-300))  # no fold where neighbours fit badly
            borders.append(ends[corner] + (sign * rise + off) / 3.0)
    middle = np.mean(borders, axis=0)
    return np.stack([*ends, *borders, middle + 0.5 * (middle - ends.mean(axis=0))])


def _slopes(values: AnyArray, shaded: ShadedMesh) -> Floats:
    """Return the derivatives (N, k, 3) of values at vertices: the least squares over the edges of faces."""
    count, faces = len(shaded.vertices), shaded.faces
    start, end = (
        np.concatenate([faces[:, i] for i in order]) for order in ((0, 1, 2, 1, 2, 0), (1, 2, 0, 0, 1, 2))
    )
    edge, rise = (
        shaded.vertices[end] - shaded.vertices[start],
        (values[end] - values[start]).astype(np.float64),
    )
    weight = 1.0 / np.maximum(np.einsum("ex,ex->e", edge, edge), 1e-300)
    products = np.concatenate([edge, rise], axis=1)[:, :, None] * edge[:, None] * weight[:, None, None]
    sums = [np.bincount(start, part, count) for part in products.reshape(len(start), -1).T]
    fitted = np.stack(sums, axis=1).reshape(count, -1, 3)
    normals = shaded.normals[:, :, None] * shaded.normals[:, None]
    square = (
        fitted[:, :3] + normals * np.maximum(np.trace(fitted[:, :3], axis1=1, axis2=2), 1e-12)[:, None, None]
    )
    return np.asarray(
        np.linalg.solve(square + 1e-9 * np.eye(3), fitted[:, 3:].transpose(0, 2, 1)).transpose(0, 2, 1)
    )
