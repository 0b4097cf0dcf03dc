"""PolyhedronEditor: operations on a polyhedron that keep its limits, attributes and normals up to date."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pipeline.arrays import AnyArray, Floats
from pipeline.errors import VertexBudgetError
from pipeline.mesh.meshes import PolygonMesh
from pipeline.resample.polyhedra.polyhedron import (
    OUTSIDE,
    Point,
    Polyhedron,
    between,
    difference,
    dot,
    newell,
    norm,
)
from pipeline.resample.thresholds import Thresholds


class Inheritance(NamedTuple):
    """A vertex takes its attributes from the point at `share` between vertices a and b."""

    vertex: int
    a: int
    b: int
    share: float


def inherited(
    attributes: Mapping[str, AnyArray], inheritance: Sequence[Inheritance], kept: AnyArray
) -> dict[str, AnyArray]:
    """Return the attributes after a frame for the vertices `kept`, by applying the inheritances in order.

    Floating-point numbers mix; integers and flags are those of the nearer parent, `a` on a tie.
    """
    after = {}
    for name, values in attributes.items():
        rows = np.zeros(
            (max([len(values), *(step.vertex + 1 for step in inheritance)]), *values.shape[1:]), values.dtype
        )
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
        a, b = surface.origin[h], surface.origin[h ^ 1]
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
        a, b = surface.origin[h], surface.origin[h ^ 1]
        for v in (a, b):
            for one in surface.star(v):
                self._normals.pop(surface.face[one], None)
        self.collapses += 1
        place = self.place(h, share)
        if share > 0:
            self.inheritance.append(Inheritance(a, a, b, share))
            self.limits.merge(a, b, share)
        return surface.collapse_edge(h, place)

    def place(self, h: int, share: float) -> Point:
        """Return a point on the edge of h; its ends exactly."""
        start = self.surface.points[self.surface.origin[h]]
        end = self.surface.points[self.surface.origin[h ^ 1]]
        if share in (0.0, 1.0):
            return end if share else start
        return between(start, end, share)

    def length(self, h: int) -> float:
        """Return the length of the edge of h, scene units."""
        surface = self.surface
        return norm(difference(surface.points[surface.origin[h]], surface.points[surface.origin[h ^ 1]]))

    def is_too_long(self, h: int) -> bool:
        surface = self.surface
        return self.length(h) > self.limits.max_edge_length(surface.origin[h], surface.origin[h ^ 1])

    def is_too_short(self, h: int) -> bool:
        surface = self.surface
        return self.length(h) < self.limits.min_edge_length(surface.origin[h], surface.origin[h ^ 1])

    def normal(self, f: int) -> Point:
        """Return the Newell vector of a face, twice as long as its area."""
        known = self._normals.get(f)
        if known is None:
            known = self._normals[f] = newell(self.surface.corners(f))
        return known

    def is_hard(self, h: int) -> bool:
        """Tell whether an edge is tagged, on a boundary, or bent by more than the hard angle.

        A face without area does not count (P29, P31).
        """
        surface = self.surface
        f, g = surface.face[h], surface.face[h ^ 1]
        if surface.crease[h >> 1] or f == OUTSIDE or g == OUTSIDE:
            return True
        one, two = self.normal(f), self.normal(g)
        cosine = self.limits.hard_cosine(surface.origin[h], surface.origin[h ^ 1])
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
        """Return the maximum length of the edge between two vertices."""
        return math.sqrt(self._at[a][0] * self._at[b][0])

    def min_edge_length(self, a: int, b: int) -> float:
        """Return the minimum length of the edge between two vertices."""
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
