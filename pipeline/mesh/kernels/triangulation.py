"""Find the best triangulation of a polygon by dynamic programming over its diagonals."""

from __future__ import annotations

import numba
import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Faces, Points
from flowsculpt.pipeline.kernels import kernel
from flowsculpt.pipeline.mesh.kernels.halfedge import INTS, MATRIX, VECTOR

FORBIDDEN = 1e30
"""Cost of a diagonal that is an edge already; it is used only if nothing else is left."""

_FLAT = 1e9  # cost of a triangle without area, worse than any with area
_TURNED = 1e13  # the cost of a triangle that is turned over
_LEAST = 1e-9  # twice the area over the sum of the squared sides; below it a triangle has no area


@kernel(numba.float64(MATRIX, numba.int64, numba.int64, numba.int64, VECTOR))
def _cost(points: Points, i: int, k: int, j: int, normal: Points) -> float:
    """Return the sum of the cotangents of a triangle's angles: a quarter of its squared sides over its area.

    It grows without bound as the triangle becomes a sliver. The area is measured along `normal`.
    """
    area, sides = 0.0, 0.0
    for x in range(3):
        y, z = (x + 1) % 3, (x + 2) % 3
        uy, uz = points[k, y] - points[i, y], points[k, z] - points[i, z]
        vy, vz = points[j, y] - points[i, y], points[j, z] - points[i, z]
        area += normal[x] * (uy * vz - uz * vy)
        sides += (points[k, x] - points[i, x]) ** 2
        sides += (points[j, x] - points[i, x]) ** 2
        sides += (points[j, x] - points[k, x]) ** 2
    if area > _LEAST * sides:
        return float(sides / (2.0 * area))
    return _FLAT if area >= -_LEAST * sides else _TURNED


@kernel((MATRIX, VECTOR))
def _newell(points: Points, normal: Points) -> None:
    """Write the unit normal of the plane that fits a polygon best (Newell); zero for one without area."""
    normal[:] = 0.0
    for i in range(1, len(points) - 1):
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            uy, uz = points[i, y] - points[0, y], points[i, z] - points[0, z]
            vy, vz = points[i + 1, y] - points[0, y], points[i + 1, z] - points[0, z]
            normal[x] += uy * vz - uz * vy
    length = np.sqrt((normal * normal).sum())
    if length > 0 and np.isfinite(1.0 / length):
        normal /= length


@kernel(numba.float64(MATRIX, numba.uint8[:, ::1], numba.int32[:, ::1]))
def triangulate_polygon(points: Points, taken: AnyArray, triangles: Faces) -> float:
    """Cut a polygon of n corners, (n, 3), into the n - 2 triangles with the least sum of costs.

    taken      (n, n): 1 where corners i < j may not be joined
    triangles  (n - 2, 3), filled with corner numbers, oriented like the polygon

    Returns the cost: below `FORBIDDEN` if no taken diagonal was used. `best[i, j]` is the least cost of the
    part of the polygon from corner i to corner j > i, and `tip[i, j]` the third corner of the triangle on its
    side i-j (Klincsek 1980).
    """
    n = len(points)
    normal = np.empty(3)
    _newell(points, normal)
    best, tip = np.zeros((n, n)), np.zeros((n, n), np.int32)
    for span in range(2, n):
        for i in range(n - span):
            j = i + span
            least = np.inf
            for k in range(i + 1, j):
                cost = best[i, k] + best[k, j] + _cost(points, i, k, j, normal)
                if cost < least:
                    least, tip[i, j] = cost, k
            best[i, j] = least + FORBIDDEN if taken[i, j] else least
    stack = np.empty((n, 2), np.int32)
    stack[0, 0], stack[0, 1] = 0, n - 1
    waiting, done = 1, 0
    while waiting:
        waiting -= 1
        i, j = stack[waiting]
        k = tip[i, j]
        triangles[done, 0], triangles[done, 1], triangles[done, 2] = i, k, j
        done += 1
        if k - i > 1:
            stack[waiting, 0], stack[waiting, 1] = i, k
            waiting += 1
        if j - k > 1:
            stack[waiting, 0], stack[waiting, 1] = k, j
            waiting += 1
    return float(best[0, n - 1])


@kernel((MATRIX, INTS, INTS, numba.int32[:, ::1]))
def triangulate_all(points: Points, offsets: AnyArray, corners: AnyArray, triangles: Faces) -> None:
    """Compute the best triangles of every polygon, one polygon after the other, as vertex numbers.

    Assigning slices would compile in twice the time: numba brings its messages about shapes along.
    """
    done = 0
    for f in range(len(offsets) - 1):
        start, n = offsets[f], offsets[f + 1] - offsets[f]
        if n == 3:
            for i in range(3):
                triangles[done, i] = corners[start + i]
            done += 1
            continue
        part = np.empty((n, 3))
        for i in range(n):
            for k in range(3):
                part[i, k] = points[corners[start + i], k]
        triangulate_polygon(part, np.zeros((n, n), np.uint8), triangles[done : done + n - 2])
        for t in range(done, done + n - 2):
            for i in range(3):
                triangles[t, i] = corners[start + triangles[t, i]]
        done += n - 2
