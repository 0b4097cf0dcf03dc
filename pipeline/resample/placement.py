"""Where new vertices go: on the chord, on a curve through their surroundings, or on the exact surface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pipeline.arrays import Floats, Indices, Points, Vectors
from pipeline.errors import FrameError
from pipeline.mesh._kernels_halfedge import Surface
from pipeline.mesh.halfedge import HalfedgeMesh
from pipeline.mesh.triangles import TriangleMesh
from pipeline.resample._kernels_place import curved_middles, settle
from pipeline.resample._kernels_ring import new_ring
from pipeline.resample.hardness import edges_by_angle

REST, NORMAL = "rest", "normal"
"""Vertex attributes that `Exact` keeps: where a vertex lies on the undeformed surface, and its normal now."""

PointMap = Callable[[Points], Points]

_ONLY_TAGGED = -1.0  # the cosine that makes no edge hard by its angle
_TANGENT = 1e-5  # how far tangent points lie from theirs, in edge lengths at rest


class Placement(Protocol):
    """How splits place their new vertices and whether collapses may leave the old ones."""

    @property
    def merges_at_midpoint(self) -> bool:
        """Whether two soft ends merge halfway (P27) or at one of them."""

    def prepare(self, mesh: TriangleMesh, hard_angle: float | Floats) -> TriangleMesh:
        """The mesh with all that this placement keeps at its vertices and edges.

        hard_angle  radians, one for all or one a vertex
        """

    def place(self, mesh: HalfedgeMesh, births: Indices, cosine: float) -> int:
        """Move the last vertices of the mesh, which lie halfway between their parents; answers how many
        had to stay there.

        births  (N, 4) of each: its parents a and b, the half-edges a→vertex and vertex→b
        cosine  of the hard angle

        Called once after each pass of splits, with all its new vertices together.
        """


@dataclass(frozen=True)
class Chord:
    """Where the paper has them: at the middle of the edge (P25, P27)."""

    merges_at_midpoint: bool = True

    def prepare(self, mesh: TriangleMesh, hard_angle: float | Floats) -> TriangleMesh:
        return mesh

    def place(self, mesh: HalfedgeMesh, births: Indices, cosine: float) -> int:
        """They are there already."""
        return 0


@dataclass(frozen=True)
class Curved:
    """On a curved patch over the edge, which ends at creases (P37); for surfaces whose flow is not known."""

    merges_at_midpoint: bool = False

    def prepare(self, mesh: TriangleMesh, hard_angle: float | Floats) -> TriangleMesh:
        return mesh

    def place(self, mesh: HalfedgeMesh, births: Indices, cosine: float) -> int:
        places, _ = _curved(mesh.surface, births, cosine)
        return _settled(mesh, births, places)


@dataclass(frozen=True)
class Exact:
    """On the exact surface: put on the surface at rest, and carried along to now.

    carry    `rest_points (N, 3) -> (N, 3)`, where they are now; called at most once a pass, with all the
             new points together
    project  `rest_points (N, 3) -> (N, 3)`, the nearest points of the true surface at rest, where it is
             known; without it new rest points lie on curved patches over the mesh at rest

    The mesh that a `Resampler` is given is the surface at rest, and its hard edges (by their angle there)
    stay creases for ever. Collapses keep an end, for midpoints would leave the surface. Where the mesh has
    a `normal` at each vertex, a new vertex gets its own exactly, from two points carried along beside it;
    at creases it is zero, since there are several.
    """

    carry: PointMap
    project: PointMap | None = None
    merges_at_midpoint: bool = False

    def prepare(self, mesh: TriangleMesh, hard_angle: float | Floats) -> TriangleMesh:
        creases = np.concatenate([mesh.creases, edges_by_angle(mesh, hard_angle)])
        rest = mesh.attributes.get(REST, mesh.vertices)
        return mesh.with_attributes(**{REST: rest}).with_creases(creases)

    def place(self, mesh: HalfedgeMesh, births: Indices, cosine: float) -> int:
        first, column, turning = int(mesh.sizes[0]) - len(births), mesh.column(REST), mesh.column(NORMAL)
        if column is None:
            raise FrameError(f"the surface has no vertex attribute {REST!r}; exact placement needs it")
        rest = mesh.surface.carried[: mesh.sizes[0], column : column + 3]
        born, normals = rest[first:], None
        if self.project is None or turning is not None or mesh.surface.tagged.any():
            at_rest = mesh.surface._replace(points=np.ascontiguousarray(rest))
            born, normals = _curved(at_rest, births, _ONLY_TAGGED)
        truly = self.project or _as_it_is
        rest[first:] = truly(born)
        if turning is None or normals is None:
            return _settled(mesh, births, self._carried(rest[first:]))
        along = rest[births[:, 1]] - rest[births[:, 0]]
        soft = normals.any(axis=1)
        one, two = _tangents(along[soft], normals[soft])
        asked = [rest[first:], truly(rest[first:][soft] + one), truly(rest[first:][soft] + two)]
        places, ahead, beside = np.split(
            self._carried(np.concatenate(asked)), np.cumsum([len(p) for p in asked])[:2]
        )
        kept = mesh.surface.carried[first : mesh.sizes[0], turning : turning + 3]
        kept[:] = 0.0
        kept[soft] = _unit(np.cross(ahead - places[soft], beside - places[soft]))
        return _settled(mesh, births, places)

    def _carried(self, rest_points: Points) -> Points:
        moved = np.array(self.carry(np.ascontiguousarray(rest_points)), dtype=np.float64)
        if moved.shape != rest_points.shape or not np.isfinite(moved).all():
            raise FrameError(
                f"carry returned an array of shape {moved.shape} for {len(rest_points)} points at rest, or "
                "numbers that are not finite; it must say where each of them is now"
            )
        return moved


def _as_it_is(points: Points) -> Points:
    return points


def _curved(surface: Surface, births: Indices, cosine: float) -> tuple[Points, Vectors]:
    """Places (N, 3) on curved patches, and normals there, zero on creases."""
    places, normals = np.empty((len(births), 3)), np.empty((len(births), 3))
    curved_middles(surface, births, cosine, np.empty(6), places, normals)
    return places, normals


def _settled(mesh: HalfedgeMesh, births: Indices, places: Points) -> int:
    settled = np.zeros(len(births), np.uint8)
    return len(births) - int(settle(mesh.surface, births, new_ring(), places, settled))


def _tangents(along: Vectors, normals: Vectors) -> tuple[Vectors, Vectors]:
    """Two short steps within the surface from each point, to the left of `along` the second."""
    across = np.cross(normals, along)
    return _TANGENT * np.cross(across, normals), _TANGENT * across


def _unit(vectors: Vectors) -> Vectors:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    unit: Vectors = np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0)
    return unit
