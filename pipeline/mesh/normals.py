"""Normals: of faces, across edges, and of vertices so that a polyhedron looks smooth (Gouraud; P39)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pipeline.arrays import AnyArray, Faces, Floats, Indices, Points, Vectors
from pipeline.errors import MeshError
from pipeline.mesh._kernels_halfedge import SOUND, match_twins
from pipeline.mesh._kernels_normals import face_frames, find_hard, number_fans, sum_normals
from pipeline.mesh.triangles import TriangleMesh
from pipeline.mesh.validate import require

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
    return _frames(mesh)[0]


def dihedral_angles(mesh: TriangleMesh) -> Floats:
    """(3F,) by half-edge ``3f + i``: the angle between the normals of its two faces, radians.

    0 where the surface is flat, pi where it doubles back on itself, nan on a boundary.
    Raises MeshError where the mesh is not an oriented manifold.
    """
    normals, twin = face_normals(mesh), twins_of(mesh)
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

    Raises MeshError where the mesh is not an oriented manifold.
    """
    face, angles = _frames(mesh)
    vert, twin = mesh.faces.reshape(-1).copy(), twins_of(mesh)
    trusted = trusted_normals(mesh, face)
    hard = _tagged(mesh)
    if not isinstance(hard_angle, float):
        hard |= np.nan_to_num(dihedral_angles(mesh)) > hard_angle[_ends(mesh)].mean(axis=1)
        hard_angle = math.pi
    find_hard(face, twin, math.cos(hard_angle), hard.view(np.uint8))
    corner, source = np.empty(len(vert), np.int32), np.empty(len(mesh.vertices) + len(vert), np.int32)
    count = number_fans(vert, twin, hard.view(np.uint8), trusted.view(np.uint8), corner, source)
    faces, source = corner.reshape(-1, 3), source[:count].copy()
    smooth = np.empty((count, 3))
    sum_normals(faces, face, angles, smooth)
    if NORMAL in mesh.attributes:
        own = _known(mesh)[source]
        agreeing = np.einsum("ij,ij->i", own, smooth) > 0
        smooth[agreeing] = own[agreeing]
    return ShadedMesh(mesh.vertices[source], smooth, faces, source)


def trusted_normals(mesh: TriangleMesh, face: Vectors | None = None) -> AnyArray:
    """(V,) bool: at which vertices the attribute `normal` is what the surface should be shaded with.

    face  the normals of its faces, where they are known

    Not where it is zero or not finite, at tagged creases, or where it points into one of the faces around: a
    sheet that has become thinner than its triangles has a rim of which they show nothing, and a face that is
    seen must not be shaded with the normal of its back.
    """
    if NORMAL not in mesh.attributes or not len(mesh.faces):
        return np.zeros(len(mesh.vertices), bool)
    own, face = _known(mesh), face_normals(mesh) if face is None else face
    behind = (np.einsum("fik,fk->fi", own[mesh.faces], face) <= 0) & face.any(axis=1, keepdims=True)
    trusted: AnyArray = np.linalg.norm(own, axis=1) > 0
    trusted[mesh.faces[behind]] = False
    return trusted


def vertex_normals(mesh: TriangleMesh) -> Vectors:
    """(V, 3) unit normals, one a vertex, smooth over everything; angle-weighted."""
    normals, angles = _frames(mesh)
    smooth = np.empty((len(mesh.vertices), 3))
    sum_normals(_own(mesh.faces), normals, angles, smooth)
    return smooth


def _frames(mesh: TriangleMesh) -> tuple[Vectors, Floats]:
    normals, angles = np.empty((len(mesh.faces), 3)), np.empty((len(mesh.faces), 3))
    face_frames(_own(mesh.vertices), _own(mesh.faces), normals, angles)
    return normals, angles


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


def _known(mesh: TriangleMesh) -> Vectors:
    """(V, 3) the unit normals that the mesh brings along; zero where it has none, and at tagged creases."""
    given = mesh.attributes[NORMAL].astype(np.float64)
    with np.errstate(invalid="ignore", over="ignore"):
        lengths = np.linalg.norm(given, axis=1, keepdims=True)
        good = (lengths > 0) & np.isfinite(lengths)
        known: Vectors = np.divide(given, lengths, out=np.zeros_like(given), where=good)
    known[mesh.creases.ravel()] = 0.0
    return known


def _own(array: AnyArray) -> AnyArray:
    """A writable copy, as compiled kernels declare their arguments."""
    return np.array(array)
