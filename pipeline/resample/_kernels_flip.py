"""Turning soft edges of touched faces so that angles get better; creases and the shape stay (P36)."""

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
    after,
    before,
    following,
    join,
    preceding,
)
from pipeline.resample._kernels_lists import (
    CHANGES,
    FRESH,
    UNLISTED,
    Changes,
    area_vector,
    bracket,
    enlist,
    hard_cosine,
    push,
    squared,
    touch,
)
from pipeline.resample._kernels_rest import upright

_GAIN = 0.1  # cot α + cot β must be below minus this: a flip has to be worth the change of the surface
MOST_AGAIN = 128  # edges to look at again around one flip and those that it leads to; a flip adds four
_FLAT = 0.94  # cosine of 20 degrees: how far the two faces may lean before and after


@kernel(numba.float64(MATRIX, numba.int64, numba.int64, numba.int64), **LEAN)
def _openness(points: Points, apex: int, a: int, b: int) -> float:
    """Scalar product of the sides of a triangle that meet at `apex`: negative where the angle is obtuse."""
    i, j, k = np.uint64(apex), np.uint64(a), np.uint64(b)
    x = (points[j, 0] - points[i, 0]) * (points[k, 0] - points[i, 0])
    y = (points[j, 1] - points[i, 1]) * (points[k, 1] - points[i, 1])
    z = (points[j, 2] - points[i, 2]) * (points[k, 2] - points[i, 2])
    return float(x + y + z)


@kernel(numba.boolean(SURFACE, numba.uint64, numba.int64), **LEAN)
def _adjacent(surface: Surface, h: np.uint64, other: int) -> bool:
    """Whether an edge joins the start c of h, a side of a triangle, with a vertex not of that triangle.

    The corners before and after c are known, so the walk around c begins beyond one and ends at the other.
    """
    vert, twin = surface.vert, surface.twin
    a = vert[after(h)]
    k = twin[before(h)]
    while k >= 0:
        back = before(np.uint64(k))
        if vert[back] == other:
            return True
        if vert[back] == a:
            return False
        k = twin[back]
    k = twin[h]  # the fan is open: on to its other side
    while k >= 0:
        onward = after(np.uint64(k))
        if vert[after(onward)] == other:
            return True
        k = twin[onward]
    return False


@kernel(numba.boolean(numba.float64, numba.float64, numba.float64, numba.float64), **LEAN)
def _leans(dot: float, cosine: float, m: float, n: float) -> bool:
    """Whether vectors of squared lengths m, n and that scalar product differ by more than an acute angle."""
    return bool(dot < 0 or dot * dot < cosine * cosine * m * n)


@kernel(numba.boolean(SURFACE, numba.int64, VECTOR), **LEAN)
def worth_flipping(surface: Surface, h: int, limits: Floats) -> bool:
    """Is the edge of h soft, not Delaunay, and its other diagonal a legal edge on the same surface?"""
    points, vert, twin = surface.points, surface.vert, surface.twin
    i = np.uint64(h)
    k = np.uint64(twin[i])
    a, b, c, d = vert[i], vert[after(i)], vert[before(i)], vert[before(k)]
    at_c, at_d = _openness(points, c, a, b), _openness(points, d, a, b)
    if (at_c >= 0 and at_d >= 0) or surface.tagged[i]:
        return False
    mx, my, mz = area_vector(points, a, b, c)
    nx, ny, nz = area_vector(points, b, a, d)
    m, n = mx * mx + my * my + mz * mz, nx * nx + ny * ny + nz * nz
    root_m, root_n = np.sqrt(m), np.sqrt(n)
    if m == 0 or n == 0 or at_c * root_n + at_d * root_m > -_GAIN * root_m * root_n:
        return False
    if _leans(mx * nx + my * ny + mz * nz, max(_FLAT, hard_cosine(surface, limits, a)), m, n):
        return False
    crossing, (most, least) = squared(points, c, d), bracket(surface, limits, c, d)
    if crossing > most or crossing < least:
        return False
    px, py, pz = area_vector(points, a, d, c)
    qx, qy, qz = area_vector(points, b, c, d)
    sx, sy, sz = mx + nx, my + ny, mz + nz
    p, q, s = px * px + py * py + pz * pz, qx * qx + qy * qy + qz * qz, sx * sx + sy * sy + sz * sz
    if _leans(px * sx + py * sy + pz * sz, _FLAT, p, s) or _leans(qx * sx + qy * sy + qz * sz, _FLAT, q, s):
        return False
    if limits[7] >= 0:  # nor may a face turn over at rest
        carried = surface.carried
        inwards = (upright(carried, limits, a, d, c) <= 0) + (upright(carried, limits, b, c, d) <= 0)
        already = (upright(carried, limits, a, b, c) <= 0) + (upright(carried, limits, b, a, d) <= 0)
        if inwards > already:
            return False
    return not _adjacent(surface, before(i), d)


@kernel((SURFACE, numba.int64), **LEAN)
def flip_edge(surface: Surface, h: int) -> None:
    """Turn the edge of h: a→b between c and d into d→c. Half-edges c→a and d→b keep their places."""
    vert, twin, tagged = surface.vert, surface.twin, surface.tagged
    back = twin[h]
    i, j = np.uint64(h), np.uint64(back)
    i1, j1 = after(i), after(j)
    c, d = vert[after(i1)], vert[after(j1)]
    beside, beyond = twin[j1], twin[i1]
    vert[i1], vert[j1] = d, c
    tagged[i], tagged[j] = tagged[j1], tagged[i1]
    tagged[i1] = tagged[j1] = 0
    join(twin, h, beside)
    join(twin, back, beyond)
    twin[i1], twin[j1] = j1, i1


@kernel(numba.int64(SURFACE, numba.int64), **LEAN)
def _facing_obtuse(surface: Surface, f: int) -> int:
    """The half-edge of a face that faces its obtuse corner; -1 where all corners are acute."""
    points, vert = surface.points, surface.vert
    h = 3 * f
    i = np.uint64(h)
    a, b, c = vert[i], vert[i + np.uint64(1)], vert[i + np.uint64(2)]
    if _openness(points, c, a, b) < 0:
        return h
    if _openness(points, a, b, c) < 0:
        return h + 1
    return h + 2 if _openness(points, b, c, a) < 0 else -1


@kernel((SURFACE, numba.int64, CHANGES), **LEAN)
def _flip_noted(surface: Surface, h: int, changes: Changes) -> None:
    """Flip the edge of h, touch its faces, and keep listed those of their edges that now stand elsewhere."""
    k = surface.twin[h]
    beside, beyond = following(k), following(h)
    flip_edge(surface, h)
    touch(changes, h // 3)
    touch(changes, k // 3)
    if changes.notes[beside] != UNLISTED:
        enlist(changes, h)
    if changes.notes[beyond] != UNLISTED:
        enlist(changes, k)


@kernel(numba.int64(SURFACE, numba.int64, VECTOR, CHANGES, INTS), **LEAN)
def _flip_from(surface: Surface, h: int, limits: Floats, changes: Changes, again: Indices) -> int:
    """Flip the edge of h if it is worth it, and go on with the four edges around; answers how often.

    Flips on a curved surface might chase each other for ever, so there is an end when `again` is full.
    """
    twin = surface.twin
    again[0], again[1] = 1, h
    flips, at = 0, 1
    while at <= again[0]:
        h = again[np.uint64(at)]
        k = twin[np.uint64(h)]
        at += 1
        if k >= 0 and worth_flipping(surface, h, limits):
            _flip_noted(surface, h, changes)
            flips += 1
            push(again, h)
            push(again, preceding(h))
            push(again, k)
            push(again, preceding(k))
    return flips


@kernel(numba.int64(SURFACE, VECTOR, CHANGES, INTS, INTS), **LEAN)
def flip_fresh(surface: Surface, limits: Floats, changes: Changes, obtuse: Indices, again: Indices) -> int:
    """Flip what is worth it among the edges of `obtuse` and of FRESH faces, and then around each flip.

    An edge can only be worth it if it faces an obtuse corner, and a face has at most one: so each FRESH
    face looks at one edge, and those beside it that are not look across at theirs. `obtuse` is emptied;
    `again` is scratch.
    """
    vert, twin, fresh, marks = surface.vert, surface.twin, changes.fresh, changes.marks
    flips = 0
    before = int(fresh[0])
    for i in range(1, obtuse[0] + 1):
        if vert[obtuse[i]] >= 0:
            flips += _flip_from(surface, obtuse[i], limits, changes, again)
    obtuse[0] = 0
    for i in range(1, before + 1):
        f = fresh[i]
        if vert[np.uint64(3 * f)] < 0:
            continue
        for h in range(3 * f, 3 * f + 3):
            k = twin[np.uint64(h)]
            if k < 0 or marks[np.uint64(k) // np.uint64(3)] == FRESH:
                continue
            if _facing_obtuse(surface, k // 3) == k:
                flips += _flip_from(surface, k, limits, changes, again)
        h = _facing_obtuse(surface, f)
        if h >= 0:
            flips += _flip_from(surface, h, limits, changes, again)
    return flips
