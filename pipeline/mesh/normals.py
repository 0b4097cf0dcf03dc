"""Normals: of faces, across edges, and of vertices so that a polyhedron looks smooth (Gouraud; P39)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pipeline.arrays import AnyArray, Faces, Floats, Indices, Points, Vectors
from pipeline.errors import MeshError
from pipeline.kernels import readable
from pipeline.mesh.kernels.halfedge import SOUND, match_twins
from pipeline.mesh.kernels.normals import (
    find_hard,
    flag_trusted,
    normals_of_faces,
    number_fans,
    prefer_known,
    scale_known,
    sum_normals,
)
from pipeline.mesh.triangle_mesh import TriangleMesh
from pipeline.mesh.validation import require

NORMAL = "normal"
"""The vertex attribute (V, 3) of normals known from elsewhere, carried through a flow for one: of unit
length, or zero where there is none."""

HARD_ANGLE = math.radians(40)


class ShadedMesh(NamedTuple):
    """A surface as renderers want it: a vertex at a crease appears once for every smooth side.

    vertices       float64 (N, 3), N >= V; the first V are the mesh's own
    normals        float64 (N, 3), unit
    faces          int32 (F, 3) into these vertices, in the mesh's order
    source_vertex  int32 (N,): the vertex of the mesh that each was made from
    """

    vertices: Points
    normals: Vectors
    faces: Faces
    source_vertex: Indices


def face_normals(mesh: TriangleMesh) -> Vectors:
    """(F, 3) unit normals, pointing outwards; zero for a face without area."""
    normals = np.empty((len(mesh.faces), 3))
    normals_of_faces(mesh.vertices, mesh.faces, normals)
    return normals


def dihedral_angles(mesh: TriangleMesh) -> Floats:
    """(3F,) by half-edge ``3f + i``: the angle between the normals of its two faces, radians.

    0 where the surface is flat, pi where it doubles back on itself, nan on a boundary.
    Raises MeshError where the mesh is not an oriented manifold.
    """
    return _turns(face_normals(mesh), twins_of(mesh))


def _turns(normals: Vectors, twin: Indices) -> Floats:
    """`dihedral_angles`, of faces with these normals."""
    mine, theirs = np.repeat(normals, 3, axis=0), normals[twin // 3]
    sine = np.linalg.norm(np.cross(mine, theirs), axis=1)
    angles: Floats = np.arctan2(sine, np.einsum("ij,ij->i", mine, theirs))
    angles[twin < 0] = math.nan
    return angles


def split_at_creases(mesh: TriangleMesh, hard_angle: float | Floats = HARD_ANGLE) -> ShadedMesh:
    """Give every vertex the normal of the smooth surface around it, and one for each side of a crease.

    Edges where the surface turns by more than `hard_angle` (radians; of a (V,) one for each vertex, by the
    mean of both ends) are creases (P29), and so are those that the mesh tags (P31).
    Normals are means of the faces around, weighted by their angle at the vertex (Thürmer & Wüthrich 1998), so
    that the triangulation matters little. A crease that ends within the surface leaves no seam: a closed fan
    is divided by two hard edges or more. Faces without area are ignored; normals are always unit.

    A vertex whose own normal is to be trusted (`trusted_normals`) keeps it and is not divided, however the
    surface turns there: that depends on the triangles, and its normal does not. Where it is not, the smooth
    sides that it does not point into have it nevertheless.

    Raises MeshError where the mesh is not an oriented manifold, or the attribute is not (V, 3).
    """
    face, twin, known = face_normals(mesh), twins_of(mesh), _known(mesh)
    trusted, hard = _trusted(mesh, known, face), _tagged(mesh)
    if not isinstance(hard_angle, float):
        hard |= np.nan_to_num(_turns(face, twin)) > hard_angle[_ends(mesh)].mean(axis=1)
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
    """(V,) bool: at which vertices the attribute `normal` is what the surface should be shaded with.

    Not where it is zero or not finite, at tagged creases, or where it points into one of the faces around: a
    sheet that has become thinner than its triangles has a rim of which they show nothing, and a face that is
    seen must not be shaded with the normal of its back.
    """
    return _trusted(mesh, _known(mesh), face_normals(mesh)).view(bool)


def vertex_normals(mesh: TriangleMesh) -> Vectors:
    """(V, 3) unit normals, one a vertex, smooth over everything; angle-weighted."""
    count = len(mesh.vertices)
    return _smooth(mesh, mesh.faces, face_normals(mesh), np.zeros(count, np.uint8), count)


def _smooth(mesh: TriangleMesh, fans: Faces, face: Vectors, known: AnyArray, count: int) -> Vectors:
    """(count, 3) unit normals of fans (F, 3), but not at vertices whose normal is `known`."""
    smooth = np.empty((count, 3))
    sum_normals(mesh.vertices, mesh.faces, readable(fans, np.int32), face, known, smooth)
    return smooth


def twins_of(mesh: TriangleMesh) -> Indices:
    """(3F,) the half-edge that runs back along the same edge, -1 on a boundary. Raises MeshError."""
    twin = np.empty(mesh.faces.size, np.int32)
    problem, _ = match_twins(mesh.faces.reshape(-1), len(mesh.vertices), twin)
    if problem != SOUND:
        require(mesh)
        raise MeshError("mesh: it is not an oriented manifold")
    return twin


def _tagged(mesh: TriangleMesh) -> AnyArray:
    """(3F,) bool: the half-edges of tagged creases."""
    if not len(mesh.creases):
        return np.zeros(mesh.faces.size, bool)
    at_crease = np.zeros(len(mesh.vertices), bool)
    at_crease[mesh.creases.ravel()] = True
    ends = _ends(mesh)
    near = np.flatnonzero(at_crease[ends].all(axis=1))  # few: the rest need not be looked for
    both = np.sort(ends[near], axis=1).astype(np.int64) @ (1 << 32, 1)
    tagged = np.zeros(mesh.faces.size, bool)
    tagged[near] = np.isin(both, mesh.creases.astype(np.int64) @ (1 << 32, 1))
    return tagged


def _ends(mesh: TriangleMesh) -> Indices:
    """(3F, 2) the two vertices of each half-edge."""
    return np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=2).reshape(-1, 2)


def _known(mesh: TriangleMesh) -> Vectors | None:
    """(V, 3) the unit normals that the mesh brings along, zero where it has none, and at tagged creases; None
    where it brings none at all, or has no faces."""
    if NORMAL not in mesh.attributes or not len(mesh.faces):
        return None
    given, known = readable(mesh.attributes[NORMAL]), np.empty((len(mesh.vertices), 3))
    if given.shape != known.shape:
        raise MeshError(f"attribute {NORMAL!r} has shape {given.shape}; normals must be {known.shape}")
    scale_known(given, known)
    known[mesh.creases.ravel()] = 0.0
    return known


def _trusted(mesh: TriangleMesh, known: Vectors | None, face: Vectors) -> AnyArray:
    """(V,) uint8, see `trusted_normals`."""
    trusted = np.zeros(len(mesh.vertices), np.uint8)
    if known is not None:
        flag_trusted(mesh.faces, face, known, trusted)
    return trusted
