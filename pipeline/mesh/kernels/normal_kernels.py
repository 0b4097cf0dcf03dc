"""Normals of faces, of vertices split at creases, and of points next to vertices that a flow has moved.

Point-normal triangles are cubic patches over the triangles, from their corners and normals.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Faces, Floats, Indices, Points, Vectors
from flowsculpt.pipeline.kernels import kernel, only_read
from flowsculpt.pipeline.mesh.kernels.halfedge import (
    CONST_INTS,
    CONST_MATRIX,
    CONST_VECTOR,
    INTS,
    LEAN,
    MATRIX,
    VECTOR,
    fan_start,
    following,
    preceding,
)

FACES = numba.int32[:, ::1]
FLAGS = numba.uint8[::1]
CONST_FACES = only_read(FACES)
_TRIPLE = numba.types.UniTuple(numba.float64, 3)

AGREEMENT = 0.7
"""Least cosine of the angle between a known normal and the triangles that it shades. At more than 45° the
surface bends within a triangle, as at the rim of a thin sheet, and its normal would be smeared over it."""


@kernel(_TRIPLE(CONST_MATRIX, CONST_FACES, numba.int64), **LEAN)
def unit_normal(points: Points, faces: Faces, f: int) -> tuple[float, float, float]:
    """Return the unit normal of a face; zero without area."""
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
    vx, vy, vz = points[c, 0] - points[b, 0], points[c, 1] - points[b, 1], points[c, 2] - points[b, 2]
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    area = math.sqrt(x * x + y * y + z * z)
    if 0.0 < area < math.inf and 1.0 / area < math.inf:
        scale = 1.0 / area
        return x * scale, y * scale, z * scale
    return 0.0, 0.0, 0.0


@kernel((CONST_MATRIX, CONST_FACES, MATRIX), error_model="numpy")
def normals_of_faces(points: Points, faces: Faces, normals: Vectors) -> None:
    """Compute the unit normal of every face; zero without area."""
    for f in range(len(faces)):
        normals[f, 0], normals[f, 1], normals[f, 2] = unit_normal(points, faces, f)


@kernel(_TRIPLE(CONST_MATRIX, numba.int64, numba.int64, numba.int64), **LEAN)
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


_SHARP = math.sin(math.radians(5.0)) ** 2  # below, the two sides of a crease count as one


@kernel(numba.boolean(VECTOR), **LEAN)
def _normalise(v: Floats) -> bool:
    """Scale a vector to length 1; return False if it has no length."""
    length = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if length < 1e-12:
        return False
    for k in range(3):
        v[k] /= length
    return True


@kernel((MATRIX, MATRIX, MATRIX, INTS, INTS, numba.int64, VECTOR), **LEAN)
def _control_at_start(
    points: Points, normals: Vectors, axes: Vectors, corners: Indices, twin: Indices, h: int, out: Floats
) -> None:
    """Write the inner control point, nearest to the start of half-edge h, of the border curve along it.

    A curve leaves its ends orthogonal to their normals. At a crease, where the two sides have different
    normals, it leaves along the crease; both sides compute the same bits.
    """
    a, b = corners[h], corners[following(h)]
    other = a if twin[h] < 0 else corners[following(twin[h])]
    sharp = False
    for k in range(3):
        out[k] = axes[a, k]
    if other != a:
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            out[k] = normals[a, i] * normals[other, j] - normals[a, j] * normals[other, i]
        sharp = out[0] * out[0] + out[1] * out[1] + out[2] * out[2] > _SHARP
        if not sharp:
            for k in range(3):
                out[k] = normals[a, k] + normals[other, k]
        if not _normalise(out):
            out[0] = out[1] = out[2] = 0.0
    along = 0.0
    for k in range(3):
        along += (points[b, k] - points[a, k]) * out[k]
    for k in range(3):
        tangent = along * out[k] if sharp else points[b, k] - points[a, k] - along * out[k]
        out[k] = points[a, k] + tangent / 3.0


@kernel((MATRIX, MATRIX, MATRIX, INTS, INTS, numba.int64, MATRIX), **LEAN)
def _controls(
    points: Points, normals: Vectors, axes: Vectors, corners: Indices, twin: Indices, h: int, out: Points
) -> None:
    """Write the two inner control points of the border curve along half-edge h into `out` (2, 3)."""
    for end in range(2):
        if end == 0 or twin[h] >= 0:
            start = twin[h] if end else h
            _control_at_start(points, normals, axes, corners, twin, start, out[end])
            continue
        a, b, along = corners[h], corners[following(h)], 0.0
        for k in range(3):
            along += (points[a, k] - points[b, k]) * normals[b, k]
        for k in range(3):
            tangent = points[a, k] - points[b, k] - along * normals[b, k]
            out[1, k] = points[b, k] + tangent / 3.0


@kernel((MATRIX, MATRIX, numba.int64, numba.int64, VECTOR), **LEAN)
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


@kernel(numba.int64(INTS, INTS, numba.int64, numba.int64, INTS))
def number_edges(corners: Indices, twin: Indices, first: int, pieces: int, places: Indices) -> int:
    """Number the vertices within the edges from `first` on; return the next number.

    `places[h]` is the first vertex within half-edge h, on the way from its start to its end. Two half-edges
    share theirs where they share their ends: not along a crease, whose sides differ in normals. The one with
    the higher number then has -1 less the place of the other.
    """
    for h in range(len(corners)):
        k = twin[h]
        shared = 0 <= k < h and corners[h] == corners[following(k)] and corners[k] == corners[following(h)]
        if shared:
            places[h] = -1 - places[k]
        else:
            places[h] = first
            first += pieces - 1
    return first


@kernel((INTS, INTS, MATRIX, INTS, numba.int64, MATRIX, MATRIX), error_model="numpy")
def fill_edges(
    corners: Indices,
    twin: Indices,
    axes: Vectors,
    places: Indices,
    pieces: int,
    points: Points,
    normals: Vectors,
) -> None:
    """Compute the vertices within the border curves: of half-edge h from row `places[h]` >= 0 on.

    Positions are always computed from the lower of the two half-edges of an edge.
    """
    middle, mixed, controls = np.empty(3), np.empty(3), np.empty((2, 3))
    for h in range(len(corners)):
        if places[h] < 0:
            continue
        a, b = corners[h], corners[following(h)]
        _middle_normal(points, normals, a, b, middle)
        turned = 0 <= twin[h] < h
        low = twin[h] if turned else h
        start, end = corners[low], corners[following(low)]
        _controls(points, normals, axes, corners, twin, low, controls)
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
                inner = s * controls[0, k] + t * controls[1, k]
                points[row, k] = (
                    s * s * s * points[start, k] + 3.0 * s * t * inner + t * t * t * points[end, k]
                )


@kernel((MATRIX, MATRIX, MATRIX, INTS, MATRIX, VECTOR, numba.int64), error_model="numpy")
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


@kernel((INTS, INTS, MATRIX, numba.int64, numba.int64, MATRIX, MATRIX), error_model="numpy")
def fill_faces(
    corners: Indices, twin: Indices, axes: Vectors, pieces: int, first: int, points: Points, normals: Vectors
) -> None:
    """Compute the vertices within the patches, from row `first` on, face after face."""
    if pieces < 3:
        return
    controls, middles, w, row = np.empty((7, 3)), np.empty((3, 3)), np.empty(3), first
    for h in range(0, len(corners), 3):
        face = corners[h : h + 3]
        for i in range(3):
            _middle_normal(points, normals, face[i], face[(i + 1) % 3], middles[i])
            _controls(points, normals, axes, corners, twin, h + i, controls[2 * i : 2 * i + 2])
        for k in range(3):
            borders, ends = 0.0, 0.0
            for i in range(6):
                borders += controls[i, k] / 6.0
            for i in range(3):
                ends += points[face[i], k] / 3.0
            controls[6, k] = borders + 0.5 * (borders - ends)
        for i in range(1, pieces - 1):
            for j in range(1, pieces - i):
                w[1], w[2] = i / pieces, j / pieces
                w[0] = (pieces - i - j) / pieces
                _evaluate(points, normals, controls, face, middles, w, row)
                row += 1


@kernel((INTS, INTS, INTS, numba.int64, numba.int64, INTS, FACES, FACES))
def cut_faces(
    corners: Indices,
    twin: Indices,
    places: Indices,
    pieces: int,
    first: int,
    source: Indices,
    grid: Faces,
    cut: Faces,
) -> None:
    """Cut every face into pieces² `cut` faces; give new vertices the `source` vertex of the nearest corner.

    `places` is that of `number_edges`, `first` the first vertex within faces, `grid` scratch for the vertices
    (pieces + 1, pieces + 1) of a face: [i, j] lies i pieces towards its second corner, j towards its third.
    """
    row = 0
    for h in range(0, len(corners), 3):
        grid[0, 0], grid[pieces, 0], grid[0, pieces] = corners[h], corners[h + 1], corners[h + 2]
        for side in range(3):
            e, following_side = h + side, (side + 1) % 3
            for k in range(1, pieces):
                vertex = places[e] + k - 1 if places[e] >= 0 else pieces - 2 - places[e] - k
                if side == 0:
                    grid[k, 0] = vertex
                elif side == 1:
                    grid[pieces - k, k] = vertex
                else:
                    grid[0, pieces - k] = vertex
                nearest = side if 2 * k < pieces else following_side
                if 2 * k == pieces:
                    nearest = min(side, following_side)
                    if places[e] < 0 and (twin[e] + 1) % 3 > (e + 1) % 3:
                        continue  # both are as near; the face across has decided
                source[vertex] = source[corners[h + nearest]]
        for i in range(1, pieces - 1):
            for j in range(1, pieces - i):
                nearest = 0
                if i > pieces - i - j:
                    nearest = 1
                if j > max(i, pieces - i - j):
                    nearest = 2
                grid[i, j], source[first] = first, source[corners[h + nearest]]
                first += 1
        for i in range(pieces):
            for j in range(pieces - i):
                cut[row, 0], cut[row, 1], cut[row, 2] = grid[i, j], grid[i + 1, j], grid[i, j + 1]
                row += 1
                if i + j < pieces - 1:
                    cut[row, 0], cut[row, 1], cut[row, 2] = (
                        cut[row - 1, 1],
                        grid[i + 1, j + 1],
                        grid[i, j + 1],
                    )
                    row += 1


@kernel((CONST_FACES, CONST_FACES, numba.int64, CONST_INTS, CONST_MATRIX, MATRIX), error_model="numpy")
def spread_values(
    faces: Faces, cut: Faces, pieces: int, source: Indices, values: Floats, spread: Floats
) -> None:
    """Interpolate `values` (V, k) linearly from the corners of faces to the vertices of their `cut` faces."""
    row = 0
    for f in range(len(faces)):
        a, b, c = source[faces[f, 0]], source[faces[f, 1]], source[faces[f, 2]]
        for i in range(pieces):
            for j in range(pieces - i):
                for corner in range(3):
                    x, y = i + (corner == 1), j + (corner == 2)
                    if (corner > 0 and x + y < pieces) or (corner == 2 and x > 0):
                        continue  # it is the first corner of another cut face, or the second
                    u, v, w = (pieces - x - y) / pieces, x / pieces, y / pieces
                    vertex = cut[row, corner]
                    for k in range(values.shape[1]):
                        spread[vertex, k] = u * values[a, k] + v * values[b, k] + w * values[c, k]
                row += 2 if i + j < pieces - 1 else 1
