"""Kernels of surface statistics: sums over faces, and the angles between neighbours."""

from __future__ import annotations

import math

import numba
import numpy as np

from flowsculpt.pipeline.arrays import Faces, Floats, Indices, Points
from flowsculpt.pipeline.kernels import kernel
from flowsculpt.pipeline.mesh.kernels.halfedge import CONST_INTS, CONST_MATRIX, INTS, VECTOR
from flowsculpt.pipeline.mesh.kernels.normal_kernels import CONST_FACES, unit_normal

_CERTAIN = 1e-6
"""Volume of a part, over the sum of those of its faces, from which on rounding does not decide its sign."""


@kernel(numba.types.UniTuple(numba.float64, 2)(CONST_MATRIX, CONST_FACES))
def lengths_and_areas(points: Points, faces: Faces) -> tuple[float, float]:
    """Return the sum of all edge lengths, each edge once for each of its faces, and the sum of all areas."""
    length, area = 0.0, 0.0
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
        vx, vy, vz = points[c, 0] - points[b, 0], points[c, 1] - points[b, 1], points[c, 2] - points[b, 2]
        wx, wy, wz = points[a, 0] - points[c, 0], points[a, 1] - points[c, 1], points[a, 2] - points[c, 2]
        length += math.sqrt(ux * ux + uy * uy + uz * uz)
        length += math.sqrt(vx * vx + vy * vy + vz * vz)
        length += math.sqrt(wx * wx + wy * wy + wz * wz)
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        area += 0.5 * math.sqrt(x * x + y * y + z * z)
    return length, area


@kernel(numba.boolean(CONST_MATRIX, CONST_FACES, CONST_INTS))
def may_face_inwards(points: Points, faces: Faces, twins: Indices) -> bool:
    """Return False where the volume of each closed part of a surface is surely above 0.

    points  with the origin near them, so that the sums keep their digits
    twins   (3F,): the half-edges across
    """
    part = np.arange(len(faces))
    for h in range(len(twins)):
        if twins[h] > h:
            one, other = h // 3, twins[h] // 3
            while part[one] != one:
                part[one] = part[part[one]]
                one = part[one]
            while part[other] != other:
                part[other] = part[part[other]]
                other = part[other]
            part[max(one, other)] = min(one, other)
    volumes, sizes = np.zeros(len(faces)), np.zeros(len(faces))
    is_open = np.zeros(len(faces), np.bool_)
    for f in range(len(faces)):
        root = part[f] = part[part[f]]  # parents are lower, so theirs are roots by now
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        x = points[b, 1] * points[c, 2] - points[b, 2] * points[c, 1]
        y = points[b, 2] * points[c, 0] - points[b, 0] * points[c, 2]
        z = points[b, 0] * points[c, 1] - points[b, 1] * points[c, 0]
        volume = points[a, 0] * x + points[a, 1] * y + points[a, 2] * z
        volumes[root] += volume
        sizes[root] += abs(volume)
        is_open[root] |= twins[3 * f] < 0 or twins[3 * f + 1] < 0 or twins[3 * f + 2] < 0
    for f in range(len(faces)):
        if part[f] == f and not is_open[f] and volumes[f] <= _CERTAIN * sizes[f]:
            return True
    return False


@kernel(numba.int64(CONST_FACES, numba.int64, INTS))
def count_ascending(faces: Faces, first: int, begins: Indices) -> int:
    """Count the half-edges from each vertex to a higher one; fill `begins` with their running total.

    first   the first vertex
    begins  (N + 1,) for N vertices from the first on; 0 at its start, all of them at its end

    Returns the number of all.
    """
    last = first + len(begins) - 1
    begins[:] = 0
    for f in range(len(faces)):
        for i in range(3):
            a = faces[f, i]
            if first <= a < last and a < faces[f, (i + 1) % 3]:
                begins[a - first + 1] += 1
    for k in range(len(begins) - 1):
        begins[k + 1] += begins[k]
    return int(begins[-1])


@kernel(numba.int64(CONST_MATRIX, CONST_FACES, numba.int64, INTS, INTS, numba.int64, VECTOR))
def cosines_at_edges(
    points: Points, faces: Faces, first: int, begins: Indices, ascending: Indices, count: int, cosines: Floats
) -> int:
    """Append the cosine between the normals of both faces at each edge to `count` others; return how many.

    The edges are those whose lower vertex `count_ascending` has counted.

    begins     as `count_ascending` has filled it; changed
    ascending  (2N,) scratch for N half-edges: the higher vertex and the face of each

    Faces must be oriented, so that an edge has one half-edge to its higher vertex and one back from it.
    """
    last = first + len(begins) - 1
    for f in range(len(faces)):
        for i in range(3):
            a, b = faces[f, i], faces[f, (i + 1) % 3]
            if first <= a < last and a < b:
                place = 2 * begins[a - first]
                ascending[place], ascending[place + 1] = b, f
                begins[a - first] += 1
    for f in range(len(faces)):
        for i in range(3):
            a, b = faces[f, i], faces[f, (i + 1) % 3]
            if first <= b < last and b < a:
                k = b - first
                for place in range(begins[k - 1] if k else 0, begins[k]):  # each begins where the next did
                    if ascending[2 * place] == a:
                        x, y, z = unit_normal(points, faces, f)
                        u, v, w = unit_normal(points, faces, ascending[2 * place + 1])
                        cosines[count] = x * u + y * v + z * w
                        count += 1
                        break
    return count
