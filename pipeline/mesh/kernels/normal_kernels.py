"""Normals of faces, of vertices split at creases, and of points next to vertices that a flow has moved."""

from __future__ import annotations

import math

import numba

from pipeline.arrays import AnyArray, Faces, Floats, Indices, Points, Vectors
from pipeline.kernels import kernel, only_read
from pipeline.mesh.kernels.halfedge import (
    CONST_INTS,
    CONST_MATRIX,
    CONST_VECTOR,
    INTS,
    LEAN,
    MATRIX,
    fan_start,
    preceding,
)

FACES = numba.int32[:, ::1]
FLAGS = numba.uint8[::1]
CONST_FACES = only_read(FACES)
_ANGLES = numba.types.UniTuple(numba.float64, 3)

AGREEMENT = 0.7
"""Least cosine of the angle between a known normal and the triangles that it shades. At more than 45° the
surface bends within a triangle, as at the rim of a thin sheet, and its normal would be smeared over it."""


@kernel((CONST_MATRIX, CONST_FACES, MATRIX), error_model="numpy")
def normals_of_faces(points: Points, faces: Faces, normals: Vectors) -> None:
    """Compute the unit normal of every face; zero without area."""
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
        vx, vy, vz = points[c, 0] - points[b, 0], points[c, 1] - points[b, 1], points[c, 2] - points[b, 2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        area = math.sqrt(x * x + y * y + z * z)
        if 0.0 < area < math.inf and 1.0 / area < math.inf:
            scale = 1.0 / area
            normals[f, 0], normals[f, 1], normals[f, 2] = x * scale, y * scale, z * scale
        else:
            normals[f, 0] = normals[f, 1] = normals[f, 2] = 0.0


@kernel(_ANGLES(CONST_MATRIX, numba.int64, numba.int64, numba.int64), **LEAN)
def _corner_angles(points: Points, a: int, b: int, c: int) -> tuple[float, float, float]:
    """Return the three angles of a triangle, radians."""
    ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
    vx, vy, vz = points[c, 0] - points[b, 0], points[c, 1] - points[b, 1], points[c, 2] - points[b, 2]
    wx, wy, wz = points[a, 0] - points[c, 0], points[a, 1] - points[c, 1], points[a, 2] - points[c, 2]
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    area = math.sqrt(x * x + y * y + z * z)
    return (
        math.atan2(area, -(ux * wx + uy * wy + uz * wz)),
        math.atan2(area, -(vx * ux + vy * uy + vz * uz)),
        math.atan2(area, -(wx * vx + wy * vy + wz * vz)),
    )


@kernel((CONST_MATRIX, MATRIX), error_model="numpy")
def scale_known(given: Vectors, known: Vectors) -> None:
    """Scale vectors (V, 3) to length 1; zero where they have no length or are not finite."""
    for v in range(len(given)):
        x, y, z = given[v, 0], given[v, 1], given[v, 2]
        length = math.sqrt(x * x + y * y + z * z)
        if 0.0 < length < math.inf:
            known[v, 0], known[v, 1], known[v, 2] = x / length, y / length, z / length
        else:
            known[v, 0] = known[v, 1] = known[v, 2] = 0.0


@kernel((CONST_FACES, MATRIX, MATRIX, FLAGS), error_model="numpy")
def flag_trusted(faces: Faces, face_normals: Vectors, known: Vectors, trusted: AnyArray) -> None:
    """Flag vertices whose known normal agrees with all surrounding faces with area."""
    for v in range(len(known)):
        trusted[v] = known[v, 0] != 0.0 or known[v, 1] != 0.0 or known[v, 2] != 0.0
    for f in range(len(faces)):
        x, y, z = face_normals[f, 0], face_normals[f, 1], face_normals[f, 2]
        if x == 0.0 and y == 0.0 and z == 0.0:
            continue
        for i in range(3):
            v = faces[f, i]
            if known[v, 0] * x + known[v, 1] * y + known[v, 2] * z <= AGREEMENT:
                trusted[v] = 0


@kernel((MATRIX, INTS, numba.float64, FLAGS))
def find_hard(normals: Vectors, twin: Indices, cosine: float, hard: AnyArray) -> None:
    """Flag half-edges on a boundary or between faces that enclose more than the angle of `cosine`.

    Flagged half-edges stay flagged.
    """
    for h in range(len(twin)):
        k = twin[h]
        if k < 0:
            hard[h] = 1
        elif h > k and not hard[h]:
            f, g = h // 3, k // 3
            dot = (
                normals[f, 0] * normals[g, 0] + normals[f, 1] * normals[g, 1] + normals[f, 2] * normals[g, 2]
            )
            known = normals[f, 0] != 0 or normals[f, 1] != 0 or normals[f, 2] != 0
            known = known and (normals[g, 0] != 0 or normals[g, 1] != 0 or normals[g, 2] != 0)
            hard[h] = hard[k] = 1 if known and dot < cosine else 0


@kernel(numba.int64(INTS, FLAGS, numba.int64))
def _fan_begin(twin: Indices, hard: AnyArray, h: int) -> int:
    """Return the first corner around the vertex of h behind a crease; -1 - start if no crease divides them.

    In a closed fan a single hard edge divides nothing: a crease that fades out leaves no seam.
    """
    start = fan_start(twin, h)
    if twin[start] < 0:
        return start
    first, count, k = start, 0, start
    while True:
        if hard[k]:
            count += 1
            first = k
        k = twin[preceding(k)]
        if k == start:
            break
    return first if count >= 2 else -1 - start


@kernel(numba.int64(CONST_INTS, INTS, FLAGS, FLAGS, INTS, INTS))
def number_fans(
    vert: Indices, twin: Indices, hard: AnyArray, whole: AnyArray, corner: Indices, source: Indices
) -> int:
    """Number the smooth fans of corners: `corner[h]` is the fan of corner h, `source` its vertex.

    The first fan of a vertex has the vertex's own number; further fans follow after all vertices. Vertices
    flagged in `whole` are not divided. Returns the number of fans.
    """
    count = len(whole)
    for v in range(count):
        source[v] = v
    corner[:] = -1
    for h in range(len(vert)):
        if corner[h] >= 0:
            continue
        if whole[vert[h]]:
            corner[h] = vert[h]
            continue
        begin = _fan_begin(twin, hard, h)
        divided = begin >= 0
        start = begin if divided else -1 - begin
        fan, k = vert[h], start
        while True:
            corner[k] = fan
            k = twin[preceding(k)]
            if k < 0 or k == start:
                break
            if divided and hard[k]:
                source[count] = vert[h]
                fan = count
                count += 1
    return count


@kernel(numba.float64(MATRIX, numba.int64), **LEAN)
def _length(rows: Floats, i: int) -> float:
    """Return the length of row i."""
    return math.sqrt(rows[i, 0] * rows[i, 0] + rows[i, 1] * rows[i, 1] + rows[i, 2] * rows[i, 2])


@kernel((CONST_MATRIX, CONST_FACES, CONST_FACES, MATRIX, FLAGS, MATRIX))
def sum_normals(
    points: Points, faces: Faces, fans: Faces, face_normals: Vectors, known: AnyArray, normals: Vectors
) -> None:
    """Compute unit normals of fans: the mean of their faces' normals, weighted by corner angle; always unit.

    fans   (F, 3) the fan of each corner
    known  (V,) flags vertices to skip; their entries are undefined
    """
    normals[:] = 0.0
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if not (known[a] and known[b] and known[c]):
            angles = _corner_angles(points, a, b, c)
            for i in range(3):
                for k in range(3):
                    normals[fans[f, i], k] += angles[i] * face_normals[f, k]
    for f in range(len(faces)):
        for i in range(3):
            v = fans[f, i]
            if not known[faces[f, i]] and _length(normals, v) < 1e-9:
                for k in range(3):
                    normals[v, k] = face_normals[f, k]
    for v in range(len(normals)):
        length = _length(normals, v)
        if 0.0 < length < math.inf:
            for k in range(3):
                normals[v, k] /= length
        else:
            normals[v, 0], normals[v, 1], normals[v, 2] = 0.0, 1.0, 0.0


@kernel((MATRIX, FLAGS, INTS, MATRIX), error_model="numpy")
def prefer_known(known: Vectors, trusted: AnyArray, source: Indices, normals: Vectors) -> None:
    """Replace a fan's normal by the known normal of its vertex, where that is trusted or agrees with it."""
    for i in range(len(normals)):
        v = source[i]
        x, y, z = known[v, 0], known[v, 1], known[v, 2]
        if trusted[v] or x * normals[i, 0] + y * normals[i, 1] + z * normals[i, 2] > AGREEMENT:
            normals[i, 0], normals[i, 1], normals[i, 2] = x, y, z


@kernel(numba.int64(CONST_MATRIX), error_model="numpy")
def count_known(normals: Vectors) -> int:
    """Return the number of normals (V, 3) that are not zero."""
    count = 0
    for v in range(len(normals)):
        count += normals[v, 0] != 0.0 or normals[v, 1] != 0.0 or normals[v, 2] != 0.0
    return count


@kernel(numba.float64(CONST_MATRIX), error_model="numpy")
def longest_side(points: Points) -> float:
    """Return the longest side of the bounding box of points (V, 3), V > 0."""
    longest = 0.0
    for k in range(3):
        least = most = points[0, k]
        for v in range(1, len(points)):
            least, most = min(least, points[v, k]), max(most, points[v, k])
        longest = max(longest, most - least)
    return longest


@kernel((CONST_MATRIX, CONST_MATRIX, CONST_VECTOR, MATRIX), error_model="numpy")
def place_beside(points: Points, normals: Vectors, apart: Floats, beside: Points) -> None:
    """Fill `beside` (2K, 3) with two tangent points for each of the K vertices with a normal.

    First the points along all first tangents, then those along all second ones, at distance `apart`.
    t₁ × t₂ = n, by Duff et al., *Building an Orthonormal Basis, Revisited*, J. Computer Graphics
    Techniques 6 (2017).
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


@kernel((CONST_MATRIX, CONST_MATRIX, CONST_MATRIX, MATRIX), error_model="numpy")
def cross_beside(normals: Vectors, moved: Points, beside: Points, carried: Vectors) -> None:
    """Set unit normals in `carried` (V, 3) from the points of `place_beside` after a flow moved all points.

    Vertices without a normal, and those whose three points lie on a line, are left as they are.
    """
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
