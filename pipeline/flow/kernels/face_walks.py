"""Nearest places on a surface that are looked for over neighbouring faces, in the memory of a `TriangleTree`.

Where a surface cuts through itself or touches itself, the nearest face of all may be of another part. A walk
begins at a face near the point and goes on only over edges, and only to faces that are not farther away.
"""

from __future__ import annotations

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Floats, Points
from flowsculpt.pipeline.flow.kernels.external_kernels import nearest_on_triangle
from flowsculpt.pipeline.flow.kernels.instructions import doubles_at
from flowsculpt.pipeline.kernels import kernel

_FLOATS = "CPointer(f8)"
_EQUAL = 1e-9  # squared distances that differ by less, over the squared size of the face, are equal


@kernel(f"Tuple((f8, f8))({_FLOATS}, i8, f8, f8, f8)")
def _distance2(m: Floats, at: int, x: float, y: float, z: float) -> tuple[float, float]:
    """Return the squared distance of a point from a triangle, and a squared length that counts as none."""
    s, r = nearest_on_triangle(m, at, x, y, z)
    d2, size2 = 0.0, 0.0
    for k in range(3):
        ab, ac = m[at + 3 + k] - m[at + k], m[at + 6 + k] - m[at + k]
        away = m[at + k] + s * ab + r * ac - (x if k == 0 else (y if k == 1 else z))
        d2 += away * away
        size2 += ab * ab + ac * ac
    return d2, _EQUAL * _EQUAL * size2


@kernel(f"i8({_FLOATS}, i8, i8[:, ::1], i8, f8[::1], f8[::1], i8, i8[::1], i8[::1], f8[::1])")
def _flood(
    m: Floats,
    triangles: int,
    neighbours: AnyArray,
    start: int,
    end: Floats,
    point: Floats,
    stamp: int,
    stamps: AnyArray,
    queue: AnyArray,
    squares: Floats,
) -> int:
    """Fill the queue with the faces reached from a start; return their number.

    They are the faces around `end` (3,), which is on the start, and those that are reached from there by
    steps that lead no farther from `point` (3,). squares receives their squared distances from it.
    """
    queue[0], stamps[start] = start, stamp
    first, last = 0, 1
    while first < last:  # the faces around the end
        face, first = queue[first], first + 1
        for k in range(3):
            other = neighbours[face, k]
            if other >= 0 and stamps[other] != stamp:
                d2, none = _distance2(m, triangles + 9 * other, end[0], end[1], end[2])
                if d2 <= none:
                    queue[last], stamps[other], last = other, stamp, last + 1
    for i in range(last):
        squares[i], _ = _distance2(m, triangles + 9 * queue[i], point[0], point[1], point[2])
    first = 0
    while first < last:
        face, before, first = queue[first], squares[first], first + 1
        for k in range(3):
            other = neighbours[face, k]
            if other >= 0 and stamps[other] != stamp:
                d2, none = _distance2(m, triangles + 9 * other, point[0], point[1], point[2])
                if d2 <= before + none:
                    queue[last], squares[last], stamps[other], last = other, d2, stamp, last + 1
    return last


@kernel("void(i8, i8, i8[:, ::1], f8[:, ::1], f8[:, :, ::1], i8[:, ::1], i8[::1])")
def walk_to_nearest(
    address: int,
    triangles: int,
    neighbours: AnyArray,
    points: Points,
    ends: Points,
    starts: AnyArray,
    found: AnyArray,
) -> None:
    """Find the nearest triangle of each of points (N, 3) that is reached from both of its ends.

    Where none is reached from both, it is the nearest that is reached from one.

    address     of the tree's memory; `triangles` is the start of the triangles in it
    neighbours  (T, 3) the triangles across the edges of each, -1 at a boundary
    ends        (N, 2, 3) points on the surface, twice the same for one end
    starts      (N, 2) the triangles that these are on
    found       (N,) receives triangles
    """
    m, count = doubles_at(address), len(neighbours)
    stamps, queue, squares = np.full((2, count), -1), np.empty(count, np.int64), np.empty(count)
    for i in range(len(points)):
        best = best_of_both = np.inf
        both = -1
        for end in range(2):
            reached = _flood(
                m,
                triangles,
                neighbours,
                starts[i, end],
                ends[i, end],
                points[i],
                i,
                stamps[end],
                queue,
                squares,
            )
            for j in range(reached):
                if squares[j] < best:
                    best, found[i] = squares[j], queue[j]
                if end and squares[j] < best_of_both and stamps[0, queue[j]] == i:
                    best_of_both, both = squares[j], queue[j]
        if both >= 0:
            found[i] = both


@kernel("void(i8, i8, f8[:, ::1], i8[::1], f8[:, ::1])")
def find_shares(address: int, triangles: int, points: Points, on: AnyArray, shares: Floats) -> None:
    """Find shares (N, 2), as of `find_nearest`, of the places nearest to points (N, 3) on triangles (N,)."""
    m = doubles_at(address)
    for i in range(len(points)):
        at = triangles + 9 * on[i]
        shares[i, 0], shares[i, 1] = nearest_on_triangle(m, at, points[i, 0], points[i, 1], points[i, 2])
