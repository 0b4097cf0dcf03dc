"""Placements of new vertices: on the chord, on a curved patch, or exactly, by the surface at rest.

The surface at rest is the undeformed one. Exact placement carries its points to the present by the known
flow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Floats, Indices, Points, Vectors
from flowsculpt.pipeline.errors import FrameError
from flowsculpt.pipeline.mesh.halfedge_mesh import HalfedgeMesh
from flowsculpt.pipeline.mesh.meshes import TriangleMesh
from flowsculpt.pipeline.mesh.normals import (
    carried_normals,
    normals_from_tangents,
    tangent_points,
    unit,
    vertex_normals,
)
from flowsculpt.pipeline.resample.kernels.pass_state import Changes, Limits, new_ring
from flowsculpt.pipeline.resample.kernels.rest_surface import (
    LATTICE,
    MAX_OPPOSITE,
    RestRings,
    choose_nearest,
    keep_nearer,
    list_marked,
    measure_at_rest,
    opposite_corners,
    place_lattice,
    relax_goals,
    relax_vertices,
    step_aside,
    step_to_goals,
    tangent_frames,
)
from flowsculpt.pipeline.resample.kernels.split import (
    BIRTH_HALFEDGE,
    Midpoints,
    curved_midpoints,
    place_vertices,
    rest_midpoints,
)
from flowsculpt.pipeline.resample.thresholds import edges_by_angle

_MIDPOINT_FLOATS = 7  # of scratch that the kernels of midpoints take


class Placement:
    """A rule for where splits place new vertices, and how far others may move.

    leaves_chord        True if new vertices may lie off the middle of their edge
    merges_at_midpoint  True if two soft ends merge halfway (P27), False if at one of them
    can_relax           True if `relax` can move vertices
    hard_by_angle       True if edges beyond the hard angle are hard in each frame (P29), False if only tagged
                        ones and boundaries are
    most_rounds         rounds of splits whose vertices are placed, if more than of the pass

    The base keeps nothing at the vertices and places new ones in the middle of their edges.
    """

    leaves_chord: ClassVar[bool] = False
    merges_at_midpoint: ClassVar[bool] = False
    can_relax: ClassVar[bool] = False
    hard_by_angle: ClassVar[bool] = True
    most_rounds: ClassVar[int] = 0

    def prepare(self, mesh: TriangleMesh, hard_angle: float | Floats) -> TriangleMesh:
        """Return the mesh with all that this placement keeps at its vertices and edges.

        hard_angle  radians, one for all or one a vertex
        """
        return mesh

    def columns(self, mesh: HalfedgeMesh) -> tuple[int, int, int]:
        """Return attribute columns: of rest positions, rest normals, and normals that no face may oppose.

        -1 stands for none.
        """
        return -1, -1, -1

    def place(self, mesh: HalfedgeMesh, births: Indices, limits: Limits) -> int:
        """Move the last vertices of the mesh from the midpoints of their parents to their places.

        births  (N, 3) of each: its parents a and b, the half-edge vertex→b

        Returns how many had to stay at the midpoint. Called once after each round of splits, with all its
        new vertices together.
        """
        return 0

    def restore(self, mesh: HalfedgeMesh, limits: Limits) -> None:
        """Move vertices that earlier passes had to leave off the surface back onto it."""

    def relax(self, mesh: HalfedgeMesh, spokes: Indices, limits: Limits, changes: Changes) -> int:
        """Move vertices within the surface where their worst triangle improves; return how many moved.

        spokes   a work list of half-edges, one from each vertex to move
        changes  receives the faces around moved vertices
        """
        return 0


@dataclass(frozen=True)
class Chord(Placement):
    """New vertices in the middle of their edge, as in the paper (P25, P27)."""

    merges_at_midpoint: ClassVar[bool] = True


@dataclass(frozen=True)
class Curved(Placement):
    """New vertices on a curved patch over the edge, which ends at creases (P37); for unknown flows."""

    leaves_chord: ClassVar[bool] = True

    def place(self, mesh: HalfedgeMesh, births: Indices, limits: Limits) -> int:
        places, normals = np.empty((2, len(births), 3))
        curved_midpoints(
            mesh.arrays, births, limits.hard_cosine, Midpoints(places, normals, np.empty(_MIDPOINT_FLOATS))
        )
        moved = move_without_folds(mesh, births[:, BIRTH_HALFEDGE], places, places, limits)
        return len(births) - int(moved.sum())


def move_without_folds(
    mesh: HalfedgeMesh, spokes: Indices, places: Points, goals: Points, limits: Limits
) -> AnyArray:
    """Move vertices to their places where no face folds; return flags (N,) of those that moved.

    spokes  (N,) a half-edge that leaves each
    goals   (N, 3) their places at rest, if they have any
    """
    moved = np.zeros(len(spokes), np.uint8)
    place_vertices(mesh.arrays, np.ascontiguousarray(spokes), new_ring(), places, goals, limits, moved)
    return moved > 0


REST, REST_NORMAL, NORMAL, ASTRAY, FACE = "rest", "rest_normal", "normal", "astray", "face"
"""Vertex attributes of exact placement: position and normal on the undeformed surface, present normal, a flag
for vertices that had to be left off the surface, and, of a given surface, the face that a vertex is on."""


def column_of(mesh: HalfedgeMesh, name: str) -> int:
    """Return the first column of an attribute. Raises FrameError where the mesh does not have it."""
    column = mesh.column(name)
    if column is None:
        raise FrameError(f"the surface has no vertex attribute {name!r}; exact placement needs it")
    return column


def rest_of(mesh: HalfedgeMesh) -> Points:
    """Return a view (V, 3) of the vertices' rest positions."""
    column = column_of(mesh, REST)
    return mesh.arrays.attributes[: mesh.sizes[0], column : column + 3]


def rest_rings(mesh: HalfedgeMesh, spokes: Indices) -> RestRings:
    """Return the rings at rest of the vertices that these half-edges (N,) leave."""
    many = len(spokes)
    opposite = np.empty((many, MAX_OPPOSITE, 2), np.int32)
    opposite_corners(mesh.arrays, spokes, new_ring(), opposite)
    centre, normals, middle = np.empty((3, many, 3))
    rings = RestRings(spokes, centre, np.empty((many, MAX_OPPOSITE, 2, 3)), normals, middle, np.empty(many))
    measure_at_rest(mesh.arrays, column_of(mesh, REST), column_of(mesh, REST_NORMAL), opposite, rings)
    return rings


PointMap = Callable[[Points], Points]
NearMap = Callable[[Points, AnyArray], Points]

_ROUNDS = 2
_STEP = 1e-4  # finite difference, in sides of the triangle
_TANGENT = 1e-5  # distance of tangent points from their vertex, in edge lengths at rest


def closest_points(
    carry: NearMap, project: NearMap, centre: Points, corners: Points, goals: Points
) -> tuple[Points, Points]:
    """Return the points of the surface that the flow brings closest to the goals: at rest, and now.

    carry    points at rest (M, 3), and the row (M,) of the centre near each, to their present positions
    project  points beside the surface at rest, with rows as above, onto it
    centre   (N, 3) vertices at rest
    corners  (N, K, 2, 3) the other corners of K triangles at each, at rest; nan where there are fewer, and
             twice the same for an edge that the point must stay on
    goals    (N, 3) points now

    Takes the best point of a lattice within the triangles, then Gauss-Newton steps while they improve.
    """
    many = len(centre)
    lattice, starts = np.empty((LATTICE * many, 3)), np.empty(many + 1, np.int64)
    lattice, row = lattice[: place_lattice(centre, corners, lattice, starts)], np.arange(many)
    rows, both = np.repeat(row, np.diff(starts)), np.tile(row, 2)
    candidates = project(lattice, rows)
    nearest_rest, places = np.empty((2, many, 3))
    choose_nearest(starts, candidates, carry(candidates, rows), goals, nearest_rest, places)
    frames, beside, new_rest = np.empty((many, 2, 3)), np.empty((2 * many, 3)), np.empty((many, 3))
    tangent_frames(centre, corners, frames)
    for _ in range(_ROUNDS):
        step_aside(nearest_rest, frames, _STEP, beside)
        moved = carry(project(beside, both), both)
        step_to_goals(nearest_rest, places, moved, goals, _STEP, frames, new_rest)
        projected = project(new_rest, row)
        keep_nearer(projected, carry(projected, row), goals, nearest_rest, places)
    return nearest_rest, places


class Ends(NamedTuple):
    """Vertices of the surface that points at rest are near: of a new one the ends of its edge.

    places  (N, 2, 3): their rest positions, twice the same for one vertex
    faces   int64 (N, 2): the faces at rest that these are on
    """

    places: Points
    faces: AnyArray

    def of_rows(self, rows: AnyArray) -> Ends:
        """Return those of some points, by rows (M,) of these."""
        return Ends(self.places[rows], self.faces[rows])


class FaceMap(Protocol):
    """Faces at rest that points keep their places on, wherever these faces go."""

    def nearest(self, points: Points, ends: Ends) -> tuple[Points, AnyArray]:
        """Return the places (N, 3) on faces nearest to points, and those faces (N,)."""

    def carried(self, rest: Points, faces: AnyArray) -> Points:
        """Return the present positions (N, 3) of points at rest on these faces (N,)."""


@dataclass(frozen=True)
class Exact(Placement):
    """New vertices on the exact surface: placed on the surface at rest, then carried to the present.

    carry                 `rest_points (N, 3) -> (N, 3)`, their present positions; called once a round with
                          all new points and those that carry their normals, and again for the few that would
                          fold
    project               `rest_points (N, 3) -> (N, 3)`, the nearest points of the analytic surface at rest,
                          if it is known; without it new rest points lie on curved patches over the mesh at
                          rest
    tags_creases          True: edges that are hard at rest, by their angle, are tagged as creases
    faces_follow_normals  True: no face may look against the mean of its corners' normals, if carried
    faces                 in place of carry and project, of a surface that is given by faces and may cut
                          through itself: each vertex keeps its face, as FACE, and a new one looks for its own
                          from those of its edge's ends on; normals are not carried

    Tagged edges and boundaries are hard whatever becomes of them, and no others: the rim of a sheet that the
    flow has made thin is as sharp as a crease, and must not be kept as one.

    The mesh given to a `Resampler` is the surface at rest. Collapses keep one end, since midpoints would
    leave the surface. If the mesh has a `normal` at each vertex, a new vertex gets its exact normal from two
    points carried along beside it; at creases, which have several normals, it is zero.
    """

    carry: PointMap
    project: PointMap | None = None
    tags_creases: bool = True
    faces_follow_normals: bool = False
    faces: FaceMap | None = None
    leaves_chord: ClassVar[bool] = True
    can_relax: ClassVar[bool] = True
    hard_by_angle: ClassVar[bool] = False

    def prepare(self, mesh: TriangleMesh, hard_angle: float | Floats) -> TriangleMesh:
        rest = mesh.attributes.get(REST, mesh.vertices)
        if self.tags_creases:
            mesh = mesh.with_creases(np.concatenate([mesh.creases, edges_by_angle(mesh, hard_angle)]))
        normals = vertex_normals(mesh.with_vertices(rest))
        astray = np.zeros(len(rest), np.uint8)
        return mesh.with_attributes(**{REST: rest, REST_NORMAL: normals, ASTRAY: astray})

    def columns(self, mesh: HalfedgeMesh) -> tuple[int, int, int]:
        normals = mesh.column(NORMAL) if self.faces_follow_normals else None
        return column_of(mesh, REST), column_of(mesh, REST_NORMAL), -1 if normals is None else normals

    def place(self, mesh: HalfedgeMesh, births: Indices, limits: Limits) -> int:
        last, spokes = int(mesh.sizes[0]), np.ascontiguousarray(births[:, BIRTH_HALFEDGE])
        born = mesh.arrays.attributes[last - len(births) : last]
        middles, normals, sizes = self._midpoints_at_rest(mesh, births)
        ends = self._ends(mesh, births[:, :BIRTH_HALFEDGE])
        goals = self._project(middles, ends)
        places, carried = self._carry_with_normals(mesh, goals, normals, sizes, ends)
        moved = move_without_folds(mesh, spokes, places, goals, limits)
        column = mesh.column(NORMAL)
        if column is not None:
            born[moved, column : column + 3] = carried[moved]
        self._settle(mesh, mesh.arrays.vert[spokes], ends)
        if not moved.all():
            moved[~moved] = self._place_nearby(mesh, spokes[~moved], limits)
        born[:, column_of(mesh, ASTRAY)] = ~moved
        if column is not None:  # vertices left on the chord keep the mean of their parents' normals
            born[~moved, column : column + 3] = unit(born[~moved, column : column + 3])
        return len(births) - int(moved.sum())

    def _midpoints_at_rest(self, mesh: HalfedgeMesh, births: Indices) -> tuple[Points, Vectors, Floats]:
        """Return where new vertices (N, 3) are at rest, beside the surface if that is known.

        And unit normals (N, 3) there, zero on creases, and the lengths (N,) of the edges that were split;
        where a known surface has neither creases nor normals to be carried, zeros.
        """
        column, normals, sizes = column_of(mesh, REST), np.zeros((len(births), 3)), np.zeros(len(births))
        if self._is_known and mesh.column(NORMAL) is None and not mesh.arrays.tagged.any():
            last = int(mesh.sizes[0])
            return rest_of(mesh)[last - len(births) :].copy(), normals, sizes
        rest = np.empty_like(mesh.arrays.points)  # only the rows of a few rings are used and take memory
        found = Midpoints(np.empty((len(births), 3)), normals, np.empty(_MIDPOINT_FLOATS))
        rest_midpoints(
            mesh.arrays, births, column, column_of(mesh, REST_NORMAL), new_ring(), rest, found, sizes
        )
        return found.places, normals, sizes

    def restore(self, mesh: HalfedgeMesh, limits: Limits) -> None:
        """Carry vertices that had to stay off the surface back onto it, where no face then folds.

        If a vertex's own place at rest folds, the middle of its ring at rest may not.
        """
        column, halfedges = column_of(mesh, ASTRAY), 3 * int(mesh.sizes[1])
        spokes = np.empty(np.count_nonzero(mesh.arrays.attributes[: mesh.sizes[0], column]), np.int32)
        if not len(spokes):
            return
        list_marked(mesh.arrays, halfedges, column, spokes)
        ends = self._ends(mesh, mesh.arrays.vert[spokes])
        goals = self._project(rest_of(mesh)[mesh.arrays.vert[spokes]], ends)
        moved = move_without_folds(mesh, spokes, self._carry(goals, ends), goals, limits)
        if not moved.all():
            rings = rest_rings(mesh, spokes[~moved])
            moved[~moved] = self._move_to_middle(mesh, rings, limits)
        astray = mesh.arrays.vert[spokes[moved]]
        _write(mesh, ASTRAY, astray, np.zeros((len(astray), 1)))

    def _place_nearby(self, mesh: HalfedgeMesh, spokes: Indices, limits: Limits) -> AnyArray:
        """Move vertices to the nearest point of the surface around them, or the middle of their rest ring.

        Returns flags (N,) of those that moved. Where the flow shears or stretches unevenly, the midpoint of
        an edge at rest is now far from the middle of the edge, and beyond the faces beside it.
        """
        rings = rest_rings(mesh, spokes)
        goals = mesh.vertices[mesh.arrays.vert[spokes]]
        ends = self._ends(mesh, mesh.arrays.vert[spokes])

        def near(rows: AnyArray) -> Ends | None:
            return None if ends is None else ends.of_rows(rows)

        nearest_rest, places = closest_points(
            lambda points, rows: self._carry(points, near(rows)),
            lambda points, rows: self._project(points, near(rows)),
            rings.centre,
            rings.corners,
            goals,
        )
        moved = self._move(mesh, rings, nearest_rest, places, limits)
        if not moved.all():
            others = RestRings._make(values[~moved] for values in rings)
            moved[~moved] = self._move_to_middle(mesh, others, limits)
        return moved

    def _move_to_middle(self, mesh: HalfedgeMesh, rings: RestRings, limits: Limits) -> AnyArray:
        """Move vertices to the middle of their rings at rest; return flags of those that moved."""
        ends = self._ends(mesh, mesh.arrays.vert[rings.spokes])
        goals = self._project(rings.middle, ends)
        return self._move(mesh, rings, goals, self._carry(goals, ends), limits)

    def _move(
        self, mesh: HalfedgeMesh, rings: RestRings, goals: Points, places: Points, limits: Limits
    ) -> AnyArray:
        """Move vertices to `goals` at rest and to `places` now; return flags of those that moved.

        If the mesh has normals, theirs become the exact ones.
        """
        vertices = mesh.arrays.vert[rings.spokes]
        ends = self._ends(mesh, vertices)
        moved = move_without_folds(mesh, rings.spokes, places, goals, limits)
        self._settle(mesh, vertices, ends)
        if mesh.column(NORMAL) is not None and moved.any():
            carried = carried_normals(
                lambda beside: self._carry(self._project(beside)),
                goals[moved],
                places[moved],
                rings.normals[moved],
                _TANGENT * rings.sizes[moved],
            )
            _write(mesh, NORMAL, vertices[moved], carried)
        return moved

    def relax(self, mesh: HalfedgeMesh, spokes: Indices, limits: Limits, changes: Changes) -> int:
        """Move vertices where the surface at rest is known around them: by `project`, or as it is flat."""
        places, normals = np.empty((2, spokes[0], 3))
        sizes, anywhere, ring = np.empty(spokes[0]), self._is_known, new_ring()
        many = relax_goals(mesh.arrays, spokes, limits, ring, anywhere, places, normals, sizes)
        if not many:
            return 0
        vertices = mesh.arrays.vert[spokes[1 : many + 1]]
        ends = self._ends(mesh, vertices)
        goals, moved = self._project(places[:many], ends), np.zeros(many, np.uint8)
        places_now, carried = self._carry_with_normals(mesh, goals, normals[:many], sizes[:many], ends)
        done = int(relax_vertices(mesh.arrays, spokes, places_now, goals, limits, ring, changes, moved))
        self._settle(mesh, vertices, ends)
        if mesh.column(NORMAL) is not None:
            went = moved > 0
            _write(mesh, NORMAL, vertices[went], carried[went])
        return done

    def _carry_with_normals(
        self, mesh: HalfedgeMesh, goals: Points, normals: Vectors, sizes: Floats, ends: Ends | None
    ) -> tuple[Points, Vectors]:
        """Return the present places (N, 3) of points at rest and, if the mesh has normals, those there.

        normals  (N, 3) at rest, unit, or zero where there is none
        sizes    (N,) length of an edge of each at rest

        All is carried by one call: the flow starts along its streamlines once.
        """
        if mesh.column(NORMAL) is None:
            return self._carry(goals, ends), normals
        beside = self._project(tangent_points(goals, normals, _TANGENT * sizes))
        carried = self._carry(np.concatenate([goals, beside]))
        places = carried[: len(goals)]
        return places, normals_from_tangents(normals, places, carried[len(goals) :])

    def _carry(self, rest_points: Points, ends: Ends | None = None) -> Points:
        points = np.ascontiguousarray(rest_points)
        if self.faces is not None and ends is not None:
            moved = self.faces.carried(*self.faces.nearest(points, ends))
        else:
            moved = np.array(self.carry(points), dtype=np.float64, order="C")
        if moved.shape != rest_points.shape or not np.isfinite(moved).all():
            raise FrameError(
                f"carry returned an array of shape {moved.shape} for {len(rest_points)} points at rest, or "
                "numbers that are not finite; it must return the current position of each point"
            )
        return moved

    @property
    def _is_known(self) -> bool:
        """True if the surface at rest is known everywhere."""
        return self.project is not None or self.faces is not None

    def _project(self, points: Points, ends: Ends | None = None) -> Points:
        """Return points of the surface at rest for points (N, 3) beside it."""
        if self.faces is not None and ends is not None:
            return self.faces.nearest(points, ends)[0]
        return points if self.project is None else np.array(self.project(points), np.float64, order="C")

    def _ends(self, mesh: HalfedgeMesh, vertices: AnyArray) -> Ends | None:
        """Return the ends of points near vertices, (N,) or two for each (N, 2), if faces are kept."""
        if self.faces is None:
            return None
        both = np.broadcast_to(vertices.T, (2, len(vertices))).T
        faces = mesh.arrays.attributes[:, column_of(mesh, FACE)][both]
        return Ends(rest_of(mesh)[both], faces.astype(np.int64))

    def _settle(self, mesh: HalfedgeMesh, vertices: AnyArray, ends: Ends | None) -> None:
        """Keep the faces of vertices (N,) whose rest positions have changed."""
        if self.faces is not None and ends is not None:
            _, faces = self.faces.nearest(rest_of(mesh)[vertices], ends)
            _write(mesh, FACE, vertices, faces[:, None])


def _write(mesh: HalfedgeMesh, name: str, vertices: AnyArray, values: AnyArray) -> None:
    """Write rows (N, k) of an attribute that the mesh has."""
    column = column_of(mesh, name)
    mesh.arrays.attributes[vertices, column : column + values.shape[1]] = values
