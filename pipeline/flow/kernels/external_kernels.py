"""External functions of velocity programs: the nearest of triangles, and samples on a grid.

Triangles are one flat array: a tree of boxes, eight numbers each, and then the triangles, nine each. A box
has its lower corner 0:3, its upper corner 3:6, and 6 and 7: a leaf its first triangle and their count, any
other its second child and 0; its first child follows it. A triangle with two equal corners is a segment, with
three a point.

The constants of a grid are one flat array: the three counts 0:3, the interpolation 3 (1: cubic), the mode
outside 4 (see below), 1 if samples are single precision 5, the geometry 6 (0: flat, 1: a sphere, 2: a sphere
along which all moves, 3: turned), and the three axes from 7 on; behind these, of a turned grid, the matrix
with the directions of its axes as columns. Samples are another, three numbers each, the last axis
running fastest.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic

from flowsculpt.pipeline.arrays import AnyArray, Floats, Points
from flowsculpt.pipeline.flow.kernels.instructions import doubles_at
from flowsculpt.pipeline.kernels import block_kernel, kernel

DEEPEST = 64
"""The size of the stack of boxes in a search; each box is halved, so that no tree is deeper."""

_FLOATS = "CPointer(f8)"


@kernel(f"f8({_FLOATS}, i8, f8, f8, f8)", forceinline=True)
def distance2_to_box(m: Floats, at: int, x: float, y: float, z: float) -> Any:
    """Return the squared distance of a point from a box."""
    dx = max(m[at] - x, 0.0, x - m[at + 3])
    dy = max(m[at + 1] - y, 0.0, y - m[at + 4])
    dz = max(m[at + 2] - z, 0.0, z - m[at + 5])
    return dx * dx + dy * dy + dz * dz


@kernel(f"UniTuple(f8, 2)({_FLOATS}, i8, f8, f8, f8)")
def nearest_on_triangle(m: Floats, at: int, x: float, y: float, z: float) -> tuple[float, float]:
    """Return s and r of the nearest point a + s (b − a) + r (c − a) of a triangle with corners a, b, c.

    Tries the corners, then the edges, then the inside (Ericson, *Real-Time Collision Detection*, 2005,
    §5.1.5).
    """
    abx, aby, abz = m[at + 3] - m[at], m[at + 4] - m[at + 1], m[at + 5] - m[at + 2]
    acx, acy, acz = m[at + 6] - m[at], m[at + 7] - m[at + 1], m[at + 8] - m[at + 2]
    apx, apy, apz = x - m[at], y - m[at + 1], z - m[at + 2]
    bpx, bpy, bpz = apx - abx, apy - aby, apz - abz
    cpx, cpy, cpz = apx - acx, apy - acy, apz - acz
    ab_a, ac_a = abx * apx + aby * apy + abz * apz, acx * apx + acy * apy + acz * apz
    if ab_a <= 0.0 and ac_a <= 0.0:
        return 0.0, 0.0
    ab_b, ac_b = abx * bpx + aby * bpy + abz * bpz, acx * bpx + acy * bpy + acz * bpz
    if ab_b >= 0.0 and ac_b <= ab_b:
        return 1.0, 0.0
    over_c = ab_a * ac_b - ab_b * ac_a
    if over_c <= 0.0 and ab_a >= 0.0 and ab_b <= 0.0 and ab_a > ab_b:
        return ab_a / (ab_a - ab_b), 0.0
    ab_c, ac_c = abx * cpx + aby * cpy + abz * cpz, acx * cpx + acy * cpy + acz * cpz
    if ac_c >= 0.0 and ab_c <= ac_c:
        return 0.0, 1.0
    over_b = ab_c * ac_a - ab_a * ac_c
    if over_b <= 0.0 and ac_a >= 0.0 and ac_c <= 0.0:
        return 0.0, ac_a / (ac_a - ac_c)
    over_a = ab_b * ac_c - ab_c * ac_b
    if over_a <= 0.0 and ac_b - ab_b >= 0.0 and ab_c - ac_c >= 0.0:
        share = (ac_b - ab_b) / ((ac_b - ab_b) + (ab_c - ac_c))
        return 1.0 - share, share
    whole = over_a + over_b + over_c
    if not whole > 0.0:  # its corners lie on a line, by rounding
        return 0.0, 0.0
    return over_b / whole, over_c / whole


@kernel(f"b1({_FLOATS}, i8, f8, f8, f8, f8)", forceinline=True)
def is_facing(m: Floats, at: int, nx: float, ny: float, nz: float, least: float) -> Any:
    """Tell whether the normal of a triangle and n, a unit vector, make an angle of at least that cosine."""
    abx, aby, abz = m[at + 3] - m[at], m[at + 4] - m[at + 1], m[at + 5] - m[at + 2]
    acx, acy, acz = m[at + 6] - m[at], m[at + 7] - m[at + 1], m[at + 8] - m[at + 2]
    cx, cy, cz = aby * acz - abz * acy, abz * acx - abx * acz, abx * acy - aby * acx
    return cx * nx + cy * ny + cz * nz >= least * math.sqrt(cx * cx + cy * cy + cz * cz)


@kernel(f"Tuple((f8, i8, f8, f8))({_FLOATS}, i8, f8, f8, f8, f8, i8[::1])")
def nearest(
    m: Floats, triangles: int, x: float, y: float, z: float, limit2: float, stack: AnyArray
) -> tuple[float, int, float, float]:
    """Return the squared distance, the start of the nearest triangle, and s and r of its nearest point.

    The limit and -1 where no triangle is nearer. Of equally near triangles the first visited counts.
    """
    return nearest_facing(m, triangles, x, y, z, limit2, stack, 0.0, 0.0, 0.0, 0.0)


@kernel(f"Tuple((f8, i8, f8, f8))({_FLOATS}, i8, f8, f8, f8, f8, i8[::1], f8, f8, f8, f8)")
def nearest_facing(
    m: Floats,
    triangles: int,
    x: float,
    y: float,
    z: float,
    limit2: float,
    stack: AnyArray,
    nx: float,
    ny: float,
    nz: float,
    least: float,
) -> tuple[float, int, float, float]:
    """Return what `nearest` does, of triangles that are facing n (`is_facing`)."""
    best, found, best_s, best_r = limit2, -1, 0.0, 0.0
    stack[0], depth = 0, 1
    while depth:
        depth -= 1
        at = 8 * stack[depth]
        if not distance2_to_box(m, at, x, y, z) < best:
            continue
        if m[at + 7] > 0.0:
            first = triangles + 9 * int(m[at + 6])
            for t in range(first, first + 9 * int(m[at + 7]), 9):
                s, r = nearest_on_triangle(m, t, x, y, z)
                dx = m[t] + s * (m[t + 3] - m[t]) + r * (m[t + 6] - m[t]) - x
                dy = m[t + 1] + s * (m[t + 4] - m[t + 1]) + r * (m[t + 7] - m[t + 1]) - y
                dz = m[t + 2] + s * (m[t + 5] - m[t + 2]) + r * (m[t + 8] - m[t + 2]) - z
                d2 = dx * dx + dy * dy + dz * dz
                if d2 < best and is_facing(m, t, nx, ny, nz, least):
                    best, found, best_s, best_r = d2, t, s, r
            continue
        one, two = at // 8 + 1, int(m[at + 6])
        if distance2_to_box(m, 8 * one, x, y, z) > distance2_to_box(m, 8 * two, x, y, z):
            one, two = two, one
        stack[depth], stack[depth + 1] = two, one  # the nearer one is visited first
        depth += 2
    return best, found, best_s, best_r


@kernel("void(i8, i8, f8[:, ::1], i8[::1], f8[:, ::1])")
def find_nearest(address: int, triangles: int, points: Points, found: AnyArray, shares: Floats) -> None:
    """Find the nearest triangle of a `TriangleTree` to each of points (N, 3), which are finite.

    address  of the tree's memory; `triangles` is the start of the triangles in it
    found    (N,) receives triangles in the order of the tree
    shares   (N, 2) receives s and r as `nearest_on_triangle` returns them
    """
    m, stack = doubles_at(address), np.empty(DEEPEST, np.int64)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        _, at, shares[i, 0], shares[i, 1] = nearest(m, triangles, x, y, z, np.inf, stack)
        found[i] = (at - triangles) // 9


@kernel("void(i8, i8, f8[:, ::1], f8[:, ::1], f8, i8[::1], f8[:, ::1])")
def find_facing(
    address: int,
    triangles: int,
    points: Points,
    normals: Points,
    least: float,
    found: AnyArray,
    shares: Floats,
) -> None:
    """Find the nearest triangle that is facing the normal (N, 3) of each point, as `find_nearest` does.

    found  receives -1 where no triangle is
    """
    m, stack = doubles_at(address), np.empty(DEEPEST, np.int64)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        _, at, shares[i, 0], shares[i, 1] = nearest_facing(
            m, triangles, x, y, z, np.inf, stack, nx, ny, nz, least
        )
        found[i] = (at - triangles) // 9 if at >= 0 else -1


@block_kernel
def attraction(
    numbers: Floats, count: int, x: Floats, y: Floats, z: Floats, t: float, u: Floats, v: Floats, w: Floats
) -> None:
    """Numbers: address of the array 0, start of its triangles 1, rate 2, radius² 3."""
    m, triangles, limit2 = doubles_at(int(numbers[0])), int(numbers[1]), numbers[3]
    stack = np.empty(DEEPEST, np.int64)
    for i in range(count):
        d2, a, s, r = nearest(m, triangles, x[i], y[i], z[i], limit2, stack)
        if a >= 0:
            inside = 1.0 - d2 / limit2
            rate = numbers[2] * inside * inside
            u[i] += rate * (m[a] + s * (m[a + 3] - m[a]) + r * (m[a + 6] - m[a]) - x[i])
            v[i] += rate * (m[a + 1] + s * (m[a + 4] - m[a + 1]) + r * (m[a + 7] - m[a + 1]) - y[i])
            w[i] += rate * (m[a + 2] + s * (m[a + 5] - m[a + 2]) + r * (m[a + 8] - m[a + 2]) - z[i])


@block_kernel
def wind(
    numbers: Floats, count: int, x: Floats, y: Floats, z: Floats, t: float, u: Floats, v: Floats, w: Floats
) -> None:
    """Numbers: address of the array 0, start of its triangles 1, speed 2, radius² 3, start of the tangents 4.

    There are six numbers of tangents a segment, for its two ends.
    """
    m, triangles, limit2 = doubles_at(int(numbers[0])), int(numbers[1]), numbers[3]
    tangents, stack = int(numbers[4]), np.empty(DEEPEST, np.int64)
    for i in range(count):
        d2, a, s, _ = nearest(m, triangles, x[i], y[i], z[i], limit2, stack)
        if a >= 0:
            d = tangents + (a - triangles) // 9 * 6
            tx = m[d] + s * (m[d + 3] - m[d])
            ty = m[d + 1] + s * (m[d + 4] - m[d + 1])
            tz = m[d + 2] + s * (m[d + 5] - m[d + 2])
            inside = 1.0 - d2 / limit2
            speed = numbers[2] * inside * inside / max(math.sqrt(tx * tx + ty * ty + tz * tz), 1e-12)
            u[i] += speed * tx
            v[i] += speed * ty
            w[i] += speed * tz


CLAMP, ZERO, REPEAT = 0, 1, 2


@kernel(f"Tuple((i8, f8, b1))({_FLOATS}, i8, i8, f8, i8)", forceinline=True)
def cell(m: Floats, axis: int, n: int, x: float, outside: int) -> tuple[int, float, bool]:
    """Return the sample before a coordinate, the coordinate moved inside, and whether it was inside.

    The axis has n ascending numbers from m[axis] on. NaN counts as outside.
    """
    first, last = m[axis], m[axis + n - 1]
    if outside == REPEAT:
        x -= math.floor((x - first) / (last - first)) * (last - first)
    within = first <= x <= last
    if not within:
        x = last if x > last else first
    i = min(int((x - first) / (last - first) * (n - 1)), n - 2)
    while i > 0 and x < m[axis + i]:
        i -= 1
    while i < n - 2 and x >= m[axis + i + 1]:
        i += 1
    return i, x, within


@kernel(f"void({_FLOATS}, i8, i8, i8, f8, i8, f8[:, ::1], i8[:, ::1], i8)")
def taps(
    m: Floats, axis: int, n: int, i: int, x: float, outside: int, weights: Floats, indices: AnyArray, row: int
) -> None:
    """Compute weights and indices of four samples around a coordinate: a Catmull-Rom spline on any axis.

    The slope at a sample is that between its neighbours. Beyond the first and last sample the curve goes on
    straight, or, where the field repeats, with the samples of the other end.
    """
    x1, x2, period = m[axis + i], m[axis + i + 1], m[axis + n - 1] - m[axis]
    h, begins, ends = x2 - x1, i == 0, i == n - 2
    repeats = outside == REPEAT
    x0 = m[axis + i - 1] if not begins else (m[axis + n - 2] - period if repeats else x1 - h)
    x3 = m[axis + i + 2] if not ends else (m[axis + 1] + period if repeats else x2 + h)
    s = (x - x1) / h
    left, right = s * (1.0 - s) * (1.0 - s) * h / (x2 - x0), s * s * (s - 1.0) * h / (x3 - x1)
    before, after = -left, right
    first = (1.0 + 2.0 * s) * (1.0 - s) * (1.0 - s) - right
    second = s * s * (3.0 - 2.0 * s) + left
    if begins and not repeats:
        first, second, before = first + 2.0 * before, second - before, 0.0
    if ends and not repeats:
        first, second, after = first - after, second + 2.0 * after, 0.0
    weights[row, 0], weights[row, 1], weights[row, 2], weights[row, 3] = before, first, second, after
    indices[row, 0] = i - 1 if not begins else (n - 2 if repeats else 0)
    indices[row, 1], indices[row, 2] = i, i + 1
    indices[row, 3] = i + 2 if not ends else (1 if repeats else n - 1)


_SINGLES = types.CPointer(types.float32)


@intrinsic  # type: ignore[untyped-decorator]  # numba has no types
def singles_at(typingctx: Any, address: Any) -> Any:
    """Return a pointer to the numbers of single precision at an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(_SINGLES))

    return _SINGLES(types.int64), generate


@kernel(f"void({_FLOATS}, i8, f8, f8[:, ::1], i8[:, ::1], f8[::1])")
def add_taps(m: Floats, address: int, share: float, weights: Floats, indices: AnyArray, out: Floats) -> None:
    """Add share × the weighted sum of the samples at an address that are around a point."""
    samples, singles, is_single = doubles_at(address), singles_at(address), m[5] > 0.0
    ny, nz, size = int(m[1]), int(m[2]), 4 if m[3] > 0.0 else 2
    for i in range(size):
        for j in range(size):
            across = share * weights[0, i] * weights[1, j]
            row = (indices[0, i] * ny + indices[1, j]) * nz
            for k in range(size):
                weight, at = across * weights[2, k], 3 * (row + indices[2, k])
                for c in range(3):
                    out[c] += weight * (singles[at + c] if is_single else samples[at + c])


@kernel(f"b1({_FLOATS}, f8, f8, f8, f8[:, ::1], i8[:, ::1])")
def find_taps(m: Floats, x: float, y: float, z: float, weights: Floats, indices: AnyArray) -> bool:
    """Compute weights and indices of the samples around a point along each axis; tell whether it has any."""
    axis, outside, inside = 7, int(m[4]), True
    for row in range(3):
        n, coordinate = int(m[row]), x if row == 0 else (y if row == 1 else z)
        i, at, within = cell(m, axis, n, coordinate, outside)
        inside = inside and within
        if m[3] > 0.0:
            taps(m, axis, n, i, at, outside, weights, indices, row)
        else:
            s = (at - m[axis + i]) / (m[axis + i + 1] - m[axis + i])
            weights[row, 0], weights[row, 1] = 1.0 - s, s
            indices[row, 0], indices[row, 1] = i, i + 1
        axis += n
    return inside or outside != ZERO


@kernel(f"UniTuple(f8, 3)({_FLOATS}, f8, f8, f8)")
def on_sphere(m: Floats, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return longitude, latitude (radians) and distance of a point: y points north, z to longitude 0.

    The longitude is within half a turn of the middle of its axis.
    """
    r = math.sqrt(x * x + y * y + z * z)
    middle = 0.5 * (m[7] + m[6 + int(m[0])])
    turn = math.atan2(x, z) - middle
    turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
    return middle + turn, math.asin(y / r) if r > 0.0 else 0.0, r


@block_kernel
def sampled(
    numbers: Floats, count: int, x: Floats, y: Floats, z: Floats, t: float, u: Floats, v: Floats, w: Floats
) -> None:
    """Numbers: address of the constants 0, of the samples before 1 and after 2, share of the latter 3,
    centre 4:7, scale 7, factor on velocities 8.
    """
    m, before, after = doubles_at(int(numbers[0])), int(numbers[1]), int(numbers[2])
    share, cx, cy, cz = numbers[3], numbers[4], numbers[5], numbers[6]
    shrink, factor = 1.0 / numbers[7], numbers[8]
    is_round, is_along, is_turned = 0.0 < m[6] < 3.0, m[6] == 2.0, m[6] == 3.0
    d = 7 + int(m[0]) + int(m[1]) + int(m[2])
    weights, indices, velocity = np.zeros((3, 4)), np.zeros((3, 4), np.int64), np.zeros(3)
    for i in range(count):
        px, py, pz = (x[i] - cx) * shrink, (y[i] - cy) * shrink, (z[i] - cz) * shrink
        qx, qy, qz = on_sphere(m, px, py, pz) if is_round else (px, py, pz)
        if is_turned:
            qx = m[d] * px + m[d + 3] * py + m[d + 6] * pz
            qy = m[d + 1] * px + m[d + 4] * py + m[d + 7] * pz
            qz = m[d + 2] * px + m[d + 5] * py + m[d + 8] * pz
        if find_taps(m, qx, qy, qz, weights, indices):
            velocity[:] = 0.0
            add_taps(m, before, 1.0 - share, weights, indices, velocity)
            if share > 0.0:
                add_taps(m, after, share, weights, indices, velocity)
            if is_along and qz > 0.0:
                upwards = (velocity[0] * px + velocity[1] * py + velocity[2] * pz) / (qz * qz)
                velocity[0] -= upwards * px
                velocity[1] -= upwards * py
                velocity[2] -= upwards * pz
            u[i] += factor * velocity[0]
            v[i] += factor * velocity[1]
            w[i] += factor * velocity[2]
