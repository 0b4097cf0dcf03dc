"""Work lists, what a frame notes down, and geometry shared by the resampling kernels.

A work list is an int32 array whose first entry counts those that follow. Pushing onto a full list does
nothing; lists that must not lose anything have room for everything they could hold.

Limits are nine numbers:
0, 1  the largest and the smallest squared length allowed
2     cosine of the hard angle
3     1 where two soft ends merge halfway, 0 where at one of them
4     the column of `Surface.carried` where every vertex has limits of its own (largest length, smallest
      length, cosine), or -1 where the same hold everywhere. The limit of an edge is then the geometric mean
      of those of its ends, which needs no root: lengths are compared as squares
5     the share of a triangle's longest side in the sum of its squared sides from which on it is obtuse
6     how many times the largest squared length an edge may have that a collapse makes
7, 8  the columns of `Surface.carried` where every vertex has its place at rest and the normal there, or -1
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices, Points
from pipeline.kernels import kernel
from pipeline.mesh._kernels_halfedge import BYTES, INTS, LEAN, MATRIX, SURFACE, VECTOR, Surface, after

AS_IT_WAS, CHANGED, FRESH = 0, 1, 2
"""Marks of faces: never touched in this frame, touched, or touched since refused edges were last recalled."""

UNLISTED, DUE, REFUSED = 0, 1, 2
"""Notes on half-edges: not in `shorts`, in it to be looked at, or (plus the reason) in it to wait."""


class Changes(NamedTuple):
    """What a frame has changed so far, and the short edges that it has not collapsed.

    Every edge that is short stands in `shorts` by one of its half-edges or both. One that was refused waits
    there until a face around its ends changes: nothing else could let it go.
    """

    marks: AnyArray  # (F,) uint8: AS_IT_WAS, CHANGED or FRESH
    changed: Indices  # work list of the faces that are not as they were, each once
    fresh: Indices  # work list of the FRESH faces, each once
    notes: AnyArray  # (3F,) uint8: UNLISTED, DUE, or REFUSED + the reason
    shorts: Indices  # work list of half-edges


CHANGES = numba.types.NamedTuple([BYTES, INTS, INTS, BYTES, INTS], Changes)


@kernel((INTS, numba.int64), **LEAN)
def push(items: Indices, item: int) -> None:
    n = items[0] + 1
    if n < len(items):
        items[np.uint64(n)] = item
        items[0] = n


@kernel((CHANGES, numba.int64), **LEAN)
def touch(changes: Changes, f: int) -> None:
    """Note that a face has changed."""
    marks, i = changes.marks, np.uint64(f)
    if marks[i] == FRESH:
        return
    if marks[i] == AS_IT_WAS:
        push(changes.changed, f)
    marks[i] = FRESH
    push(changes.fresh, f)


@kernel((CHANGES, numba.int64), **LEAN)
def enlist(changes: Changes, h: int) -> None:
    """Have the edge of h looked at for a collapse."""
    i = np.uint64(h)
    if changes.notes[i] == UNLISTED:
        changes.notes[i] = DUE
        push(changes.shorts, h)


@kernel(numba.float64(MATRIX, numba.int64, numba.int64), **LEAN)
def squared(points: Points, a: int, b: int) -> float:
    """Squared distance between two vertices."""
    u, v = np.uint64(a), np.uint64(b)  # unsigned, or every access would ask whether to count from the end
    x = points[u, 0] - points[v, 0]
    y = points[u, 1] - points[v, 1]
    z = points[u, 2] - points[v, 2]
    return float(x * x + y * y + z * z)


@kernel(numba.types.UniTuple(numba.float64, 3)(MATRIX, numba.int64, numba.int64, numba.int64), **LEAN)
def area_vector(points: Points, a: int, b: int, c: int) -> tuple[float, float, float]:
    """Normal of the triangle abc, as long as twice its area."""
    i, j, k = np.uint64(a), np.uint64(b), np.uint64(c)
    ux, uy, uz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    vx, vy, vz = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1], points[k, 2] - points[i, 2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@kernel(numba.types.UniTuple(numba.float64, 2)(SURFACE, VECTOR, numba.int64, numba.int64), **LEAN)
def bracket(surface: Surface, limits: Floats, a: int, b: int) -> tuple[float, float]:
    """The largest and the smallest squared length that an edge between a and b may have."""
    if limits[4] < 0:
        return limits[0], limits[1]
    column, carried = int(limits[4]), surface.carried
    return carried[a, column] * carried[b, column], carried[a, column + 1] * carried[b, column + 1]


@kernel(numba.float64(SURFACE, VECTOR, numba.int64), **LEAN)
def hard_cosine(surface: Surface, limits: Floats, v: int) -> float:
    """Cosine of the angle from which on an edge at v is hard."""
    return float(limits[2] if limits[4] < 0 else surface.carried[v, int(limits[4]) + 2])


@kernel(numba.boolean(SURFACE, numba.int64, VECTOR), **LEAN)
def is_short(surface: Surface, h: int, limits: Floats) -> bool:
    """Whether the edge of h is shorter than it may be."""
    k = np.uint64(h)
    a, b = surface.vert[k], surface.vert[after(k)]
    return bool(squared(surface.points, a, b) < bracket(surface, limits, a, b)[1])


@kernel((SURFACE, numba.int64, VECTOR, INTS, CHANGES), **LEAN)
def sort_out(surface: Surface, h: int, limits: Floats, longs: Indices, changes: Changes) -> None:
    """List an edge that is new, or stands or lies elsewhere now, if it is out of the bracket."""
    k = np.uint64(h)
    a, b = surface.vert[k], surface.vert[after(k)]
    length, (most, least) = squared(surface.points, a, b), bracket(surface, limits, a, b)
    if length > most:
        push(longs, h)
    elif length < least:
        enlist(changes, h)
