"""A polyhedron of half-edges that can be cut and collapsed, and the editor that keeps its limits up to date.

It is the mutable mesh of version 1. Plain lists, because every operation touches a few numbers at a time;
passes over the whole surface run on the arrays of a `PolygonMesh`, before and after.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np

from flowsculpt import PolygonMesh, Thresholds, validate
from flowsculpt.api import VertexBudgetError
from flowsculpt.api.meshes import Floats, edge_keys

Cutting = Literal["slice", "recurse"]
Collapse = Literal["edges", "areas"]

OUTSIDE = -1  # the face beyond a boundary, and the mark of a removed element

Point = tuple[float, float, float]


class Polyhedron:
    """Faces with any number of sides, joined along half-edges.

    Half-edges come in pairs: `h` and ``h ^ 1`` run along edge ``h >> 1`` in opposite directions, so a twin
    need not be stored. A boundary has half-edges too, which belong to the face `OUTSIDE`.

    next, previous, origin, face   by half-edge; `origin` is -1 if the edge has been removed
    crease                         by edge: True if it is hard whatever its angle (P31)
    side                           by face: one of its half-edges, or -1 if the face has been removed
    leaving                        by vertex: a half-edge that leaves it, or -1 if it has been removed
    points                         by vertex: its position

    Numbers of removed elements are not reused before `renumber`. Half-edges are numbered by their first
    appearance among the corners of the faces, so all lists are a function of the mesh.

    Raises MeshError where the mesh is not a finite, oriented manifold, with or without boundary.
    """

    next: list[int]
    previous: list[int]
    origin: list[int]
    face: list[int]
    crease: list[bool]
    side: list[int]
    leaving: list[int]
    points: list[Point]

    def __init__(self, mesh: PolygonMesh) -> None:
        validate(mesh).require()
        self._load(mesh, mesh.twins)

    def split_edge(self, h: int, points: Sequence[Point]) -> list[int]:
        """Insert vertices into the edge of h, in order along h, and return them; h keeps its origin."""
        made = []
        for point in points:
            made.append(self._split_once(h, point))
            h = self.next[h]
        return made

    def cut_face(self, h: int, k: int) -> int:
        """Join the origins of h and k across their face; return the half-edge from h's origin to k's.

        The face keeps the sides from h to k; a new one gets those from k to h, and the returned half-edge.
        """
        nexts, previous, origin, face = self.next, self.previous, self.origin, self.face
        chord, back = self._new_edge(origin[h], origin[k], crease=False)
        old, new = face[h], len(self.side)
        before_h, before_k = previous[h], previous[k]
        nexts[before_k], previous[back], nexts[back], previous[h] = back, before_k, h, back
        nexts[before_h], previous[chord], nexts[chord], previous[k] = chord, before_h, k, chord
        face[back] = old
        self.side[old] = h
        self.side.append(chord)
        for one in self.loop(chord):
            face[one] = new
        return chord

    def collapse_edge(self, h: int, place: Point) -> int:
        """Merge the end of h into its origin, which moves to `place`; return the origin.

        Faces left with two sides vanish, and the two sides become one edge. The caller must have checked the
        link condition.
        """
        keep, gone = self.origin[h], self.origin[h ^ 1]
        self.points[keep] = place
        for one in self.star(gone):
            self.origin[one] = keep
        self.leaving[gone] = OUTSIDE
        around = self.next[h]
        for one in (h, h ^ 1):
            before, after = self.previous[one], self.next[one]
            self.next[before], self.previous[after] = after, before
            if self.face[one] != OUTSIDE and self.side[self.face[one]] == one:
                self.side[self.face[one]] = after
        self.leaving[keep] = around
        after_twin = self.next[h ^ 1]
        self._remove_edge(h)
        for one in (around, after_twin):
            if self.next[self.next[one]] == one:
                self._close(one)
        return keep

    def loop(self, h: int) -> list[int]:
        """Return the half-edges of the face of h, from h on."""
        around, k = [h], self.next[h]
        while k != h:
            around.append(k)
            k = self.next[k]
        return around

    def star(self, vertex: int) -> list[int]:
        """Return the half-edges that leave a vertex, clockwise."""
        first = self.leaving[vertex]
        around, k = [first], self.next[first ^ 1]
        while k != first:
            around.append(k)
            k = self.next[k ^ 1]
        return around

    def ends(self, h: int) -> tuple[int, int]:
        """Return the vertices at the start and the end of h."""
        return self.origin[h], self.origin[h ^ 1]

    def joined(self, a: int, b: int) -> bool:
        """Tell whether an edge joins two vertices."""
        return any(self.origin[h ^ 1] == b for h in self.star(a))

    def vertices(self, f: int) -> list[int]:
        """Return the vertices of a face, in order."""
        return [self.origin[h] for h in self.loop(self.side[f])]

    def corners(self, f: int) -> list[Point]:
        """Return the positions of a face's vertices, in order."""
        return [self.points[v] for v in self.vertices(f)]

    def mesh(self) -> PolygonMesh:
        """Return the surface as a value, vertices and faces in the order of the lists."""
        mesh, _ = self._gather()
        return mesh

    def renumber(self) -> tuple[PolygonMesh, np.ndarray]:
        """Drop the numbers of removed elements; return the surface and the old vertex numbers (V,)."""
        kept = np.flatnonzero(np.array(self.leaving) != OUTSIDE)
        mesh, twin = self._gather()
        self._load(mesh, twin)
        return mesh, kept

    def _new_edge(self, a: int, b: int, crease: bool) -> tuple[int, int]:
        h = len(self.origin)
        self.origin += (a, b)
        for numbers in (self.next, self.previous, self.face):
            numbers += (OUTSIDE, OUTSIDE)
        self.crease.append(crease)
        return h, h ^ 1

    def _split_once(self, h: int, point: Point) -> int:
        """Split the edge of h: it keeps the first part; a new edge, which follows h, becomes the second."""
        nexts, previous, face = self.next, self.previous, self.face
        twin, end, vertex = h ^ 1, self.origin[h ^ 1], len(self.points)
        self.points.append(point)
        ahead, behind = self._new_edge(vertex, end, self.crease[h >> 1])
        after, before = nexts[h], previous[twin]
        nexts[h], previous[ahead], nexts[ahead], previous[after] = ahead, h, after, ahead
        nexts[before], previous[behind], nexts[behind], previous[twin] = behind, before, twin, behind
        face[ahead], face[behind] = face[h], face[twin]
        self.origin[twin] = vertex
        self.leaving.append(ahead)
        if self.leaving[end] == twin:
            self.leaving[end] = behind
        return vertex

    def _close(self, h: int) -> None:
        """Remove the two-sided face of h; its two edges become that of h."""
        other = self.next[h]
        beyond = other ^ 1  # runs as h does, on the far side of the other edge
        if self.face[h] != OUTSIDE:
            self.side[self.face[h]] = OUTSIDE
        before, after, face = self.previous[beyond], self.next[beyond], self.face[beyond]
        self.next[before], self.previous[h], self.next[h], self.previous[after] = h, before, after, h
        self.face[h] = face
        if face != OUTSIDE and self.side[face] == beyond:
            self.side[face] = h
        self.crease[h >> 1] = self.crease[h >> 1] or self.crease[other >> 1]
        self.leaving[self.origin[h]], self.leaving[self.origin[h ^ 1]] = h, h ^ 1
        self._remove_edge(other)

    def _remove_edge(self, h: int) -> None:
        self.origin[h] = self.origin[h ^ 1] = OUTSIDE

    def _gather(self) -> tuple[PolygonMesh, np.ndarray]:
        """Return the surface without gaps, and for each of its sides the one that runs back along it."""
        sides, offsets = [], [0]
        for first in self.side:
            if first != OUTSIDE:
                sides += self.loop(first)
                offsets.append(len(sides))
        at = np.array(sides)
        kept = np.flatnonzero(np.array(self.leaving) != OUTSIDE)
        number = np.full(len(self.leaving), OUTSIDE)
        number[kept] = np.arange(len(kept))
        origin = np.array(self.origin)
        corner = np.full(len(origin), OUTSIDE)
        corner[at] = np.arange(len(at))
        hard = np.flatnonzero(np.array(self.crease) & (origin[::2] != OUTSIDE))
        creases = number[np.column_stack([origin[2 * hard], origin[2 * hard + 1]])]
        points = np.array(self.points)[kept]
        mesh = PolygonMesh.from_arrays(points, offsets, number[origin[at]], creases=creases)
        return mesh, corner[at ^ 1]

    def _load(self, mesh: PolygonMesh, twin: np.ndarray) -> None:
        """Fill the lists; `twin` gives for each corner the side that runs back along its own, or -1."""
        count = len(mesh.corners)
        corner = np.arange(count)
        first = (twin < 0) | (corner < twin)
        half = np.empty(count, np.int64)
        half[first] = 2 * np.arange(np.count_nonzero(first))
        half[~first] = half[twin[~first]] + 1
        following = np.append(corner[1:], 0)
        following[mesh.offsets[1:] - 1] = mesh.offsets[:-1]
        origin = np.empty(2 * int(first.sum()), np.int64)
        nexts, face = np.full(len(origin), OUTSIDE), np.full(len(origin), OUTSIDE)
        origin[half], face[half], nexts[half] = mesh.corners, mesh.owners, half[following]
        boundary = half[twin < 0] ^ 1
        origin[boundary] = mesh.heads[twin < 0]
        leaving = np.full(len(mesh.vertices), OUTSIDE)
        leaving[mesh.corners[::-1]] = half[::-1]
        start = np.full(len(mesh.vertices), OUTSIDE)
        start[origin[boundary]] = boundary
        nexts[boundary] = start[mesh.corners[twin < 0]]
        previous = np.empty(len(origin), np.int64)
        previous[nexts] = np.arange(len(origin))
        self.next, self.previous, self.origin = nexts.tolist(), previous.tolist(), origin.tolist()
        self.face, self.side, self.leaving = face.tolist(), half[mesh.offsets[:-1]].tolist(), leaving.tolist()
        self.crease = self._tagged(mesh, origin)
        self.points = [(x, y, z) for x, y, z in mesh.vertices.tolist()]

    @staticmethod
    def _tagged(mesh: PolygonMesh, origin: np.ndarray) -> list[bool]:
        if not len(mesh.creases):
            return [False] * (len(origin) // 2)
        return np.isin(edge_keys(origin.reshape(-1, 2)), edge_keys(mesh.creases)).tolist()


def newell(polygon: Sequence[Point]) -> Point:
    """Return the area vector of a polygon, bent or not: along its mean normal, twice as long as its area."""
    ox, oy, oz = polygon[0]
    nx = ny = nz = 0.0
    px, py, pz = polygon[1][0] - ox, polygon[1][1] - oy, polygon[1][2] - oz
    for x, y, z in polygon[2:]:
        qx, qy, qz = x - ox, y - oy, z - oz
        nx += py * qz - pz * qy
        ny += pz * qx - px * qz
        nz += px * qy - py * qx
        px, py, pz = qx, qy, qz
    return nx, ny, nz


def dot(a: Point, b: Point) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def norm(a: Point) -> float:
    """Return the length."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


def difference(a: Point, b: Point) -> Point:
    """Return the vector from b to a."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def between(a: Point, b: Point, share: float) -> Point:
    """Return the point on the line from a to b; `share` 0 is a, 1 is b."""
    return (a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share, a[2] + (b[2] - a[2]) * share)


def box(polygon: Sequence[Point]) -> tuple[int, float, float]:
    """Return the longest dimension of a polygon's bounding box (P17): axis, lowest, highest coordinate."""
    best, least, most = 0, 0.0, -1.0
    for axis in range(3):
        along = [point[axis] for point in polygon]
        low, high = min(along), max(along)
        if high - low > most - least:
            best, least, most = axis, low, high
    return best, least, most


class Inheritance(NamedTuple):
    """A vertex takes its attributes from the point at `share` between vertices a and b."""

    vertex: int
    a: int
    b: int
    share: float


def inherited(
    attributes: Mapping[str, np.ndarray], inheritance: Sequence[Inheritance], kept: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the attributes after a frame for the vertices `kept`, by applying the inheritances in order.

    Floating-point numbers mix; integers and flags are those of the nearer parent, `a` on a tie.
    """
    after = {}
    for name, values in attributes.items():
        count = max([len(values), *(step.vertex + 1 for step in inheritance)])
        rows = np.zeros((count, *values.shape[1:]), values.dtype)
        rows[: len(values)] = values
        if values.dtype.kind == "f":
            for vertex, a, b, share in inheritance:
                rows[vertex] = rows[a] + (rows[b] - rows[a]) * share if share < 1 else rows[b]
        else:
            for vertex, a, b, share in inheritance:
                rows[vertex] = rows[b] if share > 0.5 else rows[a]
        after[name] = rows[kept]
    return after


class PolyhedronEditor:
    """A polyhedron under change, its limits, and the history of its vertices in this frame.

    inheritance   in order of events: the sources of the attributes of new and merged vertices
    splits, cuts, collapses   operations done
    """

    def __init__(self, surface: Polyhedron, limits: LengthLimits) -> None:
        self.surface, self.limits = surface, limits
        self.inheritance: list[Inheritance] = []
        self.splits = self.cuts = self.collapses = 0
        self._normals: dict[int, Point] = {}

    def split(self, h: int, shares: Sequence[float]) -> list[int]:
        """Insert vertices into the edge of h, at these shares of its length from its origin, in order.

        Raises FrameError where the vertices would exceed the budget.
        """
        self.keep_to_budget(len(shares))
        surface = self.surface
        a, b = surface.ends(h)
        start, end = surface.points[a], surface.points[b]
        made = surface.split_edge(h, [between(start, end, share) for share in shares])
        for vertex, share in zip(made, shares, strict=True):
            self.inheritance.append(Inheritance(vertex, a, b, share))
            self.limits.add(a, b, share)
        self.splits += len(made)
        return made

    def keep_to_budget(self, more: float) -> None:
        """Raise VertexBudgetError if that many more vertices would exceed the budget."""
        now, budget = len(self.surface.points), self.limits.max_vertices
        if now + more > budget:
            raise VertexBudgetError(
                f"{now} vertices and {more:.0f} more on one edge or face exceed the budget of {budget} "
                "vertices"
            )

    def cut(self, h: int, k: int) -> int:
        """Join the origins of h and k across their face; return the half-edge between them.

        If an edge joins them elsewhere, the new edge gets a vertex in its middle: no two edges of a
        polyhedron join the same two vertices.
        """
        surface = self.surface
        doubled = surface.joined(surface.origin[h], surface.origin[k])
        self._normals.pop(surface.face[h], None)
        chord = surface.cut_face(h, k)
        self.cuts += 1
        if doubled:
            self.split(chord, [0.5])
        return chord

    def collapse(self, h: int, share: float) -> int:
        """Merge the ends of h at that share of its length from its origin; return the merged vertex."""
        surface = self.surface
        a, b = surface.ends(h)
        for one in (*surface.star(a), *surface.star(b)):
            self._normals.pop(surface.face[one], None)
        self.collapses += 1
        place = self.place(h, share)
        if share > 0:
            self.inheritance.append(Inheritance(a, a, b, share))
            self.limits.merge(a, b, share)
        return surface.collapse_edge(h, place)

    def place(self, h: int, share: float) -> Point:
        """Return a point on the edge of h; its ends exactly."""
        start, end = (self.surface.points[v] for v in self.surface.ends(h))
        if share in (0.0, 1.0):
            return end if share else start
        return between(start, end, share)

    def length(self, h: int) -> float:
        """Return the length of the edge of h, scene units."""
        a, b = self.surface.ends(h)
        return norm(difference(self.surface.points[a], self.surface.points[b]))

    def is_too_long(self, h: int) -> bool:
        return self.length(h) > self.limits.max_edge_length(*self.surface.ends(h))

    def is_too_short(self, h: int) -> bool:
        return self.length(h) < self.limits.min_edge_length(*self.surface.ends(h))

    def normal(self, f: int) -> Point:
        """Return the Newell vector of a face, twice as long as its area."""
        if f not in self._normals:
            self._normals[f] = newell(self.surface.corners(f))
        return self._normals[f]

    def is_hard(self, h: int) -> bool:
        """Tell whether an edge is tagged, on a boundary, or bent by more than the hard angle.

        A face without area does not count (P29, P31).
        """
        surface = self.surface
        f, g = surface.face[h], surface.face[h ^ 1]
        if surface.crease[h >> 1] or f == OUTSIDE or g == OUTSIDE:
            return True
        one, two = self.normal(f), self.normal(g)
        cosine = self.limits.hard_cosine(*surface.ends(h))
        return dot(one, two) < cosine * norm(one) * norm(two)


class LengthLimits:
    """Maximum and minimum length and hard angle at every vertex; the same everywhere if they are numbers.

    An edge has the geometric mean of the limits at its two ends, a face the smallest maximum of its corners.
    """

    def __init__(self, thresholds: Thresholds, mesh: PolygonMesh) -> None:
        """Raises UsageError where an active threshold gives impossible values."""
        self.max_vertices = thresholds.max_vertices
        self._same: float | None = None
        if thresholds.active:
            # functions take triangles, whose first vertices are those of the polygons
            fields = thresholds.fields(mesh.triangulated())[: len(mesh.vertices)]
            self._at: list[Point] = [(high, low, angle) for high, low, angle in fields.tolist()]
        else:
            numbers = thresholds.numbers
            self._same = math.cos(numbers[2])
            self._at = [numbers] * len(mesh.vertices)

    @property
    def table(self) -> Floats:
        """(V, 3): maximum and minimum length, scene units, and hard angle, radians, at every vertex."""
        return np.array(self._at)

    def max_edge_length(self, a: int, b: int) -> float:
        return math.sqrt(self._at[a][0] * self._at[b][0])

    def min_edge_length(self, a: int, b: int) -> float:
        return math.sqrt(self._at[a][1] * self._at[b][1])

    def hard_cosine(self, a: int, b: int) -> float:
        """Return the cosine of the hard angle at the edge between two vertices."""
        if self._same is not None:
            return self._same
        return math.cos(math.sqrt(self._at[a][2] * self._at[b][2]))

    def max_face_size(self, vertices: list[int]) -> float:
        """Return the longest side that the bounding box of a face may have."""
        return min(self._at[v][0] for v in vertices)

    def add(self, a: int, b: int, share: float) -> None:
        """Add the limits of the next vertex, interpolated between the ends of the edge that it splits."""
        self._at.append(between(self._at[a], self._at[b], share))

    def merge(self, a: int, b: int, share: float) -> None:
        """Set the limits of `a` to those at the place that it moves to."""
        self._at[a] = between(self._at[a], self._at[b], share)
