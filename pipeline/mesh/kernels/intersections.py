"""Find self-intersections: faces in a hashed grid, each tested against the faces in its cells."""

from __future__ import annotations

import numba
import numpy as np
from numba import prange

from flowsculpt.pipeline.arrays import AnyArray, Faces, Floats, Indices, Points
from flowsculpt.pipeline.kernels import kernel, only_read
from flowsculpt.pipeline.mesh.kernels.halfedge import CONST_MATRIX, INTS, LEAN, LEAN_CALLS, VECTOR

_FACES = only_read(numba.int32[:, ::1])
_BOXES = numba.float32[:, ::1]
_SPAN = numba.types.UniTuple(numba.int64, 2)
_NORMAL = numba.types.UniTuple(numba.float64, 3)
_AXES = (0, 1, 2)
_MARGIN = 1.2e-7  # over half a step of float32, by which a rounded coordinate may lie inside of its box


@kernel((CONST_MATRIX, _FACES, VECTOR, _BOXES), parallel=True)
def bounding_boxes(points: Points, faces: Faces, origin: Floats, boxes: AnyArray) -> None:
    """Fill `boxes` (F, 6) float32: the least x, y and z of each face from the origin, then the largest.

    They are rounded outwards: faces that meet have boxes that meet.
    """
    for f in prange(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        for x in _AXES:
            low = min(points[a, x], points[b, x], points[c, x]) - origin[x]
            high = max(points[a, x], points[b, x], points[c, x]) - origin[x]
            boxes[f, x] = low - _MARGIN * abs(low)
            boxes[f, 3 + x] = high + _MARGIN * abs(high)


@kernel(_SPAN(_BOXES, numba.int64, numba.int64, numba.float64), **LEAN)
def _span(boxes: AnyArray, f: int, axis: int, cell: float) -> tuple[int, int]:
    """Return the first and the last cell that a face reaches along an axis."""
    return int(np.floor(boxes[f, axis] / cell)), int(np.floor(boxes[f, 3 + axis] / cell))


@kernel(numba.int64(numba.int64, numba.int64, numba.int64, numba.int64), **LEAN)
def _bucket(i: int, j: int, k: int, mask: int) -> int:
    """Return the bucket of a cell (Teschner et al. 2003); `mask` is a power of two minus one."""
    return ((i * 73856093) ^ (j * 19349663) ^ (k * 83492791)) & mask


@kernel((_BOXES, numba.float64, numba.int64, numba.int64, INTS, INTS))
def fill_grid(boxes: AnyArray, cell: float, buckets: int, first: int, ends: Indices, listed: Indices) -> None:
    """List every face in each cell that its bounding box touches, by a counting sort over the hashed cells.

    buckets  number of all buckets, a power of two
    first    the first bucket that is filled
    ends     (N + 2,) for N buckets that are filled: with an empty `listed`, which is the first call, their
             lengths are counted into `ends[2:]`; then bucket k is listed from `ends[k]` to `ends[k + 1]`
    """
    mask, here = buckets - 1, len(ends) - 2
    for f in range(len(boxes)):
        i0, i1 = _span(boxes, f, 0, cell)
        j0, j1 = _span(boxes, f, 1, cell)
        k0, k1 = _span(boxes, f, 2, cell)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                for k in range(k0, k1 + 1):
                    bucket = _bucket(i, j, k, mask) - first
                    if bucket < 0 or bucket >= here:
                        continue
                    if len(listed) == 0:
                        ends[bucket + 2] += 1
                    else:
                        listed[ends[bucket + 1]] = f
                        ends[bucket + 1] += 1


@kernel(numba.float64(CONST_MATRIX, numba.int64, numba.int64, numba.int64, numba.int64), **LEAN)
def _side(points: Points, a: int, b: int, c: int, p: int) -> float:
    """Return six times the signed volume of tetrahedron abcp: the side of face abc that p lies on."""
    total = 0.0
    for x in _AXES:
        y, z = (x + 1) % 3, (x + 2) % 3
        one = (points[b, y] - points[a, y]) * (points[c, z] - points[a, z])
        two = (points[b, z] - points[a, z]) * (points[c, y] - points[a, y])
        total += (one - two) * (points[p, x] - points[a, x])
    return total


@kernel(numba.boolean(CONST_MATRIX, _FACES, numba.int64, numba.int64, numba.int64), **LEAN)
def _passes_inside(points: Points, faces: Faces, p: int, q: int, f: int) -> bool:
    """Tell whether the line from p to q passes through the inside of face f; neither end is its corner."""
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    one, two = _side(points, p, q, a, b), _side(points, p, q, b, c)
    if one > 0.0 and two > 0.0:
        return _side(points, p, q, c, a) > 0.0
    return one < 0.0 and two < 0.0 and _side(points, p, q, c, a) < 0.0


@kernel(numba.int64(_FACES, numba.int64, numba.int64), **LEAN)
def _shared(faces: Faces, f: int, g: int) -> int:
    """Return the number of corners that two faces share."""
    count = 0
    for i in _AXES:
        for j in _AXES:
            count += faces[f, i] == faces[g, j]
    return count


@kernel(_NORMAL(CONST_MATRIX, _FACES, numba.int64), **LEAN)
def _normal(points: Points, faces: Faces, f: int) -> tuple[float, float, float]:
    """Return a normal of face f, as long as twice its area."""
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
    vx, vy, vz = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1], points[c, 2] - points[a, 2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@kernel(numba.float64(CONST_MATRIX, numba.int64, _NORMAL, numba.int64), **LEAN)
def _height(points: Points, corner: int, normal: tuple[float, float, float], p: int) -> float:
    """Return the height of point p over the plane through a corner, times the length of its normal."""
    x, y, z = normal
    height = 0.0 + x * (points[p, 0] - points[corner, 0])
    height += y * (points[p, 1] - points[corner, 1])
    return height + z * (points[p, 2] - points[corner, 2])


@kernel(numba.boolean(_FACES, numba.int64, numba.int64, numba.int64), **LEAN)
def _touches(faces: Faces, f: int, p: int, q: int) -> bool:
    """Tell whether p or q is a corner of face f."""
    touches = False
    for i in _AXES:
        touches = touches or faces[f, i] == p or faces[f, i] == q
    return touches


@kernel(numba.boolean(CONST_MATRIX, _FACES, numba.int64, numba.int64, _NORMAL), **LEAN_CALLS)
def _one_pierces(points: Points, faces: Faces, f: int, g: int, normal: tuple[float, float, float]) -> bool:
    """Tell whether an edge of f passes through g, which has the normal; but edges with an end in g."""
    p, corner = faces[f, 2], faces[g, 0]
    height = _height(points, corner, normal, p)
    for i in _AXES:
        q = faces[f, i]
        next_height = _height(points, corner, normal, q)
        is_between = height * next_height < 0.0 and not _touches(faces, g, p, q)
        if is_between and _passes_inside(points, faces, p, q, g):
            return True
        p, height = q, next_height
    return False


@kernel(numba.boolean(_BOXES, numba.int64, numba.int64), **LEAN)
def _apart(boxes: AnyArray, f: int, g: int) -> bool:
    """Tell whether the bounding boxes of two faces are disjoint."""
    apart = False
    for x in _AXES:
        apart = apart or boxes[f, x] > boxes[g, 3 + x] or boxes[g, x] > boxes[f, 3 + x]
    return apart


_GRID = (CONST_MATRIX, _FACES, _BOXES, numba.float64, numba.int64, numba.int64, INTS, INTS)


@kernel(numba.int64(*_GRID, numba.int64), **LEAN)
def _crossings_of(
    points: Points,
    faces: Faces,
    boxes: AnyArray,
    cell: float,
    buckets: int,
    first: int,
    ends: Indices,
    listed: Indices,
    f: int,
) -> int:
    """Count the faces after face f that cross it, each in one common cell only."""
    mask, here, count = buckets - 1, len(ends) - 2, 0
    i0, i1 = _span(boxes, f, 0, cell)
    j0, j1 = _span(boxes, f, 1, cell)
    k0, k1 = _span(boxes, f, 2, cell)
    normal = _normal(points, faces, f)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            for k in range(k0, k1 + 1):
                bucket = _bucket(i, j, k, mask) - first
                if bucket < 0 or bucket >= here:
                    continue
                for at in range(ends[bucket + 1] - 1, ends[bucket] - 1, -1):
                    g = listed[at]
                    if g <= f:  # faces are listed in ascending order
                        break
                    # a face is listed twice where two of its cells share the bucket
                    twice = at > ends[bucket] and listed[at - 1] == g
                    if twice or _apart(boxes, f, g) or _shared(faces, f, g) > 1:
                        continue
                    lowest = (
                        max(i0, _span(boxes, g, 0, cell)[0]) == i
                        and max(j0, _span(boxes, g, 1, cell)[0]) == j
                        and max(k0, _span(boxes, g, 2, cell)[0]) == k
                    )
                    if lowest and (
                        _one_pierces(points, faces, f, g, _normal(points, faces, g))
                        or _one_pierces(points, faces, g, f, normal)
                    ):
                        count += 1
    return count


@kernel(numba.int64(*_GRID), parallel=True)
def count_crossings(
    points: Points,
    faces: Faces,
    boxes: AnyArray,
    cell: float,
    buckets: int,
    first: int,
    ends: Indices,
    listed: Indices,
) -> int:
    """Count the pairs of faces that cross; the arguments are `fill_grid`'s.

    Neighbours across an edge are left out: they can only meet along it.
    """
    total = 0
    for f in prange(len(faces)):
        total += _crossings_of(points, faces, boxes, cell, buckets, first, ends, listed, f)
    return total
