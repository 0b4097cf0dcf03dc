"""May this edge collapse, and where to? The guards of unsubdivision (P9, P27-P32)."""

from __future__ import annotations

from typing import NamedTuple

from pipeline.resample.polyhedra.geometry import box, difference, dot, newell, norm
from pipeline.resample.polyhedra.polyhedron import OUTSIDE, Point
from pipeline.resample.polyhedra.workpiece import Workpiece

START, MIDDLE, END = 0.0, 0.5, 1.0
"""Where the remaining vertex may lie, as a share of the edge."""

_LEAST_COSINE = 0.2  # a face may turn by 78 degrees in one collapse, not more
_THIN = 0.02  # twice the area over the longest side of the box squared; below it a face counts as a sliver
_STRAIGHT = 0.9962  # cosine of 5 degrees: a crease that bends less is a straight line
_CORNER = 3  # a vertex with that many hard edges is a corner


class Verdict(NamedTuple):
    """`share` says where the edge may collapse to; where it may not, it is None and `reason` says why."""

    share: float | None
    reason: str = ""


class _End(NamedTuple):
    """One end of an edge: its vertex, the half-edges that leave it, and which of these are hard."""

    vertex: int
    star: list[int]
    hard: list[int]


def judge(piece: Workpiece, h: int) -> Verdict:
    """Whether the edge of h may collapse, and to which share of its length, by the rules of version 2.

    Reasons as in `pipeline.resample.report`: link, boundary, feature, too_long, fold.
    """
    near, far = _end(piece, h), _end(piece, h ^ 1)
    fault = _link_fault(piece, h, near, far)
    if fault:
        return Verdict(None, fault)
    reason = "feature"
    for share in _candidates(piece, h, near, far):
        fault = _move_fault(piece, h, near, far, share)
        if not fault:
            return Verdict(share)
        if reason == "feature":
            reason = fault
    return Verdict(None, reason)


def _end(piece: Workpiece, h: int) -> _End:
    surface = piece.surface
    star = surface.star(surface.origin[h])
    return _End(surface.origin[h], star, [one for one in star if piece.hard(one)])


def _link_fault(piece: Workpiece, h: int, near: _End, far: _End) -> str:
    """Why the surface would no longer be one: the two ends may share their edge's faces, and no more.

    A neighbour of both ends must be the third corner of a triangle on the edge, and no other face may
    name both ends; else two edges would join the same vertices, or a face would touch itself.
    """
    surface = piece.surface
    face, origin = surface.face, surface.origin
    beside = [face[h], face[h ^ 1]]
    if OUTSIDE not in beside and _on_boundary(piece, near) and _on_boundary(piece, far):
        return "boundary"
    triangles = [
        k
        for k in (h, h ^ 1)
        if face[k] != OUTSIDE and surface.previous[surface.previous[k]] == surface.next[k]
    ]
    mine, theirs = ({origin[k ^ 1] for k in end.star} for end in (near, far))
    tips = {origin[surface.previous[k]] for k in triangles}
    if mine & theirs != tips or len(tips) != len(triangles):
        return "link"
    faces_near, faces_far = ({face[k] for k in end.star} - {OUTSIDE} for end in (near, far))
    if faces_near & faces_far != set(beside) - {OUTSIDE}:
        return "link"
    for k in triangles:
        one, two = face[surface.next[k] ^ 1], face[surface.previous[k] ^ 1]
        if one == OUTSIDE and two == OUTSIDE:
            return "boundary"
        if _back_to_back(piece, one, two, near.vertex, far.vertex):
            return "link"
    return ""


def _on_boundary(piece: Workpiece, end: _End) -> bool:
    return any(piece.surface.face[k] == OUTSIDE for k in end.star)


def _back_to_back(piece: Workpiece, f: int, g: int, keep: int, gone: int) -> bool:
    """Whether two faces would have the same vertices once `gone` is merged into `keep`."""
    if OUTSIDE in (f, g):
        return False
    surface = piece.surface
    one, two = (
        {keep if v == gone else v for v in (surface.origin[k] for k in surface.loop(surface.side[face]))}
        for face in (f, g)
    )
    return one == two


def _candidates(piece: Workpiece, h: int, near: _End, far: _End) -> tuple[float, ...]:
    """Where the remaining vertex may lie, best first; none where a feature forbids it.

    The end with more hard edges wins and keeps its position (P30). Ties: soft ends take the midpoint
    (P27) or else either end; two vertices of one crease take the midpoint where it is straight, or else
    the end where it bends more. Corners never move into each other, and two creases never merge across
    the surface between them, which keeps a tendril alive (P32).
    """
    mine, theirs = _rank(piece, near), _rank(piece, far)
    along = h in near.hard
    if mine >= 2 and theirs >= 2 and (not along or (mine >= _CORNER and theirs >= _CORNER)):
        return ()
    if mine != theirs:
        return (START,) if mine > theirs else (END,)
    if mine < 2:
        return (MIDDLE, START, END)
    one, two = _bend(piece, near, far.vertex), _bend(piece, far, near.vertex)
    if one > _STRAIGHT and two > _STRAIGHT:
        return (MIDDLE, START, END)
    if one <= two:
        return (START, END) if one > _STRAIGHT else (START,)
    return (END, START) if two > _STRAIGHT else (END,)


def _rank(piece: Workpiece, end: _End) -> int:
    """Hard edges at a vertex; a crease that turns by more than the hard angle makes it a corner."""
    if len(end.hard) != 2:
        return len(end.hard)
    other = piece.surface.origin[end.hard[0] ^ 1]
    cosine = piece.bracket.cosine(end.vertex, other)
    return _CORNER if _bend(piece, end, other) < cosine else 2


def _bend(piece: Workpiece, end: _End, other: int) -> float:
    """Cosine of the turn that a crease makes at a vertex between `other` and its second hard edge."""
    points, origin = piece.surface.points, piece.surface.origin
    here = points[end.vertex]
    for k in end.hard:
        v = origin[k ^ 1]
        if v != other:
            back, on = difference(here, points[v]), difference(points[other], here)
            lengths = norm(back) * norm(on)
            return dot(back, on) / lengths if lengths else 1.0
    return -1.0


def _move_fault(piece: Workpiece, h: int, near: _End, far: _End, share: float) -> str:
    """Why the merged vertex may not lie there: something would be too long, or a face would fold."""
    surface = piece.surface
    place = piece.place(h, share)
    merged = {near.vertex: place, far.vertex: place}
    for end in (near, far):
        if (share == START and end is near) or (share == END and end is far):
            continue
        for k in end.star:
            v = surface.origin[k ^ 1]
            if v not in merged:
                # the merged vertex has thresholds between those of the ends; the stricter is asked for
                limit = min(piece.bracket.longest(u, v) for u in merged)
                if norm(difference(surface.points[v], place)) > limit:
                    return "too_long"
    stays = near if share == START else far if share == END else None
    known = (
        set()
        if stays is None
        else {surface.face[k] for k in stays.star} - {surface.face[h], surface.face[h ^ 1]}
    )
    faces = {surface.face[k]: None for end in (near, far) for k in end.star if surface.face[k] != OUTSIDE}
    for f in faces:
        if f not in known:
            fault = _face_fault(piece, f, merged, place)
            if fault:
                return fault
    return ""


def _face_fault(piece: Workpiece, f: int, merged: dict[int, Point], place: Point) -> str:
    surface = piece.surface
    vertices = [surface.origin[k] for k in surface.loop(surface.side[f])]
    rest = [v for v in vertices if v not in merged]
    if len(rest) == len(vertices) - 2:  # the face has both ends, and one of them goes
        at = next(i for i, v in enumerate(vertices) if v in merged and vertices[i - 1] not in merged)
        turned = vertices[at + 1 :] + vertices[:at]
        polygon = [place, *(surface.points[v] for v in turned if v not in merged)]
    else:
        polygon = [merged.get(v, surface.points[v]) for v in vertices]
    if len(polygon) < 3:
        return ""
    old, new = piece.normal(f), newell(polygon)
    was, now = norm(old), norm(new)
    if was > 0 and dot(old, new) <= _LEAST_COSINE * was * now:
        return "fold"
    _, low, high = box(polygon)
    if high - low > piece.bracket.widest(vertices):
        return "too_long"
    if now < _THIN * (high - low) ** 2 and now < was:
        return "fold"
    return ""
