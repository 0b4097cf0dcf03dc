"""Point-normal triangles: a cubic patch over every triangle, from its corners and their normals."""

from __future__ import annotations

import math

import numba
import numpy as np

from pipeline.arrays import Faces, Floats, Indices, Points, Vectors
from pipeline.kernels import kernel
from pipeline.mesh.kernels.halfedge import INTS, MATRIX, VECTOR, following
from pipeline.mesh.kernels.normals import FACES

_SHARP = math.sin(math.radians(5.0)) ** 2  # below, the two sides of a crease count as one


@kernel(numba.boolean(VECTOR))
def _normalise(v: Floats) -> bool:
    """Scale a vector to length 1; return False if it has no length."""
    length = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if length < 1e-12:
        return False
    for k in range(3):
        v[k] /= length
    return True


@kernel((MATRIX, MATRIX, INTS, INTS, MATRIX, VECTOR))
def border_controls(
    points: Points, normals: Vectors, corners: Indices, twin: Indices, controls: Points, axis: Floats
) -> None:
    """Compute the two inner control points of the border curve of every half-edge h: rows 2h and 2h + 1.

    A curve leaves its ends orthogonal to their normals. At a crease, where the two sides have different
    normals, it leaves along the crease; both sides compute the same bits. `corners` is the vertex at the
    start of each half-edge, `axis` is scratch for three numbers.
    """
    for h in range(len(corners)):
        a, b = corners[h], corners[following(h)]
        other = a if twin[h] < 0 else corners[following(twin[h])]
        m, n = normals[a], normals[other]
        axis[0] = m[1] * n[2] - m[2] * n[1]
        axis[1] = m[2] * n[0] - m[0] * n[2]
        axis[2] = m[0] * n[1] - m[1] * n[0]
        sharp = axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2] > _SHARP
        if not sharp:
            for k in range(3):
                axis[k] = m[k] + n[k]
        known = _normalise(axis)
        along = 0.0
        for k in range(3):
            along += (points[b, k] - points[a, k]) * axis[k]
        for k in range(3):
            tangent = points[b, k] - points[a, k]
            if sharp:
                tangent = along * axis[k]
            elif known:
                tangent -= along * axis[k]
            controls[2 * h, k] = points[a, k] + tangent / 3.0
            if twin[h] < 0:
                continue
            controls[2 * twin[h] + 1, k] = controls[2 * h, k]
    for h in range(len(corners)):
        if twin[h] < 0:  # no twin has filled in this row
            a, b = corners[h], corners[following(h)]
            along = 0.0
            for k in range(3):
                along += (points[a, k] - points[b, k]) * normals[b, k]
            for k in range(3):
                tangent = points[a, k] - points[b, k] - along * normals[b, k]
                controls[2 * h + 1, k] = points[b, k] + tangent / 3.0


@kernel((MATRIX, MATRIX, numba.int64, numba.int64, VECTOR))
def _middle_normal(points: Points, normals: Vectors, a: int, b: int, out: Floats) -> None:
    """Write the normal half way: the mean of both, mirrored in the plane across the edge."""
    square, along = 0.0, 0.0
    for k in range(3):
        d = points[b, k] - points[a, k]
        square += d * d
        along += d * (normals[a, k] + normals[b, k])
    factor = 2.0 * along / square if square > 0.0 else 0.0
    for k in range(3):
        out[k] = normals[a, k] + normals[b, k] - factor * (points[b, k] - points[a, k])
    if not _normalise(out):
        for k in range(3):
            out[k] = normals[a, k]


@kernel((INTS, INTS, MATRIX, INTS, numba.int64, MATRIX, MATRIX))
def fill_edges(
    corners: Indices,
    twin: Indices,
    controls: Points,
    places: Indices,
    pieces: int,
    points: Points,
    normals: Vectors,
) -> None:
    """Compute the vertices within the border curves: of half-edge h from row `places[h]` >= 0 on.

    Positions are always computed from the lower of the two half-edges of an edge.
    """
    middle, mixed = np.empty(3), np.empty(3)
    for h in range(len(corners)):
        if places[h] < 0:
            continue
        a, b = corners[h], corners[following(h)]
        _middle_normal(points, normals, a, b, middle)
        turned = 0 <= twin[h] < h
        low = twin[h] if turned else h
        start, end = corners[low], corners[following(low)]
        for i in range(1, pieces):
            t = i / pieces
            s, row = 1.0 - t, places[h] + i - 1
            for k in range(3):
                mixed[k] = s * s * normals[a, k] + 2.0 * s * t * middle[k] + t * t * normals[b, k]
            known = _normalise(mixed)
            for k in range(3):
                normals[row, k] = mixed[k] if known else normals[a, k]
            t = (pieces - i) / pieces if turned else i / pieces
            s = 1.0 - t
            for k in range(3):
                inner = s * controls[2 * low, k] + t * controls[2 * low + 1, k]
                points[row, k] = (
                    s * s * s * points[start, k] + 3.0 * s * t * inner + t * t * t * points[end, k]
                )


@kernel((MATRIX, MATRIX, MATRIX, INTS, MATRIX, VECTOR, numba.int64))
def _evaluate(
    points: Points,
    normals: Vectors,
    controls: Points,
    corners: Indices,
    middles: Vectors,
    w: Floats,
    row: int,
) -> None:
    """Evaluate the patch of a face at barycentric weights w into a row of points and normals.

    controls (7, 3): two of each border, and the one in the middle; middles (3, 3): the normals half way.
    """
    x, y, z = w[0], w[1], w[2]
    for k in range(3):
        p, q, r = points[corners[0], k], points[corners[1], k], points[corners[2], k]
        points[row, k] = (
            x * x * x * p
            + y * y * y * q
            + z * z * z * r
            + 3.0 * x * y * (x * controls[0, k] + y * controls[1, k])
            + 3.0 * y * z * (y * controls[2, k] + z * controls[3, k])
            + 3.0 * z * x * (z * controls[4, k] + x * controls[5, k])
            + 6.0 * x * y * z * controls[6, k]
        )
        p, q, r = normals[corners[0], k], normals[corners[1], k], normals[corners[2], k]
        normals[row, k] = x * x * p + y * y * q + z * z * r
        normals[row, k] += 2.0 * (x * y * middles[0, k] + y * z * middles[1, k] + z * x * middles[2, k])
    if not _normalise(normals[row]):
        for k in range(3):
            normals[row, k] = normals[corners[0], k]


@kernel((FACES, MATRIX, numba.int64, numba.int64, MATRIX, MATRIX))
def fill_faces(
    faces: Faces, controls: Points, pieces: int, first: int, points: Points, normals: Vectors
) -> None:
    """Compute the vertices within the patches, from row `first` on, face after face."""
    mine, middles, w, row = np.empty((7, 3)), np.empty((3, 3)), np.empty(3), first
    for f in range(len(faces)):
        corners = faces[f]
        for i in range(3):
            _middle_normal(points, normals, corners[i], corners[(i + 1) % 3], middles[i])
        for k in range(3):
            borders, ends = 0.0, 0.0
            for i in range(6):
                mine[i, k] = controls[6 * f + i, k]
                borders += mine[i, k] / 6.0
            for i in range(3):
                ends += points[corners[i], k] / 3.0
            mine[6, k] = borders + 0.5 * (borders - ends)
        for i in range(1, pieces - 1):
            for j in range(1, pieces - i):
                w[1], w[2] = i / pieces, j / pieces
                w[0] = (pieces - i - j) / pieces
                _evaluate(points, normals, mine, corners, middles, w, row)
                row += 1
