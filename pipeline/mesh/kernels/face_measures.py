"""Kernels of surface statistics: sums over faces, and the angles between neighbours."""

from __future__ import annotations

import math

import numba

from pipeline.arrays import Faces, Floats, Indices, Points, Vectors
from pipeline.kernels import kernel, only_read
from pipeline.mesh.kernels.halfedge import CONST_MATRIX, INTS, MATRIX, VECTOR

_CONST_FACES = only_read(numba.int32[:, ::1])


@kernel(numba.types.UniTuple(numba.float64, 2)(CONST_MATRIX, _CONST_FACES))
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


@kernel(numba.int64(MATRIX, INTS, VECTOR))
def cosines_at_edges(normals: Vectors, twin: Indices, cosines: Floats) -> int:
    """Fill `cosines` with that of the angle between the two normals at each edge; return their number."""
    count = 0
    for h in range(len(twin)):
        k = twin[h]
        if k > h:
            f, g = h // 3, k // 3
            cosines[count] = (
                normals[f, 0] * normals[g, 0] + normals[f, 1] * normals[g, 1] + normals[f, 2] * normals[g, 2]
            )
            count += 1
    return count
