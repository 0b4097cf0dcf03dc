"""Collapsing short edges (Figure E; P9, P27) without losing creases, tendrils or the surface (P28-P33)."""

from __future__ import annotations

import numba
import numpy as np

from pipeline.arrays import Floats, Indices, Points
from pipeline.kernels import kernel
from pipeline.mesh._kernels_halfedge import (
    INTS,
    LEAN,
    MATRIX,
    SURFACE,
    VECTOR,
    Surface,
    following,
    join,
    preceding,
)
from pipeline.resample._kernels_lists import (
    CHANGED,
    CHANGES,
    DUE,
    FRESH,
    REFUSED,
    UNLISTED,
    Changes,
    bracket,
    enlist,
    hard_cosine,
    is_short,
    push,
    squared,
    touch,
)
from pipeline.resample._kernels_rest import overturns
from pipeline.resample._kernels_ring import (
    FOLDED,
    MOST_SPOKES,
    NX,
    NY,
    NZ,
    RING,
    STRETCHED,
    UPRIGHT,
    Ring,
    strained,
    walk,
    weigh,
)

REASONS = ("link", "boundary", "feature", "too_long", "fold", "shape", "crowded")
LINK, BOUNDARY, FEATURE, TOO_LONG, FOLD, SHAPE, CROWDED = range(7)
FREE = -1

AT_START, AT_END, AT_MIDDLE = 0, 1, 2
RINGS = numba.types.UniTuple(RING, 2)
_REACH = 0.05  # how far, in longest edges, a vertex that goes may have been from what stays
_STRAIGHT = 0.9962  # cosine of 5 degrees: a crease that bends less is a straight line


@kernel(numba.boolean(RING, RING), **LEAN)
def _meet(near: Ring, far: Ring) -> bool:
    """Whether closed rings of the two ends of an edge share more than the corners opposite that edge.

    Each begins with the other end, which those two corners follow and precede. Rings of three faces both are
    a tetrahedron's.
    """
    shared = bool(near.size[1] == 3 and far.size[1] == 3)
    for i in range(2, near.size[1] - 1):
        for j in range(2, far.size[1] - 1):
            shared |= bool(near.vertex[i] == far.vertex[j])
    return shared


@kernel(numba.int64(SURFACE, numba.int64, RING, RING), **LEAN)
def _link_fault(surface: Surface, h: int, near: Ring, far: Ring) -> int:
    """The link condition: the two ends may share only the corners opposite their edge."""
    vert, twin = surface.vert, surface.twin
    if near.size[1] == near.size[0] and far.size[1] == far.size[0]:
        return LINK if _meet(near, far) else FREE
    back = twin[h]
    if back >= 0 and near.size[1] > near.size[0] and far.size[1] > far.size[0]:
        return BOUNDARY
    shared = 0
    for i in range(near.size[1]):
        for j in range(far.size[1]):
            shared += near.vertex[i] == far.vertex[j]
    if shared != (1 if back < 0 else 2):
        return LINK
    sides = 1 if back < 0 else 2
    for side in range(sides):
        k = h if side == 0 else back
        one, two = twin[following(k)], twin[preceding(k)]
        if one < 0 and two < 0:
            return BOUNDARY
        if one >= 0 and two >= 0 and vert[preceding(one)] == vert[preceding(two)]:
            return LINK
    return FREE


@kernel(numba.float64(SURFACE, numba.int64, numba.int64, RING), **LEAN)
def _bend(surface: Surface, centre: int, other: int, ring: Ring) -> float:
    """Cosine of the turn that a crease through `centre` makes between `other` and its second hard spoke."""
    points = surface.points
    for i in range(ring.size[1]):
        v = ring.vertex[i]
        if ring.hard[i] and v != other:
            dot = 0.0
            for k in range(3):
                dot += (points[centre, k] - points[v, k]) * (points[other, k] - points[centre, k])
            lengths = np.sqrt(squared(points, centre, v) * squared(points, other, centre))
            return dot / lengths if lengths > 0 else 1.0
    return -1.0


@kernel(numba.int64(SURFACE, numba.int64, RING, numba.float64), **LEAN)
def _rank(surface: Surface, centre: int, ring: Ring, cosine: float) -> int:
    """Hard edges at a vertex; a crease that turns by more than the hard angle makes a corner, ranked 3."""
    if ring.size[2] != 2:
        return int(ring.size[2])
    other = -1
    for i in range(ring.size[1]):
        if ring.hard[i]:
            other = ring.vertex[i]
    return 3 if _bend(surface, centre, other, ring) < cosine else 2


@kernel(numba.float64(MATRIX, numba.int64, numba.int64, RING), **LEAN)
def _swept(points: Points, centre: int, to: int, ring: Ring) -> float:
    """Six times the volume that a ring sweeps if its centre moves to another vertex."""
    total, rows = 0.0, ring.rows
    x = points[to, 0] - points[centre, 0]
    y = points[to, 1] - points[centre, 1]
    z = points[to, 2] - points[centre, 2]
    for j in range(1, ring.size[0] + 1):
        i = np.uint64(j)
        total += x * rows[NX + i] + y * rows[NY + i] + z * rows[NZ + i]
    return abs(total)


@kernel(numba.types.UniTuple(numba.int64, 3)(SURFACE, numba.int64, RING, RING, VECTOR), **LEAN)
def _candidates(surface: Surface, h: int, near: Ring, far: Ring, limits: Floats) -> tuple[int, int, int]:
    """Where the remaining vertex may lie, best first; FREE fills up, all FREE means a feature forbids it.

    The end with more hard edges wins and keeps its position (P30). Ties are ours: soft ends take the
    midpoint (P27) or else the end that changes the volume less. Two vertices of one crease take the midpoint
    where the crease is straight, or else the end where it bends more. Corners never move into each other,
    and two creases are never merged across the soft surface between them: that keeps a tendril alive (P32).
    """
    a, b = surface.vert[h], surface.vert[following(h)]
    midpoints = limits[3] > 0
    mine = _rank(surface, a, near, hard_cosine(surface, limits, a))
    theirs = _rank(surface, b, far, hard_cosine(surface, limits, b))
    if mine >= 2 and theirs >= 2:
        hard = False
        for i in range(near.size[1]):
            hard = hard or (near.vertex[i] == b and near.hard[i] > 0)
        if not hard or (mine >= 3 and theirs >= 3):
            return FREE, FREE, FREE
    if mine > theirs:
        return AT_START, FREE, FREE
    if theirs > mine:
        return AT_END, FREE, FREE
    if mine < 2 and midpoints:
        return AT_MIDDLE, AT_START, AT_END
    if mine < 2:
        at_start, at_end = _swept(surface.points, b, a, far), _swept(surface.points, a, b, near)
        return (AT_START, AT_END, FREE) if at_start <= at_end else (AT_END, AT_START, FREE)
    one, two = _bend(surface, a, b, near), _bend(surface, b, a, far)
    if one > _STRAIGHT and two > _STRAIGHT:
        return (AT_MIDDLE, AT_START, AT_END) if midpoints else (AT_START, AT_END, FREE)
    if one <= two:
        return AT_START, AT_END if one > _STRAIGHT else FREE, FREE
    return AT_END, AT_START if two > _STRAIGHT else FREE, FREE


@kernel(numba.int64(SURFACE, RING, numba.int64, numba.int64, VECTOR, VECTOR), **LEAN)
def _move_fault(surface: Surface, ring: Ring, centre: int, other: int, place: Floats, limits: Floats) -> int:
    """Why the ring's centre may not move to `place`, where `other` joins it: an edge too long, a fold."""
    points, most = surface.points, limits[6] * limits[0]
    if limits[4] >= 0:
        most = np.inf
        for i in range(ring.size[1]):
            v = ring.vertex[i]
            x, y, z = points[v, 0] - place[0], points[v, 1] - place[1], points[v, 2] - place[2]
            if v != other and x * x + y * y + z * z > limits[6] * min(
                bracket(surface, limits, centre, v)[0], bracket(surface, limits, other, v)[0]
            ):
                return TOO_LONG
    strain = strained(ring, other, place, most, UPRIGHT)
    return TOO_LONG if strain == STRETCHED else (FOLD if strain == FOLDED else FREE)


@kernel(numba.float64(numba.float64, numba.float64, numba.float64, numba.float64, numba.float64), **LEAN)
def _to_triangle(aa: float, ab: float, bb: float, ap: float, bp: float) -> float:
    """How much nearer than its corner o the nearest point of a triangle is to a point p, as squares.

    Given are the products of its sides a and b, which leave o, with each other and with p - o.
    """
    det = aa * bb - ab * ab
    s, t = bb * ap - ab * bp, aa * bp - ab * ap
    if s >= 0.0 and t >= 0.0 and s + t <= det and det > 0.0:
        return (s * ap + t * bp) / det
    best = 0.0
    if aa > 0.0:
        u = min(1.0, max(0.0, ap / aa))
        best = max(best, u * (2.0 * ap - u * aa))
    if bb > 0.0:
        u = min(1.0, max(0.0, bp / bb))
        best = max(best, u * (2.0 * bp - u * bb))
    cc = aa - 2.0 * ab + bb
    if cc > 0.0:
        u = min(1.0, max(0.0, (bp - ab - ap + aa) / cc))
        best = max(best, 2.0 * ap - aa + u * (2.0 * (bp - ab - ap + aa) - u * cc))
    return best


@kernel(numba.float64(MATRIX, RING, numba.int64, numba.int64), **LEAN)
def _left_behind(points: Points, ring: Ring, centre: int, to: int) -> float:
    """Squared distance of the ring's centre from its faces once it has merged into the vertex `to`."""
    away, best = squared(points, centre, to), 0.0
    for i in range(ring.size[0]):
        b = ring.vertex[i]
        c = ring.vertex[i + 1] if i + 1 < ring.size[1] else ring.vertex[0]
        if b == to or c == to:
            continue
        aa, bb, ab, ap, bp = 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(3):
            origin = points[to, k]
            u, v, w = points[b, k] - origin, points[c, k] - origin, points[centre, k] - origin
            aa += u * u
            bb += v * v
            ab += u * v
            ap += u * w
            bp += v * w
        best = max(best, _to_triangle(aa, ab, bb, ap, bp))
    return away - best


@kernel((MATRIX, numba.int64, numba.int64, numba.int64, VECTOR), **LEAN)
def _set_place(points: Points, a: int, b: int, where: int, place: Floats) -> None:
    for k in range(3):
        if where == AT_START:
            place[k] = points[a, k]
        elif where == AT_END:
            place[k] = points[b, k]
        else:
            place[k] = 0.5 * (points[a, k] + points[b, k])


@kernel(numba.boolean(SURFACE, numba.int64, numba.int64, numba.int64, RING, RING, VECTOR), **LEAN)
def _turns_at_rest(
    surface: Surface, a: int, b: int, where: int, near: Ring, far: Ring, limits: Floats
) -> bool:
    """Whether merging a and b there would turn a face over at rest, where rest is known."""
    if limits[7] < 0:
        return False
    if where == AT_START:
        return overturns(surface.carried, far, b, a, limits)
    return overturns(surface.carried, near, a, b, limits)


@kernel(numba.types.UniTuple(numba.int64, 2)(SURFACE, numba.int64, RING, RING, VECTOR), **LEAN)
def judge(surface: Surface, h: int, near: Ring, far: Ring, limits: Floats) -> tuple[int, int]:
    """May the edge of h collapse? Answers (where the vertex then lies, FREE) or (FREE, the reason why not).

    `near` and `far` are filled with the rings of its two ends, `near.place` with the position.
    """
    vert, twin, points = surface.vert, surface.twin, surface.points
    a, b = vert[h], vert[following(h)]
    there = twin[h] if twin[h] >= 0 else following(h)
    if not (walk(surface, h, near) and walk(surface, there, far)):
        return FREE, CROWDED
    fault = _link_fault(surface, h, near, far)
    if fault != FREE:
        return FREE, fault
    weigh(surface, a, near, hard_cosine(surface, limits, a))
    weigh(surface, b, far, hard_cosine(surface, limits, b))
    reason, second = FEATURE, FREE
    for where in _candidates(surface, h, near, far, limits):
        if where == FREE:
            break
        _set_place(points, a, b, where, near.place)
        fault = FREE
        if where != AT_START:
            fault = _move_fault(surface, near, a, b, near.place, limits)
        if fault == FREE and where != AT_END:
            fault = _move_fault(surface, far, b, a, near.place, limits)
        if fault == FREE and limits[3] == 0.0:  # placed exactly, the surface is worth being kept so
            lost = _left_behind(points, far, b, a) if where == AT_START else _left_behind(points, near, a, b)
            if lost > _REACH * _REACH * bracket(surface, limits, a, b)[0]:
                fault = SHAPE
        if fault == FREE and not _turns_at_rest(surface, a, b, where, near, far, limits):
            return where, FREE
        if fault == FREE and second == FREE:
            second = where  # better than an edge too short
        elif reason == FEATURE:
            reason = fault
    if second != FREE:
        _set_place(points, a, b, second, near.place)
        return second, FREE
    return FREE, reason


@kernel(numba.int64(SURFACE, numba.int64), **LEAN)
def _spike_over(surface: Surface, h: int) -> int:
    """The shortest edge to a vertex of three edges of whose base h is a side, or FREE; it ends at the vertex.

    While that vertex stands, the sides of its base break the link condition, since the third corner of the
    base is shared by both ends. Its own edges need not be short: it would stand for ever.
    """
    points, vert, twin = surface.points, surface.vert, surface.twin
    for side in range(2):
        k = h if side == 0 else twin[h]
        if k < 0:
            continue
        first = best = following(k)  # ends at the corner opposite the edge
        tip, spoke = vert[following(first)], first
        for _ in range(3):
            spoke = preceding(twin[spoke]) if spoke >= 0 and twin[spoke] >= 0 else FREE
            if spoke >= 0 and squared(points, vert[spoke], tip) < squared(points, vert[best], tip):
                best = spoke
        if spoke == first:
            return best
    return FREE


@kernel((SURFACE, numba.int64, INTS), **LEAN)
def _drop_face(surface: Surface, h: int, dead_faces: Indices) -> None:
    """Take out the face of h, whose edge h has shrunk to a point, and sew its other two sides together."""
    vert, twin, tagged = surface.vert, surface.twin, surface.tagged
    one, two = twin[following(h)], twin[preceding(h)]
    join(twin, one, two)
    join(twin, two, one)
    hard = tagged[following(h)] | tagged[preceding(h)]
    if one >= 0:
        tagged[one] = hard
    if two >= 0:
        tagged[two] = hard
    f = h // 3
    vert[3 * f] = vert[3 * f + 1] = vert[3 * f + 2] = -1
    push(dead_faces, f)


@kernel((SURFACE, numba.int64, RING, numba.int64, VECTOR, INTS), **LEAN)
def collapse_edge(
    surface: Surface, h: int, far: Ring, where: int, place: Floats, dead_faces: Indices
) -> None:
    """Merge the end of h into its start, which moves to `place`; `judge` must have allowed it."""
    points, carried, blends, vert, twin, _ = surface
    a, b, back = vert[h], vert[following(h)], twin[h]
    for k in range(3):
        points[a, k] = place[k]
    for k in range(carried.shape[1]):
        if where == AT_END:
            carried[a, k] = carried[b, k]
        elif where == AT_MIDDLE and blends[k] > 0:
            carried[a, k] = 0.5 * (carried[a, k] + carried[b, k])
    for i in range(far.size[0]):
        vert[far.leaving[i]] = a
    _drop_face(surface, h, dead_faces)
    if back >= 0:
        _drop_face(surface, back, dead_faces)


@kernel((SURFACE, numba.int64, RING, numba.boolean, VECTOR, CHANGES), **LEAN)
def _look_around(
    surface: Surface, centre: int, ring: Ring, opened: bool, limits: Floats, changes: Changes
) -> None:
    """After a collapse: touch the faces of a ring, and enlist the spokes of those left that are short.

    `centre` is the vertex that is left, `opened` whether it lies on a boundary.
    """
    for i in range(ring.size[0]):
        h, v = ring.leaving[i], ring.vertex[i]
        touch(changes, h // 3)
        if surface.vert[h] < 0:
            continue
        if squared(surface.points, centre, v) < bracket(surface, limits, centre, v)[1]:
            enlist(changes, h)
        if opened and surface.twin[preceding(h)] < 0 and is_short(surface, preceding(h), limits):
            enlist(changes, preceding(h))


@kernel(numba.boolean(SURFACE, numba.int64, VECTOR, CHANGES), **LEAN)
def _is_due(surface: Surface, h: int, limits: Floats, changes: Changes) -> bool:
    """Whether a listed half-edge is that of a short edge which is listed by no other."""
    if surface.vert[h] < 0 or not is_short(surface, h, limits):
        return False
    back = surface.twin[h]
    return bool(back < 0 or changes.notes[back] == UNLISTED)


@kernel(numba.int64(SURFACE, VECTOR, RINGS, CHANGES, INTS, INTS), **LEAN)
def collapse_due(
    surface: Surface,
    limits: Floats,
    rings: tuple[Ring, Ring],
    changes: Changes,
    dead_faces: Indices,
    dead_vertices: Indices,
) -> int:
    """Collapse the edges in `shorts` that are due and may; answers how many did.

    Edges that become short join the list as it is worked through. What was refused stays in it. Where a
    vertex of three edges is all that keeps a side of its base, one of those edges collapses first.
    """
    (near, far), shorts, notes = rings, changes.shorts, changes.notes
    done, kept, at = 0, 0, 0
    while at < shorts[0]:
        at += 1
        h = shorts[at]
        where, reason = FREE, FREE
        if notes[h] == DUE:
            notes[h] = UNLISTED
            if not _is_due(surface, h, limits, changes):
                continue
            where, reason = judge(surface, h, near, far, limits)
            notes[h] = REFUSED + reason if where == FREE else UNLISTED
            spike = _spike_over(surface, h) if reason == LINK else FREE
            if spike != FREE:
                where, _ = judge(surface, spike, near, far, limits)
            if spike != FREE and where != FREE:  # it goes first, and then the edge is looked at again
                notes[h] = DUE
                h, at = spike, at - 1
        if where == FREE:
            kept += 1
            shorts[kept] = h
            continue
        kept_end = surface.vert[h]
        opened = near.size[1] > near.size[0] or far.size[1] > far.size[0]
        push(dead_vertices, surface.vert[following(h)])
        collapse_edge(surface, h, far, where, near.place, dead_faces)
        done += 1
        _look_around(surface, kept_end, near, opened, limits, changes)
        _look_around(surface, kept_end, far, opened, limits, changes)
        if shorts[0] + 4 * MOST_SPOKES > len(shorts):  # close the gap that the looked at have left
            for i in range(at + 1, shorts[0] + 1):
                shorts[kept + i - at] = shorts[i]
            shorts[0] -= at - kept
            at = kept
    shorts[0] = kept
    return done


@kernel(numba.boolean(SURFACE, numba.int64, CHANGES), **LEAN)
def _fresh_around(surface: Surface, h: int, changes: Changes) -> bool:
    """Whether any face at the start of h is FRESH."""
    twin, marks = surface.twin, changes.marks
    k = h
    while True:
        if marks[k // 3] == FRESH:
            return True
        k = twin[preceding(k)]
        if k == h:
            return False
        if k < 0:
            break
    k = twin[h]  # the fan is open: on to its other side
    while k >= 0:
        if marks[k // 3] == FRESH:
            return True
        k = twin[following(k)]
    return False


@kernel(numba.int64(SURFACE, CHANGES), **LEAN)
def recall(surface: Surface, changes: Changes) -> int:
    """Make refused edges due again where a face around has changed; answers how many edges are due.

    No face is FRESH afterwards.
    """
    shorts, notes, fresh = changes.shorts, changes.notes, changes.fresh
    due = 0
    for i in range(1, shorts[0] + 1):
        h = shorts[i]
        if (
            surface.vert[h] < 0
            or _fresh_around(surface, h, changes)
            or _fresh_around(surface, following(h), changes)
        ):
            notes[h] = DUE
        due += notes[h] == DUE
    for i in range(1, fresh[0] + 1):
        changes.marks[fresh[i]] = CHANGED
    fresh[0] = 0
    return due
