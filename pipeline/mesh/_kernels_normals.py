"""Normals of faces, and of vertices split where the surface has a crease."""

from __future__ import annotations

import numba
import numpy as np

from pipeline.arrays import AnyArray, Faces, Floats, Indices, Points, Vectors
from pipeline.kernels import kernel
from pipeline.mesh._kernels_halfedge import INTS, MATRIX, fan_start, preceding

FACES = numba.int32[:, ::1]
FLAGS = numba.uint8[::1]


@kernel((MATRIX, FACES, MATRIX, MATRIX))
def face_frames(points: Points, faces: Faces, normals: Vectors, angles: Floats) -> None:
    """Unit normal (zero without area) and the three corner angles, radians, of every face."""
    edge = np.empty((3, 3))
    for f in range(len(faces)):
        for i in range(3):
            for k in range(3):
                edge[i, k] = points[faces[f, (i + 1) % 3], k] - points[faces[f, i], k]
        x = edge[0, 1] * edge[1, 2] - edge[0, 2] * edge[1, 1]
        y = edge[0, 2] * edge[1, 0] - edge[0, 0] * edge[1, 2]
        z = edge[0, 0] * edge[1, 1] - edge[0, 1] * edge[1, 0]
        area = np.sqrt(x * x + y * y + z * z)
        scale = 1.0 / area if area > 0 and np.isfinite(1.0 / area) else 0.0
        normals[f, 0], normals[f, 1], normals[f, 2] = x * scale, y * scale, z * scale
        for i in range(3):
            dot = 0.0
            for k in range(3):
                dot -= edge[i, k] * edge[(i + 2) % 3, k]
            angles[f, i] = np.arctan2(area, dot)


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


@kernel(numba.int64(INTS, INTS, FLAGS, FLAGS, INTS, INTS))
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
        begin = _fan_begin(twin, hard, h)
        divided = begin >= 0
        start = begin if divided else -1 - begin
        fan, k = vert[h], start
        while True:
            corner[k] = fan
            k = twin[preceding(k)]
            if k < 0 or k == start:
                break
            if divided and hard[k] and not whole[vert[h]]:
                source[count] = vert[h]
                fan = count
                count += 1
    return count


@kernel(numba.float64(MATRIX, numba.int64))
def _length(rows: Floats, i: int) -> float:
    length: float = np.sqrt(rows[i, 0] ** 2 + rows[i, 1] ** 2 + rows[i, 2] ** 2)
    return length


@kernel((FACES, MATRIX, MATRIX, MATRIX))
def sum_normals(faces: Faces, face_normals: Vectors, weights: Floats, normals: Vectors) -> None:
    """Unit normals of vertices: the mean of their faces', weighted by corner; always finite and unit."""
    normals[:] = 0.0
    for f in range(len(faces)):
        for i in range(3):
            for k in range(3):
                normals[faces[f, i], k] += weights[f, i] * face_normals[f, k]
    for f in range(len(faces)):
        for i in range(3):
            v = faces[f, i]
            if _length(normals, v) < 1e-9:
                for k in range(3):
                    normals[v, k] = face_normals[f, k]
    for v in range(len(normals)):
        length = _length(normals, v)
        if length > 0:
            for k in range(3):
                normals[v, k] /= length
        else:
            normals[v, 1] = 1.0
