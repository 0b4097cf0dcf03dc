"""Unsubdivision: which edges may collapse; removing edges or faces that are too small (P9, P22, P27-P32)."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

from pipeline.resample.polyhedra.polyhedron import (
    OUTSIDE,
    Point,
    PolyhedronEditor,
    box,
    difference,
    dot,
    newell,
    norm,
)

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


START, MIDDLE, END = 0.0, 0.5, 1.0
"""Position of the merged vertex, as a share of the edge."""

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

    Reasons as in `pipeline.resample.resample_pass`: link, boundary, feature, too_long, fold.
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
