"""Subdivide and unsubdivide polyhedra: cut what is too large, remove what is too small.

Edges and faces are cut by planes across their longest dimension (P16-P20; Figure C). What is too small is
collapsed where it may be (P9, P22, P27-P32).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from itertools import pairwise
from typing import NamedTuple

from flowsculpt import FrameError
from flowsculpt.pipeline.plugins.polyhedra.polyhedron import (
    OUTSIDE,
    Cutting,
    Point,
    PolyhedronEditor,
    between,
    box,
    difference,
    dot,
    newell,
    norm,
)

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


_EQUILATERAL = math.sqrt(3) / 4  # area of a triangle over its side squared


class Collapser:
    """Collapses what is too small where it may; counts the rest by reason.

    refused   edges that are still too short, by reason (P9)
    """

    def __init__(self, editor: PolyhedronEditor) -> None:
        self._editor = editor
        self.refused: Counter[str] = Counter()

    def edges(self, edges: Iterable[int]) -> None:
        """Collapse every short edge that may collapse, the shortest first (the paper's choice).

        Includes edges that a collapse makes short. A refused edge is tried again once a face around it has
        changed.
        """
        queue, refused = self._short(edges), dict[int, str]()
        while queue:
            changed: set[int] = set()
            for h in queue:  # it grows as it is worked through
                if not self._is_short(h):
                    continue
                decision = can_collapse(self._editor, h)
                if decision.share is None:
                    refused[h] = decision.reason
                else:
                    refused.pop(h, None)
                    queue += self._short(self._collapse(h, decision.share, changed))
            queue = [h for h in refused if not changed.isdisjoint(self._editor.surface.ends(h))]
        self.refused = Counter(reason for h, reason in refused.items() if self._is_short(h))

    def faces(self, faces: Iterable[int], edges: Iterable[int]) -> None:
        """Collapse every face smaller than a triangle with the shortest sides (P22).

        The option that the paper tried and abandoned. A face collapses edge by edge, each under the rules of
        any edge. Afterwards the short edges among `edges` and the changed ones are counted; where one may
        collapse but its faces are large enough, the reason is `area`.
        """
        queue, seen = list(faces), dict.fromkeys(edges)
        for f in queue:  # it grows as it is worked through
            if self._is_small(f):
                around = self._shrink(f)
                seen |= dict.fromkeys(around)
                queue += dict.fromkeys(self._editor.surface.face[h ^ side] for h in around for side in (0, 1))
        self.refused = Counter(can_collapse(self._editor, h).reason or "area" for h in self._short(seen))

    def _shrink(self, f: int) -> list[int]:
        """Merge the corners of a face as far as possible; return the edges around the merged vertices."""
        surface, around = self._editor.surface, []
        corners = surface.vertices(f)
        while True:
            inner = [h & ~1 for v in corners for h in surface.star(v) if surface.origin[h ^ 1] in corners]
            inner = sorted(set(inner), key=lambda h: (self._editor.length(h), h))
            for h in inner:
                decision = can_collapse(self._editor, h)
                if decision.share is not None:
                    corners.remove(surface.origin[h ^ 1])
                    around += self._collapse(h, decision.share, set())
                    break
            else:
                return [h for h in around if surface.origin[h] != OUTSIDE]

    def _collapse(self, h: int, share: float, changed: set[int]) -> list[int]:
        """Collapse an edge, record the corners of changed faces, and return the edges around."""
        surface = self._editor.surface
        vertex = self._editor.collapse(h, share)
        star = surface.star(vertex)
        for k in star:
            changed.update(surface.origin[one] for one in surface.loop(k))
        changed.update(surface.origin[k ^ 1] for k in star)
        return [k & ~1 for k in star]

    def _is_short(self, h: int) -> bool:
        return self._editor.surface.origin[h] != OUTSIDE and self._editor.is_too_short(h)

    def _short(self, edges: Iterable[int]) -> list[int]:
        """Return the edges that are too short, each once by its first half-edge, the shortest first."""
        once = dict.fromkeys(h & ~1 for h in edges)
        return sorted((h for h in once if self._is_short(h)), key=lambda h: (self._editor.length(h), h))

    def _is_small(self, f: int) -> bool:
        surface, limits = self._editor.surface, self._editor.limits
        if f == OUTSIDE or surface.side[f] == OUTSIDE:
            return False
        least = min(limits.min_edge_length(v, v) for v in surface.vertices(f))
        return 0.5 * norm(self._editor.normal(f)) < _EQUILATERAL * least * least


START, MIDDLE, END = 0.0, 0.5, 1.0  # position of the merged vertex, as a share of the edge

_MAX_TURN_COSINE = 0.2  # a face turns by at most 78 degrees in one collapse
_THIN = 0.02  # twice the area over the longest side of the box squared; below it a face counts as a sliver
_STRAIGHT = 0.9962  # cosine of 5 degrees: a crease that turns less is a straight line
_CORNER = 3  # a vertex with that many hard edges is a corner


class Decision(NamedTuple):
    """`share` is the position that the edge may collapse to; None if it may not, and `reason` says why."""

    share: float | None
    reason: str = ""


class _End(NamedTuple):
    """One end of an edge: its vertex, the half-edges that leave it, and the hard ones of these."""

    vertex: int
    star: list[int]
    hard: list[int]


def can_collapse(editor: PolyhedronEditor, h: int) -> Decision:
    """Decide whether the edge of h may collapse, and to which share of its length, by the rules of version 2.

    Reasons as in `flowsculpt.pipeline.resample.resample_pass`: link, boundary, feature, too_long, fold.
    """
    near, far = _end(editor, h), _end(editor, h ^ 1)
    fault = _link_fault(editor, h, near, far)
    if fault:
        return Decision(None, fault)
    reason = "feature"
    for share in _candidates(editor, h, near, far):
        fault = _position_fault(editor, h, near, far, share)
        if not fault:
            return Decision(share)
        if reason == "feature":
            reason = fault
    return Decision(None, reason)


def _end(editor: PolyhedronEditor, h: int) -> _End:
    surface = editor.surface
    star = surface.star(surface.origin[h])
    return _End(surface.origin[h], star, [one for one in star if editor.is_hard(one)])


def _link_fault(editor: PolyhedronEditor, h: int, near: _End, far: _End) -> str:
    """Return "link" or "boundary" if the surface would no longer be a manifold, else "".

    A neighbour of both ends must be the third corner of a triangle on the edge, and no other face may have
    both ends. Else two edges would join the same vertices, or a face would touch itself.
    """
    surface = editor.surface
    face, origin = surface.face, surface.origin
    beside = [face[h], face[h ^ 1]]
    faces_near, faces_far = ({face[k] for k in end.star} for end in (near, far))
    if OUTSIDE not in beside and OUTSIDE in faces_near and OUTSIDE in faces_far:
        return "boundary"
    inner = [k for k in (h, h ^ 1) if face[k] != OUTSIDE]
    triangles = [k for k in inner if surface.previous[surface.previous[k]] == surface.next[k]]
    mine, theirs = ({origin[k ^ 1] for k in end.star} for end in (near, far))
    tips = {origin[surface.previous[k]] for k in triangles}
    if mine & theirs != tips or len(tips) != len(triangles):
        return "link"
    if faces_near & faces_far - {OUTSIDE} != set(beside) - {OUTSIDE}:
        return "link"
    for k in triangles:
        one, two = face[surface.next[k] ^ 1], face[surface.previous[k] ^ 1]
        if one == OUTSIDE and two == OUTSIDE:
            return "boundary"
        if _would_double(editor, one, two, near.vertex, far.vertex):
            return "link"
    return ""


def _would_double(editor: PolyhedronEditor, f: int, g: int, keep: int, gone: int) -> bool:
    """Tell whether two faces would have the same vertices after `gone` merges into `keep`."""
    if OUTSIDE in (f, g):
        return False
    one, two = (set(editor.surface.vertices(face)) for face in (f, g))
    return {keep if v == gone else v for v in one} == {keep if v == gone else v for v in two}


def _candidates(editor: PolyhedronEditor, h: int, near: _End, far: _End) -> tuple[float, ...]:
    """Return the positions allowed for the merged vertex, best first; none where a feature forbids it.

    The end with more hard edges keeps its position (P30). Ties: soft ends take the midpoint (P27) or else
    either end; two vertices of one crease take the midpoint where it is straight, else the end with the
    sharper turn. Corners never merge, and two creases never merge across the surface between them, which
    keeps a tendril alive (P32).
    """
    mine, theirs = _rank(editor, near), _rank(editor, far)
    along = h in near.hard
    if mine >= 2 and theirs >= 2 and (not along or (mine >= _CORNER and theirs >= _CORNER)):
        return ()
    if mine != theirs:
        return (START,) if mine > theirs else (END,)
    if mine < 2:
        return (MIDDLE, START, END)
    one, two = _turn_cosine(editor, near, far.vertex), _turn_cosine(editor, far, near.vertex)
    if one > _STRAIGHT and two > _STRAIGHT:
        return (MIDDLE, START, END)
    if one <= two:
        return (START, END) if one > _STRAIGHT else (START,)
    return (END, START) if two > _STRAIGHT else (END,)


def _rank(editor: PolyhedronEditor, end: _End) -> int:
    """Return the number of hard edges at a vertex; 3 where a crease turns by more than the hard angle."""
    if len(end.hard) != 2:
        return len(end.hard)
    other = editor.surface.origin[end.hard[0] ^ 1]
    cosine = editor.limits.hard_cosine(end.vertex, other)
    return _CORNER if _turn_cosine(editor, end, other) < cosine else 2


def _turn_cosine(editor: PolyhedronEditor, end: _End, other: int) -> float:
    """Return the cosine of the turn that a crease makes at a vertex, from `other` to its second hard edge."""
    points, origin = editor.surface.points, editor.surface.origin
    centre = points[end.vertex]
    for k in end.hard:
        v = origin[k ^ 1]
        if v != other:
            back, on = difference(centre, points[v]), difference(points[other], centre)
            lengths = norm(back) * norm(on)
            return dot(back, on) / lengths if lengths else 1.0
    return -1.0


def _position_fault(editor: PolyhedronEditor, h: int, near: _End, far: _End, share: float) -> str:
    """Return "too_long" or "fold" if the merged vertex may not lie there, else ""."""
    surface = editor.surface
    place = editor.place(h, share)
    merged = {near.vertex: place, far.vertex: place}
    stay = [near] if share == START else [far] if share == END else []
    around = [surface.origin[k ^ 1] for end in (near, far) if end not in stay for k in end.star]
    for v in around:
        if v not in merged:
            # the merged vertex has limits between those of the ends; test the stricter ones
            limit = min(editor.limits.max_edge_length(u, v) for u in merged)
            if norm(difference(surface.points[v], place)) > limit:
                return "too_long"
    faces = dict.fromkeys(surface.face[k] for end in (near, far) for k in end.star)
    beside = {surface.face[h], surface.face[h ^ 1]}
    unchanged = {surface.face[k] for end in stay for k in end.star} - beside
    changed = (f for f in faces if f != OUTSIDE and f not in unchanged)
    return next(filter(None, (_face_fault(editor, f, merged, place) for f in changed)), "")


def _face_fault(editor: PolyhedronEditor, f: int, merged: dict[int, Point], place: Point) -> str:
    surface = editor.surface
    vertices = surface.vertices(f)
    rest = [v for v in vertices if v not in merged]
    if len(rest) == len(vertices) - 2:  # the face has both ends, and loses one
        at = next(i for i, v in enumerate(vertices) if v in merged and vertices[i - 1] not in merged)
        turned = vertices[at + 1 :] + vertices[:at]
        polygon = [place, *(surface.points[v] for v in turned if v not in merged)]
    else:
        polygon = [merged.get(v, surface.points[v]) for v in vertices]
    if len(polygon) < 3:
        return ""
    old, new = editor.normal(f), newell(polygon)
    was, now = norm(old), norm(new)
    if was > 0 and dot(old, new) <= _MAX_TURN_COSINE * was * now:
        return "fold"
    _, low, high = box(polygon)
    if high - low > editor.limits.max_face_size(vertices):
        return "too_long"
    if now < _THIN * (high - low) ** 2 and now < was:
        return "fold"
    return ""
