"""Normals of faces, and of vertices split where the surface has a crease."""

from __future__ import annotations

import math

import numba

from pipeline.arrays import AnyArray, Faces, Floats, Indices, Points, Vectors
from pipeline.kernels import kernel, only_read
from pipeline.mesh._kernels_halfedge import INTS, LEAN, MATRIX, SEEN_INTS, SEEN_MATRIX, fan_start, preceding

FACES = numba.int32[:, ::1]
FLAGS = numba.uint8[::1]
SEEN_FACES = only_read(FACES)
_ANGLES = numba.types.UniTuple(numba.float64, 3)


@kernel((SEEN_MATRIX, SEEN_FACES, MATRIX), error_model="numpy")
def normals_of_faces(points: Points, faces: Faces, normals: Vectors) -> None:
    """Unit normal of every face; zero without area."""
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


@kernel(_ANGLES(SEEN_MATRIX, numba.int64, numba.int64, numba.int64), **LEAN)
def _corner_angles(points: Points, a: int, b: int, c: int) -> tuple[float, float, float]:
    """Of a triangle, radians."""
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


@kernel((SEEN_MATRIX, MATRIX), error_model="numpy")
def scale_known(given: Vectors, known: Vectors) -> None:
    """Vectors (V, 3) of length 1; zero where they have no length, or are not finite."""
    for v in range(len(given)):
        x, y, z = given[v, 0], given[v, 1], given[v, 2]
        length = math.sqrt(x * x + y * y + z * z)
        if 0.0 < length < math.inf:
            known[v, 0], known[v, 1], known[v, 2] = x / length, y / length, z / length
        else:
            known[v, 0] = known[v, 1] = known[v, 2] = 0.0


@kernel((SEEN_FACES, MATRIX, MATRIX, FLAGS), error_model="numpy")
def flag_trusted(faces: Faces, face_normals: Vectors, known: Vectors, trusted: AnyArray) -> None:
    """Flag vertices whose known normal points out of all faces around that have one."""
    for v in range(len(known)):
        trusted[v] = known[v, 0] != 0.0 or known[v, 1] != 0.0 or known[v, 2] != 0.0
    for f in range(len(faces)):
        x, y, z = face_normals[f, 0], face_normals[f, 1], face_normals[f, 2]
        if x == 0.0 and y == 0.0 and z == 0.0:
            continue
        for i in range(3):
            v = faces[f, i]
            if known[v, 0] * x + known[v, 1] * y + known[v, 2] * z <= 0.0:
                trusted[v] = 0


@kernel((MATRIX, INTS, numba.float64, FLAGS))
def find_hard(normals: Vectors, twin: Indices, cosine: float, hard: AnyArray) -> None:
    """Flag half-edges on a boundary or between faces that turn by more than the angle of `cosine`.

    Those that are flagged already stay so.
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
    """Where to begin walking the corners around the vertex of h: at a crease that really divides them.

    On a closed fan one hard edge alone divides nothing: a crease that fades out leaves no seam.
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


@kernel(numba.int64(SEEN_INTS, INTS, FLAGS, FLAGS, INTS, INTS))
def number_fans(
    vert: Indices, twin: Indices, hard: AnyArray, whole: AnyArray, corner: Indices, source: Indices
) -> int:
    """Number the smooth fans of corners: `corner[h]` is the fan of corner h, `source` its vertex.

    The first fan of a vertex has the vertex's own number; further ones follow after all vertices. A vertex
    flagged in `whole` is not divided. Answers how many fans there are.
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
    return math.sqrt(rows[i, 0] * rows[i, 0] + rows[i, 1] * rows[i, 1] + rows[i, 2] * rows[i, 2])


@kernel((SEEN_MATRIX, SEEN_FACES, SEEN_FACES, MATRIX, FLAGS, MATRIX))
def sum_normals(
    points: Points, faces: Faces, fans: Faces, face_normals: Vectors, known: AnyArray, normals: Vectors
) -> None:
    """Unit normals of fans: the mean of their faces', weighted by corner angle; always finite and unit.

    fans   (F, 3) the fan of each corner
    known  (V,) flags vertices that are not asked for: what is answered there means nothing
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
    """Put the known normal of its vertex in place of a fan's, where it is trusted or agrees with that."""
    for i in range(len(normals)):
        v = source[i]
        x, y, z = known[v, 0], known[v, 1], known[v, 2]
        if trusted[v] or x * normals[i, 0] + y * normals[i, 1] + z * normals[i, 2] > 0.0:
            normals[i, 0], normals[i, 1], normals[i, 2] = x, y, z
