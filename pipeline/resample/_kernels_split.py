"""Splitting long edges with their two faces (Figure D of the paper; P8, P24, P25)."""

from __future__ import annotations

import numba
import numpy as np

from pipeline.arrays import Floats, Indices
from pipeline.kernels import kernel
from pipeline.mesh._kernels_halfedge import (
    INTS,
    LEAN,
    SURFACE,
    VECTOR,
    Surface,
    following,
    join,
    preceding,
)
from pipeline.resample._kernels_lists import CHANGES, Changes, bracket, push, sort_out, squared, touch

LEAVING = 2  # which of the numbers of a birth is the half-edge that leaves the new vertex
BIRTH = 3  # numbers noted of each new vertex: parents a and b, half-edge vertex→b
_CLASSES = 4


@kernel((SURFACE, numba.int64, numba.int64, numba.int64), **LEAN)
def _split_face(surface: Surface, h: int, middle: int, face: int) -> None:
    """Cut the face of h: a→b by the line from `middle` to its third corner c; `face` becomes (middle, b, c).

    Half-edge b→c moves to the new face; its old place now holds the line from `middle` to c.
    """
    vert, twin, tagged = surface.vert, surface.twin, surface.tagged
    onward, new = following(h), 3 * face
    tagged[new], tagged[new + 1], tagged[new + 2] = tagged[h], tagged[onward], 0
    tagged[onward] = 0
    vert[new], vert[new + 1], vert[new + 2] = middle, vert[onward], vert[preceding(h)]
    vert[onward] = middle
    join(twin, new + 1, twin[onward])
    join(twin, onward, new + 2)


@kernel(numba.int64(SURFACE, numba.int64, numba.int64, numba.int64), **LEAN)
def split_edge(surface: Surface, h: int, middle: int, faces: int) -> int:
    """Put vertex `middle` on the edge of h and cut the faces beside it; answers the new number of faces."""
    twin = surface.twin
    back, new = twin[h], 3 * faces
    _split_face(surface, h, middle, faces)
    if back < 0:
        twin[new] = -1
        return faces + 1
    _split_face(surface, back, middle, faces + 1)
    join(twin, h, new + 3)
    join(twin, back, new)
    return faces + 2


@kernel((SURFACE, numba.int64, numba.int64, numba.int64), **LEAN)
def _set_middle(surface: Surface, middle: int, a: int, b: int) -> None:
    points, carried, blends = surface.points, surface.carried, surface.blends
    for k in range(3):
        points[middle, k] = 0.5 * (points[a, k] + points[b, k])
    for k in range(carried.shape[1]):
        carried[middle, k] = 0.5 * (carried[a, k] + carried[b, k]) if blends[k] > 0 else carried[a, k]


@kernel(INTS(SURFACE, INTS, VECTOR, INTS))
def longest_first(surface: Surface, longs: Indices, limits: Floats, later: Indices) -> Indices:
    """The edges of this pass, longest first in a few classes; those below 1/√2 of the longest wait.

    Nothing new can then be longer than √(1 - 1/8) of the longest edge, so splitting ends, and thin
    triangles are cut across rather than along.
    """
    excess = np.empty(longs[0])  # squared length over the square of the longest allowed
    longest = 0.0
    for i in range(longs[0]):
        a, b = surface.vert[longs[i + 1]], surface.vert[following(longs[i + 1])]
        excess[i] = squared(surface.points, a, b) / bracket(surface, limits, a, b)[0]
        longest = max(longest, excess[i])
    bar = max(1.0, 0.5 * longest)
    start = np.zeros(_CLASSES + 1, np.int32)
    rank = np.empty(longs[0], np.int32)
    for i in range(longs[0]):
        rank[i] = -1
        if excess[i] > bar:
            rank[i] = max(0, min(_CLASSES - 1, int((2.0 - excess[i] / bar) * _CLASSES)))
            start[rank[i] + 1] += 1
        elif excess[i] > 1.0:
            push(later, longs[i + 1])
    for c in range(_CLASSES):
        start[c + 1] += start[c]
    order = np.empty(start[_CLASSES], np.int32)
    for i in range(longs[0]):
        if rank[i] >= 0:
            order[start[rank[i]]] = longs[i + 1]
            start[rank[i]] += 1
    return order


@kernel((SURFACE, numba.int64[::1], VECTOR, INTS, INTS, INTS, CHANGES), **LEAN)
def split_pass(
    surface: Surface,
    sizes: Indices,
    limits: Floats,
    order: Indices,
    later: Indices,
    births: Indices,
    changes: Changes,
) -> None:
    """Split the edges of `order` that are long, each once; what is long then stands in `later`.

    New vertices lie at the middle of their parents. `births` notes three numbers of each, so that a
    placement may move them all together before the next pass: its parents a and b, and the half-edge
    vertex→b.
    The arrays must have room for as many vertices, and twice as many faces, as `order` has entries.
    """
    vert, twin = surface.vert, surface.twin
    fresh = sizes[0]
    for h in order:
        a, b = vert[h], vert[following(h)]
        if a >= fresh or b >= fresh or squared(surface.points, a, b) <= bracket(surface, limits, a, b)[0]:
            continue
        middle, first = sizes[0], sizes[1]
        back = twin[h]
        _set_middle(surface, middle, a, b)
        sizes[0] = middle + 1
        sizes[1] = split_edge(surface, h, middle, first)
        push(births, a)
        push(births, b)
        push(births, 3 * first)
        sort_out(surface, h, limits, later, changes)
        for g in range(first, sizes[1]):
            touch(changes, g)
            for i in range(3):
                sort_out(surface, 3 * g + i, limits, later, changes)
        touch(changes, h // 3)
        if back >= 0:
            touch(changes, back // 3)
