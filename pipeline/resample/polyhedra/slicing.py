"""Subdivide edges and faces by planes across their longest dimension (P16-P20; Figure C)."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Literal, NamedTuple

from pipeline.errors import FrameError
from pipeline.resample.polyhedra.polyhedron import (
    Point,
    PolyhedronEditor,
    between,
    box,
    difference,
    dot,
    newell,
    norm,
)

Cutting = Literal["slice", "recurse"]

_MIN_SNAP = 0.25  # of the maximum: a cut that passes a vertex more closely goes through it
_MAX_SNAP = 0.49  # of a face's maximum; below half of it every cut makes both parts narrower
_MIN_PART = 1e-3  # of a face's area: the least part beside a good chord


class _Plane(NamedTuple):
    """The plane where coordinate `axis` is `level`; crossings within `snap` of a vertex go through it."""

    axis: int
    level: float
    snap: float


class _Crossing(NamedTuple):
    """The point where a plane leaves a face: at `share` of the side of half-edge h; 0 and 1 are its ends."""

    h: int
    share: float
    point: Point


class Slicer:
    """Cuts what is too large.

    "slice" makes all parallel cuts of an element at once, like a bread slicer; "recurse" cuts it in two and
    returns to the halves.
    """

    def __init__(self, editor: PolyhedronEditor, cutting: Cutting) -> None:
        self._editor, self._cutting = editor, cutting

    def edges(self, edges: list[int]) -> None:
        """Split every edge that is too long, given by one half-edge each, until none is (P8).

        Raises FrameError where the vertices would exceed the budget, or coordinates have too few digits.
        """
        surface = self._editor.surface
        waiting = edges[::-1]
        while waiting:
            h = waiting.pop()
            if not self._editor.is_too_long(h):
                continue
            a, b = surface.ends(h)
            limit, ends = self._editor.limits.max_edge_length(a, b), (surface.points[a], surface.points[b])
            parts = self._parts(self._editor.length(h), limit)
            if _longest_piece(*ends, parts) > limit and self._cutting == "slice":
                parts += 1
            if between(*ends, 1 / parts) in ends:
                raise _too_far_out(ends[0])
            made = self._editor.split(h, [k / parts for k in range(1, parts)])
            pieces = [h, *(surface.leaving[v] for v in made)]
            waiting += pieces[::-1]

    def faces(self, faces: list[int]) -> tuple[list[int], list[int]]:
        """Cut every face whose bounding box is too long, once; return the faces and chords to test again.

        Raises FrameError as `edges` does.
        """
        surface, pieces = self._editor.surface, []
        edges_before = len(surface.crease)
        for f in faces:
            corners = surface.vertices(f)
            axis, low, high = box(surface.corners(f))
            limit = self._editor.limits.max_face_size(corners)
            if high - low <= limit:
                continue
            parts = self._parts(high - low, limit)
            if _widest_slice(low, high, parts) > limit and self._cutting == "slice":
                parts += 1
            planes = [_Plane(axis, at, _MAX_SNAP * limit) for at in _levels(low, high, parts)[1:-1]]
            mine = self._slice(f, planes)
            if mine == [f]:
                raise _too_far_out(surface.points[corners[0]])
            pieces += mine
        made = [2 * e for e in range(edges_before, len(surface.crease))]
        return pieces, made

    def _parts(self, size: float, limit: float) -> int:
        if self._cutting == "recurse":
            return 2
        self._editor.keep_to_budget(size / limit - 1)
        return max(2, math.ceil(size / limit))

    def _slice(self, f: int, planes: list[_Plane]) -> list[int]:
        """Cut a face by parallel planes in ascending order; return it and its new parts.

        The middle plane cuts first, and then those on either side cut the parts that they cross: a cut walks
        around its whole face, so that cutting slice after slice off a long face would take quadratic time.
        """
        surface, pieces, waiting = self._editor.surface, [], [(f, planes)]
        while waiting:
            part, rest = waiting.pop()
            along = [point[planes[0].axis] for point in surface.corners(part)]
            low, high = min(along), max(along)
            rest = [plane for plane in rest if low < plane.level <= high]
            if not rest:
                pieces.append(part)
                continue
            middle = rest.pop(len(rest) // 2)
            waiting += [(piece, rest) for piece in reversed(self._cut(part, middle))]
        return pieces

    def _cut(self, f: int, plane: _Plane) -> list[int]:
        """Cut a face by a plane; return it and its new parts.

        Crossings near a vertex snap to it, so that cuts leave no short edges behind. Where the chord would
        then leave the face (it may be concave, or bent), they stay in the plane. Where even the plane's own
        order of crossings crosses itself, as on folded faces, each part above the plane is cut off on its
        own: some cut is always made.
        """
        surface = self._editor.surface
        sides = surface.loop(surface.side[f])
        ups = [surface.points[surface.origin[h]][plane.axis] >= plane.level for h in sides]
        crossed = [h for h, up, next_up in zip(sides, ups, [*ups[1:], ups[0]], strict=True) if up != next_up]
        if not crossed:
            return [f]
        if ups[sides.index(crossed[0])]:
            crossed = [*crossed[1:], crossed[0]]  # so that pairs enclose the parts above the plane
        exact = plane._replace(snap=0.0)
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
        """Return crossed sides in order along the plane; pairs of them enclose the inside of the face."""
        if len(crossed) == 2:
            return crossed
        normal, axis = self._editor.normal(f), plane.axis
        along = [0.0, 0.0, 0.0]
        along[(axis + 1) % 3], along[(axis + 2) % 3] = -normal[(axis + 2) % 3], normal[(axis + 1) % 3]
        direction = along[0], along[1], along[2]
        return sorted(crossed, key=lambda h: dot(self._crossing(h, plane).point, direction))

    def _crossing(self, h: int, plane: _Plane) -> _Crossing:
        surface, editor = self._editor.surface, self._editor
        a, b = surface.ends(h)
        start, end = surface.points[a], surface.points[b]
        share = (plane.level - start[plane.axis]) / (end[plane.axis] - start[plane.axis])
        point = between(start, end, share)
        near = max(editor.limits.min_edge_length(a, b), _MIN_SNAP * editor.limits.max_edge_length(a, b))
        if min(share, 1 - share) * editor.length(h) < min(near, plane.snap):
            share = round(share)
        if share <= 0 or point == start:
            return _Crossing(h, 0, start)
        if share >= 1 or point == end:
            return _Crossing(h, 1, end)
        return _Crossing(h, share, point)

    def _join(self, h: int, k: int, plane: _Plane, checked: bool) -> list[int]:
        """Cut the face of h and k between their crossings, if possible; return the new face, if any."""
        surface = self._editor.surface
        if surface.face[h] != surface.face[k]:
            return []
        one, two = self._crossing(h, plane), self._crossing(k, plane)
        if not self._is_chord(one, two, checked):
            return []
        return [surface.face[self._editor.cut(self._corner(one), self._corner(two))]]

    def _is_chord(self, one: _Crossing, two: _Crossing, checked: bool) -> bool:
        """Tell whether both sides of the line between two crossings are faces oriented like the whole one."""
        surface = self._editor.surface
        whole = self._editor.normal(surface.face[one.h])
        least = _MIN_PART * dot(whole, whole)
        for first, last in ((one, two), (two, one)):
            part = self._between(first, last)
            if len(part) < 3 or (checked and dot(newell(part), whole) <= least):
                return False
        return True

    def _between(self, first: _Crossing, last: _Crossing) -> list[Point]:
        """Return the corners of a face from one crossing to another, both included, each once."""
        surface = self._editor.surface
        sides = surface.loop(surface.next[first.h])
        vertices = [surface.origin[h] for h in sides[: sides.index(last.h) + 1]]
        if first.share == 1:
            vertices = vertices[1:]
        if last.share == 0:
            vertices = vertices[:-1]
        return [first.point, *(surface.points[v] for v in vertices), last.point]

    def _corner(self, gate: _Crossing) -> int:
        """Return the half-edge that leaves a crossing within its face; splits the side if necessary."""
        surface = self._editor.surface
        if gate.share == 0:
            return gate.h
        if gate.share < 1:
            self._editor.split(gate.h, [gate.share])
        return surface.next[gate.h]


def _too_far_out(point: Point) -> FrameError:
    return FrameError(
        f"an edge or face at {point} is too large, but too far out for its parts to have different "
        "coordinates; keep the surface nearer to the origin"
    )


def _levels(low: float, high: float, parts: int) -> list[float]:
    """Return the planes that cut a length into equal parts, and its two ends."""
    return [*(low + (high - low) * k / parts for k in range(parts)), high]


def _widest_slice(low: float, high: float, parts: int) -> float:
    """Return the largest of the parts, which rounding makes unequal."""
    return max(end - start for start, end in pairwise(_levels(low, high, parts)))


def _longest_piece(start: Point, end: Point, parts: int) -> float:
    """Return the longest of the parts of an edge, which rounding makes unequal."""
    points = [*(between(start, end, k / parts) for k in range(parts)), end]
    return max(norm(difference(b, a)) for a, b in pairwise(points))
