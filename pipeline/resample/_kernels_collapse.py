"""Collapsing short edges that may (Figure E; P9, P27), one by one, and recalling those that might."""

from __future__ import annotations

import numba

from pipeline.arrays import Floats, Indices
from pipeline.kernels import kernel
from pipeline.mesh._kernels_halfedge import INTS, LEAN, SURFACE, VECTOR, Surface, following, join, preceding
from pipeline.resample._kernels_judge import AT_END, AT_MIDDLE, FREE, LINK, judge
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
    is_short,
    push,
    squared,
    touch,
)
from pipeline.resample._kernels_ring import MOST_SPOKES, RING, Ring

RINGS = numba.types.UniTuple(RING, 2)


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
