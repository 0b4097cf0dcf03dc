"""Subdividing edges and faces by planes across their longest dimension (P16-P20; Figure C)."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Literal, NamedTuple

from pipeline.errors import FrameError
from pipeline.resample.polyhedra.geometry import between, box, difference, dot, newell, norm
from pipeline.resample.polyhedra.polyhedron import Point
from pipeline.resample.polyhedra.workpiece import Workpiece

Cutting = Literal["slice", "recurse"]

_LEAST_REACH = 0.25  # of the maximum: a cut that passes a vertex this closely goes through it
_MOST_REACH = 0.49  # of a face's maximum; below half of it every cut makes both parts narrower
_LEAST_PIECE = 1e-3  # of a face's area: what a good chord leaves on either side


class _Plane(NamedTuple):
    """Where coordinate `axis` is `level`; gates up to `reach` away from a vertex go through it."""

    axis: int
    level: float
    reach: float


class _Gate(NamedTuple):
    """Where a plane leaves a face: at `share` of the side of half-edge h; 0 and 1 are its ends."""

    h: int
    share: float
    point: Point


class Slicer:
    """Cuts what is too large; answers to `edges` and `faces` with what may still be.

    "slice" makes all parallel cuts of an element at once, like a bread slicer; "recurse" cuts it in two
    and comes back to the halves.
    """

    def __init__(self, piece: Workpiece, cutting: Cutting) -> None:
        self._piece, self._cutting = piece, cutting

    def edges(self, edges: list[int]) -> None:
        """Split every edge that is too long, given by a half-edge of each, until none is (P8).

        Raises FrameError where the budget of vertices or the precision of numbers does not suffice.
        """
        surface = self._piece.surface
        waiting = edges[::-1]
        while waiting:
            h = waiting.pop()
            if not self._piece.too_long(h):
                continue
            longest = self._piece.bracket.longest(surface.origin[h], surface.origin[h ^ 1])
            ends = surface.points[surface.origin[h]], surface.points[surface.origin[h ^ 1]]
            parts = self._parts(self._piece.length(h), longest)
            if _longest_piece(*ends, parts) > longest and self._cutting == "slice":
                parts += 1
            if between(*ends, 1 / parts) in ends:
                raise _too_far_out(ends[0])
            made = self._piece.split(h, [k / parts for k in range(1, parts)])
            pieces = [h, *(surface.leaving[v] for v in made)]
            waiting += pieces[::-1]

    def faces(self, faces: list[int]) -> tuple[list[int], list[int]]:
        """Cut every face whose box is too long, once round; answers the faces and chords to look at again.

        Raises FrameError as `edges` does.
        """
        surface, pieces = self._piece.surface, []
        edges_before = len(surface.crease)
        for f in faces:
            corners = [surface.origin[h] for h in surface.loop(surface.side[f])]
            axis, low, high = box([surface.points[v] for v in corners])
            limit = self._piece.bracket.widest(corners)
            if high - low <= limit:
                continue
            parts = self._parts(high - low, limit)
            if _widest_slice(low, high, parts) > limit and self._cutting == "slice":
                parts += 1
            mine = [f]
            for level in _levels(low, high, parts)[1:-1]:
                plane = _Plane(axis, level, _MOST_REACH * limit)
                mine = [part for whole in mine for part in self._cut(whole, plane)]
            if mine == [f]:
                raise _too_far_out(surface.points[corners[0]])
            pieces += mine
        made = [2 * e for e in range(edges_before, len(surface.crease))]
        return pieces, made

    def _parts(self, size: float, limit: float) -> int:
        if self._cutting == "recurse":
            return 2
        self._piece.require_room(size / limit - 1)
        return max(2, math.ceil(size / limit))

    def _cut(self, f: int, plane: _Plane) -> list[int]:
        """Cut a face by a plane; answers it and its new parts.

        Gates within reach of a vertex go through it, so that cuts leave no short edges behind. Where
        that would leave the face (it may be concave, or bent), they stay in the plane. Where even the
        plane's own order of gates crosses itself, which happens on faces that are folded, each part
        above the plane is cut off on its own: some cut is always made.
        """
        surface = self._piece.surface
        sides = surface.loop(surface.side[f])
        ups = [surface.points[surface.origin[h]][plane.axis] >= plane.level for h in sides]
        crossed = [h for h, up, next_up in zip(sides, ups, [*ups[1:], ups[0]], strict=True) if up != next_up]
        if not crossed:
            return [f]
        if ups[sides.index(crossed[0])]:
            crossed = [*crossed[1:], crossed[0]]  # pairs in boundary order go round what lies above
        exact = plane._replace(reach=0.0)
        across = self._across(f, crossed, exact)
        for pairs, at, checked in ((across, plane, True), (across, exact, True), (crossed, exact, False)):
            made = [
                part
                for h, k in zip(pairs[::2], pairs[1::2], strict=True)
                for part in self._join(h, k, at, checked)
            ]
            if made:
                return [f, *made]
        return [f]

    def _across(self, f: int, crossed: list[int], plane: _Plane) -> list[int]:
        """Crossed sides in order along the plane: inside lies between first and second, third and fourth."""
        if len(crossed) == 2:
            return crossed
        normal, axis = self._piece.normal(f), plane.axis
        along = [0.0, 0.0, 0.0]
        along[(axis + 1) % 3], along[(axis + 2) % 3] = -normal[(axis + 2) % 3], normal[(axis + 1) % 3]
        direction = along[0], along[1], along[2]
        return sorted(crossed, key=lambda h: dot(self._gate(h, plane).point, direction))

    def _gate(self, h: int, plane: _Plane) -> _Gate:
        surface, piece = self._piece.surface, self._piece
        a, b = surface.origin[h], surface.origin[h ^ 1]
        start, end = surface.points[a], surface.points[b]
        share = (plane.level - start[plane.axis]) / (end[plane.axis] - start[plane.axis])
        point = between(start, end, share)
        near = max(piece.bracket.shortest(a, b), _LEAST_REACH * piece.bracket.longest(a, b))
        if min(share, 1 - share) * piece.length(h) < min(near, plane.reach):
            share = round(share)
        if share <= 0 or point == start:
            return _Gate(h, 0, start)
        if share >= 1 or point == end:
            return _Gate(h, 1, end)
        return _Gate(h, share, point)

    def _join(self, h: int, k: int, plane: _Plane, checked: bool) -> list[int]:
        """Cut the face of h and k between their gates, if that can be; answers the new face, if any."""
        surface = self._piece.surface
        if surface.face[h] != surface.face[k]:
            return []
        one, two = self._gate(h, plane), self._gate(k, plane)
        if not self._is_chord(one, two, checked):
            return []
        begin, end = self._corner(one), self._corner(two)
        chord = self._piece.cut(begin, end)
        return [surface.face[chord]]

    def _is_chord(self, one: _Gate, two: _Gate, checked: bool) -> bool:
        """Whether both sides of the way between two gates are faces, and lie as the whole one does."""
        surface = self._piece.surface
        whole = self._piece.normal(surface.face[one.h])
        least = _LEAST_PIECE * dot(whole, whole)
        for first, last in ((one, two), (two, one)):
            part = self._between(first, last)
            if len(part) < 3 or (checked and dot(newell(part), whole) <= least):
                return False
        return True

    def _between(self, first: _Gate, last: _Gate) -> list[Point]:
        """The corners of a face from one gate to another, both included, each once."""
        surface = self._piece.surface
        vertices, h = [], surface.next[first.h]
        while True:
            vertices.append(surface.origin[h])
            if h == last.h:
                break
            h = surface.next[h]
        if first.share == 1:
            vertices = vertices[1:]
        if last.share == 0:
            vertices = vertices[:-1]
        return [first.point, *(surface.points[v] for v in vertices), last.point]

    def _corner(self, gate: _Gate) -> int:
        """The half-edge that leaves a gate within its face; splits its side where it is no corner yet."""
        surface = self._piece.surface
        if gate.share == 0:
            return gate.h
        if gate.share < 1:
            self._piece.split(gate.h, [gate.share])
        return surface.next[gate.h]


def _too_far_out(point: Point) -> FrameError:
    return FrameError(
        f"an element at {point} is too large, but too far out for numbers to tell its parts apart; "
        "keep the surface nearer to the origin"
    )


def _levels(low: float, high: float, parts: int) -> list[float]:
    """Where planes cut a length into equal parts, and its two ends."""
    return [*(low + (high - low) * k / parts for k in range(parts)), high]


def _widest_slice(low: float, high: float, parts: int) -> float:
    """The largest of equal parts, which rounding makes unequal."""
    return max(there - here for here, there in pairwise(_levels(low, high, parts)))


def _longest_piece(start: Point, end: Point, parts: int) -> float:
    """The longest of equal parts of an edge, which rounding makes unequal."""
    points = [*(between(start, end, k / parts) for k in range(parts)), end]
    return max(norm(difference(there, here)) for here, there in pairwise(points))
