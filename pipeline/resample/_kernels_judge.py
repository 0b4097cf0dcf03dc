"""Which short edges may collapse, and where: not at the cost of creases, tendrils or shape (P28-P33)."""

from __future__ import annotations

import numba
import numpy as np

from pipeline.arrays import Floats, Points
from pipeline.kernels import kernel
from pipeline.mesh._kernels_halfedge import (
    LEAN,
    MATRIX,
    SURFACE,
    VECTOR,
    Surface,
    following,
    preceding,
)
from pipeline.resample._kernels_lists import bracket, hard_cosine, squared
from pipeline.resample._kernels_lost import left_behind, swept
from pipeline.resample._kernels_rest import overturns
from pipeline.resample._kernels_ring import (
    FOLDED,
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
        at_start, at_end = swept(surface.points, b, a, far), swept(surface.points, a, b, near)
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
            lost = left_behind(points, far, b, a) if where == AT_START else left_behind(points, near, a, b)
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
