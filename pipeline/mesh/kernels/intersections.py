"""Find self-intersections: faces in a hashed grid, each tested against the faces in its cells."""

from __future__ import annotations

import numba
import numpy as np
from numba import prange

from pipeline.arrays import AnyArray, Faces, Indices, Points, Vectors
from pipeline.kernels import kernel
from pipeline.mesh.kernels.halfedge import INTS, LEAN, MATRIX

_FACES = numba.int32[:, ::1]
_SPAN = numba.types.UniTuple(numba.int64, 2)
_AXES = (0, 1, 2)


@kernel((MATRIX, _FACES, MATRIX, MATRIX), parallel=True)
def boxes_and_normals(points: Points, faces: Faces, boxes: AnyArray, normals: Vectors) -> None:
    """Fill `boxes` (F, 6), the least x, y and z of each face, then the largest, and `normals` (F, 3).

    A normal is as long as twice the face's area.
    """
    for f in prange(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        for x in _AXES:
            y, z = (x + 1) % 3, (x + 2) % 3
            one = (points[b, y] - points[a, y]) * (points[c, z] - points[a, z])
            two = (points[b, z] - points[a, z]) * (points[c, y] - points[a, y])
            normals[f, x] = one - two
            boxes[f, x] = min(points[a, x], points[b, x], points[c, x])
            boxes[f, 3 + x] = max(points[a, x], points[b, x], points[c, x])


@kernel(_SPAN(MATRIX, numba.int64, numba.int64, numba.float64), **LEAN)
def _span(boxes: AnyArray, f: int, axis: int, cell: float) -> tuple[int, int]:
    """Return the first and the last cell that a face reaches along an axis."""
    return int(np.floor(boxes[f, axis] / cell)), int(np.floor(boxes[f, 3 + axis] / cell))


@kernel(numba.int64(numba.int64, numba.int64, numba.int64, numba.int64), **LEAN)
def _bucket(i: int, j: int, k: int, mask: int) -> int:
    """Return the bucket of a cell (Teschner et al. 2003); `mask` is a power of two minus one."""
    return ((i * 73856093) ^ (j * 19349663) ^ (k * 83492791)) & mask


@kernel((MATRIX, numba.float64, numba.int64[::1], INTS))
def fill_grid(boxes: AnyArray, cell: float, start: AnyArray, listed: Indices) -> None:
    """List every face in each cell that its bounding box touches, by a counting sort over the hashed cells.

    With an empty `listed` it only counts the lengths of the buckets into `start[1:]`. On the second call
    `start` holds where each bucket begins, and afterwards where it ends.
    """
    mask = len(start) - 2
    for f in range(len(boxes)):
        i0, i1 = _span(boxes, f, 0, cell)
        j0, j1 = _span(boxes, f, 1, cell)
        k0, k1 = _span(boxes, f, 2, cell)
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


@kernel(numba.float64(MATRIX, _FACES, MATRIX, numba.int64, numba.int64), **LEAN)
def _height(points: Points, faces: Faces, normals: Vectors, f: int, p: int) -> float:
    """Return the height of point p over the plane of face f, times the length of the face's normal."""
    total = 0.0
    for x in _AXES:
        total += normals[f, x] * (points[p, x] - points[faces[f, 0], x])
    return total


@kernel(numba.boolean(_FACES, numba.int64, numba.int64, numba.int64), **LEAN)
def _touches(faces: Faces, f: int, p: int, q: int) -> bool:
    """Tell whether p or q is a corner of face f."""
    touches = False
    for i in _AXES:
        touches = touches or faces[f, i] == p or faces[f, i] == q
    return touches


@kernel(numba.boolean(MATRIX, _FACES, MATRIX, numba.int64, numba.int64), **LEAN)
def _one_pierces(points: Points, faces: Faces, normals: Vectors, f: int, g: int) -> bool:
    """Tell whether an edge of f passes through g; edges with an end in g are left out."""
    p = faces[f, 2]
    height = _height(points, faces, normals, g, p)
    for i in _AXES:
        q = faces[f, i]
        next_height = _height(points, faces, normals, g, q)
        is_between = height * next_height < 0.0 and not _touches(faces, g, p, q)
        if is_between and _passes_inside(points, faces, p, q, g):
            return True
        p, height = q, next_height
    return False


@kernel(numba.boolean(MATRIX, numba.int64, numba.int64), **LEAN)
def _apart(boxes: AnyArray, f: int, g: int) -> bool:
    """Tell whether the bounding boxes of two faces are disjoint."""
    apart = False
    for x in _AXES:
        apart = apart or boxes[f, x] > boxes[g, 3 + x] or boxes[g, x] > boxes[f, 3 + x]
    return apart


@kernel((MATRIX, _FACES, MATRIX, MATRIX, numba.float64, numba.int64[::1], INTS, INTS), parallel=True)
def count_crossings(
    points: Points,
    faces: Faces,
    boxes: AnyArray,
    normals: Vectors,
    cell: float,
    start: AnyArray,
    listed: Indices,
    crossings: Indices,
) -> None:
    """Count the faces with a higher number that each face crosses, each pair in one common cell only.

    Neighbours across an edge are left out: they can only meet along it.
    """
    mask = len(start) - 2
    for f in prange(len(faces)):
        i0, i1 = _span(boxes, f, 0, cell)
        j0, j1 = _span(boxes, f, 1, cell)
        k0, k1 = _span(boxes, f, 2, cell)
        count = 0
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                for k in range(k0, k1 + 1):
                    bucket = _bucket(i, j, k, mask)
                    for at in range(start[bucket + 1] - 1, start[bucket] - 1, -1):
                        g = listed[at]
                        if g <= f:  # faces are listed in ascending order
                            break
                        # a face is listed twice where two of its cells share the bucket
                        twice = at > start[bucket] and listed[at - 1] == g
                        if twice or _apart(boxes, f, g) or _shared(faces, f, g) > 1:
                            continue
                        first = (
                            max(i0, _span(boxes, g, 0, cell)[0]) == i
                            and max(j0, _span(boxes, g, 1, cell)[0]) == j
                            and max(k0, _span(boxes, g, 2, cell)[0]) == k
                        )
                        if first and (
                            _one_pierces(points, faces, normals, f, g)
                            or _one_pierces(points, faces, normals, g, f)
                        ):
                            count += 1
        crossings[f] = count
