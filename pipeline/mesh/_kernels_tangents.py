"""Points beside vertices, and the normals that these make when a flow has moved them."""

from __future__ import annotations

import math

import numba

from pipeline.arrays import Floats, Points, Vectors
from pipeline.kernels import kernel
from pipeline.mesh._kernels_halfedge import MATRIX, SEEN_MATRIX, SEEN_VECTOR


@kernel(numba.int64(SEEN_MATRIX), error_model="numpy")
def count_known(normals: Vectors) -> int:
    """How many normals (V, 3) are not zero."""
    count = 0
    for v in range(len(normals)):
        count += normals[v, 0] != 0.0 or normals[v, 1] != 0.0 or normals[v, 2] != 0.0
    return count


@kernel(numba.float64(SEEN_MATRIX), error_model="numpy")
def longest_side(points: Points) -> float:
    """Of the box around points (V, 3), one at least."""
    longest = 0.0
    for k in range(3):
        least = most = points[0, k]
        for v in range(1, len(points)):
            least, most = min(least, points[v, k]), max(most, points[v, k])
        longest = max(longest, most - least)
    return longest


@kernel((SEEN_MATRIX, SEEN_MATRIX, SEEN_VECTOR, MATRIX), error_model="numpy")
def place_beside(points: Points, normals: Vectors, apart: Floats, beside: Points) -> None:
    """Fill `beside` (2K, 3): for the K vertices with a normal a point along a first tangent, in order, and
    then for each one along the second.

    `apart` says how far. t₁ × t₂ = n, by Duff et al., *Building an Orthonormal Basis, Revisited*, J. Computer
    Graphics Techniques 6 (2017).
    """
    one, two = 0, len(beside) // 2
    for v in range(len(points)):
        x, y, z = normals[v, 0], normals[v, 1], normals[v, 2]
        if x == 0.0 and y == 0.0 and z == 0.0:
            continue
        sign = math.copysign(1.0, z)
        a = -1.0 / (sign + z)
        b, step = x * y * a, apart[v]
        beside[one, 0] = points[v, 0] + step * (1.0 + sign * x * x * a)
        beside[one, 1] = points[v, 1] + step * (sign * b)
        beside[one, 2] = points[v, 2] + step * (-sign * x)
        beside[two, 0] = points[v, 0] + step * b
        beside[two, 1] = points[v, 1] + step * (sign + y * y * a)
        beside[two, 2] = points[v, 2] + step * -y
        one, two = one + 1, two + 1


@kernel((SEEN_MATRIX, SEEN_MATRIX, SEEN_MATRIX, MATRIX), error_model="numpy")
def cross_beside(normals: Vectors, moved: Points, beside: Points, carried: Vectors) -> None:
    """Set unit normals in `carried` (V, 3) by the points of `place_beside`, when a flow has taken them and
    the vertices along; not where there was none, nor where the three points lie on a line."""
    one, two = 0, len(beside) // 2
    for v in range(len(normals)):
        if normals[v, 0] == 0.0 and normals[v, 1] == 0.0 and normals[v, 2] == 0.0:
            continue
        ax, bx = beside[one, 0] - moved[v, 0], beside[two, 0] - moved[v, 0]
        ay, by = beside[one, 1] - moved[v, 1], beside[two, 1] - moved[v, 1]
        az, bz = beside[one, 2] - moved[v, 2], beside[two, 2] - moved[v, 2]
        x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        length = math.sqrt(x * x + y * y + z * z)
        if 0.0 < length < math.inf:
            carried[v, 0], carried[v, 1], carried[v, 2] = x / length, y / length, z / length
        one, two = one + 1, two + 1
