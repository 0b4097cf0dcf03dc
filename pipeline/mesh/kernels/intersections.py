"""Find self-intersections: faces in a hashed grid, each tested against the faces in its cells."""

from __future__ import annotations

import numba
import numpy as np
from numba import prange

from pipeline.arrays import AnyArray, Faces, Indices, Points
from pipeline.kernels import kernel
from pipeline.mesh.kernels.halfedge import INTS, LEAN, MATRIX

_FACES = numba.int32[:, ::1]
_SPAN = numba.types.UniTuple(numba.int64, 2)
_AXES = (0, 1, 2)


@kernel(_SPAN(MATRIX, _FACES, numba.int64, numba.int64, numba.float64), **LEAN)
def _span(points: Points, faces: Faces, f: int, axis: int, cell: float) -> tuple[int, int]:
    """Return the first and the last cell that a face reaches along an axis."""
    a, b, c = points[faces[f, 0], axis], points[faces[f, 1], axis], points[faces[f, 2], axis]
    return int(np.floor(min(a, b, c) / cell)), int(np.floor(max(a, b, c) / cell))


@kernel(numba.int64(numba.int64, numba.int64, numba.int64, numba.int64), **LEAN)
def _bucket(i: int, j: int, k: int, mask: int) -> int:
    """Return the bucket of a cell (Teschner et al. 2003); `mask` is a power of two minus one."""
    return ((i * 73856093) ^ (j * 19349663) ^ (k * 83492791)) & mask


@kernel((MATRIX, _FACES, numba.float64, numba.int64[::1], INTS))
def fill_grid(points: Points, faces: Faces, cell: float, start: AnyArray, listed: Indices) -> None:
    """List every face in each cell that its bounding box touches, by a counting sort over the hashed cells.

    With an empty `listed` it only counts the lengths of the buckets into `start[1:]`. On the second call
    `start` holds where each bucket begins, and afterwards where it ends.
    """
    mask = len(start) - 2
    for f in range(len(faces)):
        i0, i1 = _span(points, faces, f, 0, cell)
        j0, j1 = _span(points, faces, f, 1, cell)
        k0, k1 = _span(points, faces, f, 2, cell)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                for k in range(k0, k1 + 1):
                    bucket = _bucket(i, j, k, mask)
                    if len(listed) == 0:
                        start[bucket + 1] += 1
                    else:
                        listed[start[bucket]] = f
                        start[bucket] += 1


@kernel(numba.float64(MATRIX, numba.int64, numba.int64, numba.int64, numba.int64), **LEAN)
def _side(points: Points, a: int, b: int, c: int, p: int) -> float:
    """Return six times the signed volume of tetrahedron abcp: the side of face abc that p lies on."""
    total = 0.0
    for x in _AXES:
        y, z = (x + 1) % 3, (x + 2) % 3
        one = (points[b, y] - points[a, y]) * (points[c, z] - points[a, z])
        two = (points[b, z] - points[a, z]) * (points[c, y] - points[a, y])
        total += (one - two) * (points[p, x] - points[a, x])
    return total


@kernel(numba.boolean(MATRIX, _FACES, numba.int64, numba.int64, numba.int64), **LEAN)
def _pierces(points: Points, faces: Faces, p: int, q: int, f: int) -> bool:
    """Tell whether the segment from p to q passes through the inside of face f; neither end is its corner."""
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    if _side(points, a, b, c, p) * _side(points, a, b, c, q) >= 0.0:
        return False
    one, two, three = _side(points, p, q, a, b), _side(points, p, q, b, c), _side(points, p, q, c, a)
    return bool((one > 0.0 and two > 0.0 and three > 0.0) or (one < 0.0 and two < 0.0 and three < 0.0))


@kernel(numba.int64(_FACES, numba.int64, numba.int64), **LEAN)
def _shared(faces: Faces, f: int, g: int) -> int:
    """Return the number of corners that two faces share."""
    count = 0
    for i in _AXES:
        for j in _AXES:
            count += faces[f, i] == faces[g, j]
    return count


@kernel(numba.boolean(MATRIX, _FACES, numba.int64, numba.int64), **LEAN)
def _one_pierces(points: Points, faces: Faces, f: int, g: int) -> bool:
    """Tell whether an edge of f passes through g; edges with an end in g are left out."""
    for i in _AXES:
        p, q = faces[f, i], faces[f, (i + 1) % 3]
        touches = False
        for j in _AXES:
            touches = touches or faces[g, j] == p or faces[g, j] == q
        if not touches and _pierces(points, faces, p, q, g):
            return True
    return False


@kernel(numba.boolean(MATRIX, _FACES, numba.int64, numba.int64), **LEAN)
def _apart(points: Points, faces: Faces, f: int, g: int) -> bool:
    """Tell whether the bounding boxes of two faces are disjoint."""
    for x in _AXES:
        a, b, c = points[faces[f, 0], x], points[faces[f, 1], x], points[faces[f, 2], x]
        u, v, w = points[faces[g, 0], x], points[faces[g, 1], x], points[faces[g, 2], x]
        if min(a, b, c) > max(u, v, w) or min(u, v, w) > max(a, b, c):
            return True
    return False


@kernel((MATRIX, _FACES, numba.float64, numba.int64[::1], INTS, INTS), parallel=True)
def count_crossings(
    points: Points, faces: Faces, cell: float, start: AnyArray, listed: Indices, crossings: Indices
) -> None:
    """Count the faces with a higher number that each face crosses, each pair in one common cell only.

    Neighbours across an edge are left out: they can only meet along it.
    """
    mask = len(start) - 2
    for f in prange(len(faces)):
        i0, i1 = _span(points, faces, f, 0, cell)
        j0, j1 = _span(points, faces, f, 1, cell)
        k0, k1 = _span(points, faces, f, 2, cell)
        count = 0
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                for k in range(k0, k1 + 1):
                    bucket = _bucket(i, j, k, mask)
                    for at in range(start[bucket], start[bucket + 1]):
                        g = listed[at]
                        # a face is listed twice where two of its cells share the bucket
                        twice = at > start[bucket] and listed[at - 1] == g
                        if g <= f or twice or _apart(points, faces, f, g):
                            continue
                        first = (
                            max(i0, _span(points, faces, g, 0, cell)[0]) == i
                            and max(j0, _span(points, faces, g, 1, cell)[0]) == j
                            and max(k0, _span(points, faces, g, 2, cell)[0]) == k
                        )
                        if not first or _shared(faces, f, g) > 1:
                            continue
                        if _one_pierces(points, faces, f, g) or _one_pierces(points, faces, g, f):
                            count += 1
        crossings[f] = count
