"""Exact placement: the flow is known, so the surface is known everywhere and not only at its vertices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices, Points, Vectors
from pipeline.errors import FrameError
from pipeline.mesh.halfedge import HalfedgeMesh
from pipeline.mesh.triangles import TriangleMesh
from pipeline.resample._kernels_lists import Changes
from pipeline.resample._kernels_place import BIRTH, LEAVING
from pipeline.resample._kernels_ring import new_ring
from pipeline.resample._kernels_shape import adopt, relaxed
from pipeline.resample.hardness import edges_by_angle
from pipeline.resample.placement import on_patches, settled

REST, NORMAL, ASTRAY = "rest", "normal", "astray"
"""Vertex attributes that `Exact` keeps: where a vertex lies on the undeformed surface, its normal now, and
whether it had to be left off the surface."""

PointMap = Callable[[Points], Points]

_ONLY_TAGGED = -1.0  # the cosine that makes no edge hard by its angle
_TANGENT = 1e-5  # how far tangent points lie from theirs, in edge lengths at rest
_ELSEWHERE = np.array([1, 2, 4, 6, 10, 12, 14, 15]) / 16  # along an edge at rest whose middle folds


@dataclass(frozen=True)
class Exact:
    """On the exact surface: put on the surface at rest, and carried along to now.

    carry         `rest_points (N, 3) -> (N, 3)`, where they are now; called once a pass with all the new
                  points together, and once more for the few that would fold
    project       `rest_points (N, 3) -> (N, 3)`, the nearest points of the true surface at rest, where it
                  is known; without it new rest points lie on curved patches over the mesh at rest
    tags_creases  whether edges that are hard at rest, by their angle, stay creases whatever becomes of them

    The mesh that a `Resampler` is given is the surface at rest. Collapses keep an end, for midpoints would
    leave the surface. Where the mesh has a `normal` at each vertex, a new vertex gets its own exactly, from
    two points carried along beside it; at creases it is zero, since there are several.
    """

    carry: PointMap
    project: PointMap | None = None
    tags_creases: bool = True
    leaves_chord: bool = True
    merges_at_midpoint: bool = False
    knows_surroundings: bool = True

    def prepare(self, mesh: TriangleMesh, hard_angle: float | Floats) -> TriangleMesh:
        rest = mesh.attributes.get(REST, mesh.vertices)
        if self.tags_creases:
            mesh = mesh.with_creases(np.concatenate([mesh.creases, edges_by_angle(mesh, hard_angle)]))
        return mesh.with_attributes(**{REST: rest, ASTRAY: np.zeros(len(rest), np.uint8)})

    def place(self, mesh: HalfedgeMesh, births: Indices, cosine: float) -> int:
        last = int(mesh.sizes[0])
        born = np.arange(last - len(births), last, dtype=np.int32)
        rest, chord = _rest(mesh), mesh.vertices[born].copy()
        middles, normals = rest[born], None
        if self.project is None or mesh.column(NORMAL) is not None or mesh.surface.tagged.any():
            at_rest = mesh.surface._replace(points=np.ascontiguousarray(rest))
            middles, normals = on_patches(at_rest, births, _ONLY_TAGGED)
        rest[born] = self._truly(middles)
        along = rest[births[:, 1]] - rest[births[:, 0]]
        places, turned = self._now(mesh, rest[born], normals, along)
        _write(mesh, NORMAL, born, turned)
        went = settled(mesh, births, places)
        if not went.all():
            went[~went] = self._elsewhere(mesh, births[~went], born[~went], chord[~went])
        _write(mesh, ASTRAY, born, ~went[:, None])
        return len(births) - int(went.sum())

    def heal(self, mesh: HalfedgeMesh) -> None:
        """Carry vertices that had to stay off the surface back onto it, where that now folds nothing."""
        column = mesh.column(ASTRAY)
        astray = np.flatnonzero(mesh.surface.carried[: mesh.sizes[0], column]) if column is not None else ()
        if not len(astray):
            return
        leaving = np.empty(mesh.sizes[0], np.int32)
        leaving[mesh.faces.ravel()] = np.arange(3 * mesh.sizes[1])
        births = np.zeros((len(astray), BIRTH), np.int32)
        births[:, LEAVING] = leaving[astray]
        went = settled(mesh, births, self._carried(_rest(mesh)[astray]))
        _write(mesh, ASTRAY, astray[went], np.zeros((int(went.sum()), 1)))

    def _elsewhere(self, mesh: HalfedgeMesh, births: Indices, born: Indices, chord: Points) -> AnyArray:
        """Try other places along the edge at rest; answers (N,) booleans: which could take one.

        Where the flow stretches unevenly, the middle at rest is far from the middle now. Of some places the
        one that comes nearest to the chord's middle is tried. Normals stay those of the middle at rest.
        """
        rest = _rest(mesh)
        start, end = rest[births[:, 0]], rest[births[:, 1]]
        goals = self._truly(np.concatenate([start + t * (end - start) for t in _ELSEWHERE]))
        ways = (len(_ELSEWHERE), len(born), 3)
        goals, now = goals.reshape(ways), self._carried(goals).reshape(ways)
        best, each = np.linalg.norm(now - chord, axis=2).argmin(axis=0), np.arange(len(born))
        went = settled(mesh, births, now[best, each])
        rest[born[went]] = goals[best, each][went]
        return went

    def relax(self, mesh: HalfedgeMesh, spokes: Indices, limits: Floats, changes: Changes) -> int:
        """Only where it is known what the surface at rest is like beside a vertex: with a `project`, or
        where the surface at rest is flat."""
        rest, ring = np.ascontiguousarray(_rest(mesh)), new_ring()
        places, normals = np.empty((spokes[0], 3)), np.empty((spokes[0], 3))
        many = relaxed(mesh.surface, rest, spokes, limits, ring, self.project is not None, places, normals)
        if not many:
            return 0
        leaving = spokes[1 : many + 1]
        start, to = mesh.surface.vert[leaving], mesh.surface.vert[_following(leaving)]
        goals = self._truly(places[:many])
        moved, turned = self._now(mesh, goals, normals[:many], rest[to] - rest[start])
        adopted = np.zeros(many, np.uint8)
        done = int(adopt(mesh.surface, spokes, moved, limits, ring, changes, adopted))
        went = adopted > 0
        _write(mesh, REST, start[went], goals[went])
        _write(mesh, NORMAL, start[went], None if turned is None else turned[went])
        return done

    def _truly(self, points: Points) -> Points:
        return points if self.project is None else self.project(points)

    def _now(
        self, mesh: HalfedgeMesh, rest: Points, normals: Vectors | None, along: Vectors
    ) -> tuple[Points, Vectors | None]:
        """Where points at rest are now, and the normals there, if the mesh has any.

        normals  (N, 3) at rest, unit, or zero where there is none
        along    (N, 3) an edge at rest, which tells the scale
        """
        if normals is None or mesh.column(NORMAL) is None:
            return self._carried(rest), None
        soft = normals.any(axis=1)
        beside = [self._truly(rest[soft] + step) for step in _tangents(along[soft], normals[soft])]
        moved = self._carried(np.concatenate([rest, *beside]))
        places, (ahead, left) = moved[: len(rest)], np.split(moved[len(rest) :], 2)
        turned = np.zeros_like(places)
        turned[soft] = _unit(np.cross(ahead - places[soft], left - places[soft]))
        return places, turned

    def _carried(self, rest_points: Points) -> Points:
        moved = np.array(self.carry(np.ascontiguousarray(rest_points)), dtype=np.float64)
        if moved.shape != rest_points.shape or not np.isfinite(moved).all():
            raise FrameError(
                f"carry returned an array of shape {moved.shape} for {len(rest_points)} points at rest, or "
                "numbers that are not finite; it must say where each of them is now"
            )
        return moved


def _rest(mesh: HalfedgeMesh) -> Points:
    """(V, 3) view of the vertices' places at rest."""
    column = mesh.column(REST)
    if column is None:
        raise FrameError(f"the surface has no vertex attribute {REST!r}; exact placement needs it")
    return mesh.surface.carried[: mesh.sizes[0], column : column + 3]


def _write(mesh: HalfedgeMesh, name: str, vertices: AnyArray, values: AnyArray | None) -> None:
    """Set rows (N, k) of an attribute, if the mesh has it and there is anything to be set."""
    column = mesh.column(name)
    if values is not None and column is not None:
        mesh.surface.carried[vertices, column : column + values.shape[1]] = values


def _following(h: Indices) -> Indices:
    after: Indices = np.where(h % 3 == 2, h - 2, h + 1)
    return after


def _tangents(along: Vectors, normals: Vectors) -> tuple[Vectors, Vectors]:
    """Two short steps within the surface from each point: along the edge, and to its left."""
    across = np.cross(normals, along)
    return _TANGENT * np.cross(across, normals), _TANGENT * across


def _unit(vectors: Vectors) -> Vectors:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    unit: Vectors = np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0)
    return unit
