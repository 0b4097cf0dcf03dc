"""Exact placement: the flow is known, so the surface is known everywhere and not only at its vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices, Points, Vectors
from pipeline.errors import FrameError
from pipeline.mesh.halfedge_mesh import HalfedgeMesh
from pipeline.mesh.normals import vertex_normals
from pipeline.mesh.tangents import carried_normals, unit
from pipeline.mesh.triangle_mesh import TriangleMesh
from pipeline.resample._kernels_lists import Changes
from pipeline.resample._kernels_rest import spokes_of_marked
from pipeline.resample._kernels_ring import new_ring
from pipeline.resample._kernels_shape import adopt, relaxed
from pipeline.resample._kernels_split import LEAVING
from pipeline.resample.creases import edges_by_angle
from pipeline.resample.placement.base import settled
from pipeline.resample.placement.closest_point import PointMap, nearest
from pipeline.resample.placement.rest_surface import (
    ASTRAY,
    NORMAL,
    REST,
    REST_NORMAL,
    Surroundings,
    column_of,
    on_patches_at_rest,
    rest_of,
)

_TANGENT = 1e-5  # how far tangent points lie from theirs, in edge lengths at rest


@dataclass(frozen=True)
class Exact:
    """On the exact surface: put on the surface at rest, and carried along to now.

    carry         `rest_points (N, 3) -> (N, 3)`, where they are now; called once a pass with all the new
                  points together, and again for the few that would fold and for normals
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
        normals = vertex_normals(mesh.with_vertices(rest))
        astray = np.zeros(len(rest), np.uint8)
        return mesh.with_attributes(**{REST: rest, REST_NORMAL: normals, ASTRAY: astray})

    def at_rest(self, mesh: HalfedgeMesh) -> tuple[int, int]:
        return column_of(mesh, REST), column_of(mesh, REST_NORMAL)

    def place(self, mesh: HalfedgeMesh, births: Indices, limits: Floats) -> int:
        last, spokes = int(mesh.sizes[0]), np.ascontiguousarray(births[:, LEAVING])
        rest, born = rest_of(mesh), np.arange(last - len(births), last, dtype=np.int32)
        middles, normals = rest[born], np.zeros((len(births), 3))
        if self.project is None or mesh.column(NORMAL) is not None or mesh.surface.tagged.any():
            middles, normals = on_patches_at_rest(mesh, births)
        goals, sizes = self._truly(middles), _lengths(rest, births[:, 0], births[:, 1])
        went = self._take(mesh, spokes, goals, self._carried(goals), normals, sizes, limits)
        if not went.all():
            went[~went] = self._elsewhere(mesh, spokes[~went], limits)
        _write(mesh, ASTRAY, born, ~went[:, None])
        column = mesh.column(NORMAL)
        if column is not None:  # on the chord: between the normals of its ends
            astray = mesh.surface.carried[born[~went], column : column + 3]
            _write(mesh, NORMAL, born[~went], unit(astray))
        return len(births) - int(went.sum())

    def heal(self, mesh: HalfedgeMesh, limits: Floats) -> None:
        """Carry vertices that had to stay off the surface back onto it, where that now folds nothing.

        If their own places at rest fold, the middle of what lies around them there may not.
        """
        column, halfedges = column_of(mesh, ASTRAY), 3 * int(mesh.sizes[1])
        spokes = np.empty(np.count_nonzero(mesh.surface.carried[: mesh.sizes[0], column]), np.int32)
        if not len(spokes):
            return
        spokes_of_marked(mesh.surface, halfedges, column, spokes)
        goals = self._truly(rest_of(mesh)[mesh.surface.vert[spokes]])
        went = settled(mesh, spokes, self._carried(goals), goals, limits)
        if not went.all():
            around = Surroundings.of(mesh, spokes[~went])
            went[~went] = self._to_middle(mesh, around, limits)
        astray = mesh.surface.vert[spokes[went]]
        _write(mesh, ASTRAY, astray, np.zeros((len(astray), 1)))

    def _elsewhere(self, mesh: HalfedgeMesh, spokes: Indices, limits: Floats) -> AnyArray:
        """Take vertices to where the surface around them comes nearest to them, or to the middle of what lies
        around them at rest; answers (N,) booleans: which could go.

        Where the flow shears or stretches unevenly, the middle of an edge at rest is now far from the middle
        of the edge, and beyond the faces beside it.
        """
        around = Surroundings.of(mesh, spokes)
        goals = mesh.vertices[mesh.surface.vert[spokes]]
        found, places = nearest(self._carried, self._truly, around.centre, around.corners, goals)
        went = self._take(mesh, spokes, found, places, around.normals, around.sizes(), limits)
        if not went.all():
            went[~went] = self._to_middle(mesh, around.only(~went), limits)
        return went

    def _to_middle(self, mesh: HalfedgeMesh, around: Surroundings, limits: Floats) -> AnyArray:
        """Take vertices to the middle of what lies around them at rest; answers which went."""
        goals = self._truly(around.middle())
        places = self._carried(goals)
        return self._take(mesh, around.spokes, goals, places, around.normals, around.sizes(), limits)

    def _take(
        self,
        mesh: HalfedgeMesh,
        spokes: Indices,
        goals: Points,
        places: Points,
        normals: Vectors,
        sizes: Floats,
        limits: Floats,
    ) -> AnyArray:
        """Take vertices to their goals at rest and to where these are now; answers which went."""
        went = settled(mesh, spokes, places, goals, limits)
        self._turn(mesh, mesh.surface.vert[spokes], goals, places, normals, sizes, went)
        return went

    def relax(self, mesh: HalfedgeMesh, spokes: Indices, limits: Floats, changes: Changes) -> int:
        """Only where it is known what the surface at rest is like beside a vertex: with a `project`, or
        where the surface at rest is flat."""
        ring, places, normals = new_ring(), np.empty((spokes[0], 3)), np.empty((spokes[0], 3))
        many = relaxed(mesh.surface, spokes, limits, ring, self.project is not None, places, normals)
        if not many:
            return 0
        leaving, rest = spokes[1 : many + 1], rest_of(mesh)
        start, to = mesh.surface.vert[leaving], mesh.surface.vert[_following(leaving)]
        goals, sizes = self._truly(places[:many]), _lengths(rest, start, to)
        moved, adopted = self._carried(goals), np.zeros(many, np.uint8)
        done = int(adopt(mesh.surface, spokes, moved, goals, limits, ring, changes, adopted))
        self._turn(mesh, start, goals, moved, normals[:many], sizes, adopted > 0)
        return done

    def _truly(self, points: Points) -> Points:
        return points if self.project is None else self.project(points)

    def _turn(
        self,
        mesh: HalfedgeMesh,
        vertices: Indices,
        rest: Points,
        places: Points,
        normals: Vectors,
        sizes: Floats,
        these: AnyArray,
    ) -> None:
        """Give some vertices, if they have normals, those that the surface has at their places.

        normals  (N, 3) at rest, unit, or zero where there is none
        sizes    (N,) lengths of an edge of each at rest
        these    (N,) booleans: which
        """
        if mesh.column(NORMAL) is None or not these.any():
            return
        turned = carried_normals(
            lambda beside: self._carried(self._truly(beside)),
            rest[these],
            places[these],
            normals[these],
            _TANGENT * sizes[these],
        )
        _write(mesh, NORMAL, vertices[these], turned)

    def _carried(self, rest_points: Points) -> Points:
        moved = np.array(self.carry(np.ascontiguousarray(rest_points)), dtype=np.float64)
        if moved.shape != rest_points.shape or not np.isfinite(moved).all():
            raise FrameError(
                f"carry returned an array of shape {moved.shape} for {len(rest_points)} points at rest, or "
                "numbers that are not finite; it must say where each of them is now"
            )
        return moved


def _write(mesh: HalfedgeMesh, name: str, vertices: AnyArray, values: AnyArray) -> None:
    """Set rows (N, k) of an attribute that the mesh has."""
    column = column_of(mesh, name)
    mesh.surface.carried[vertices, column : column + values.shape[1]] = values


def _following(h: Indices) -> Indices:
    after: Indices = np.where(h % 3 == 2, h - 2, h + 1)
    return after


def _lengths(points: Points, one: Indices, other: Indices) -> Floats:
    return np.asarray(np.linalg.norm(points[other] - points[one], axis=1))
