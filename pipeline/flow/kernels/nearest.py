"""The nearest point of a set of triangles, and the flows that attract to it or blow along it.

The set is one flat array: a tree of boxes, eight numbers each, and then its triangles, nine each. A box has
its lower corner 0:3, its upper corner 3:6, and 6 and 7: a leaf its first triangle and their count, any other
its second child and 0; its first child follows it. A triangle with two equal corners is a segment, with three
a point.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pipeline.arrays import AnyArray, Floats
from pipeline.flow.kernels.instructions import doubles_at
from pipeline.kernels import block_kernel, kernel

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
    if over_c <= 0.0 and ab_a >= 0.0 and ab_b <= 0.0:
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
    return over_b / whole, over_c / whole


@kernel(f"Tuple((f8, i8, f8, f8))({_FLOATS}, i8, f8, f8, f8, f8, i8[::1])")
def nearest(
    m: Floats, triangles: int, x: float, y: float, z: float, limit2: float, stack: AnyArray
) -> tuple[float, int, float, float]:
    """Return the squared distance, the start of the nearest triangle, and s and r of its nearest point.

    The limit and -1 where no triangle is nearer. Of equally near triangles the first visited counts.
    """
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
                if d2 < best:
                    best, found, best_s, best_r = d2, t, s, r
            continue
        one, two = at // 8 + 1, int(m[at + 6])
        if distance2_to_box(m, 8 * one, x, y, z) > distance2_to_box(m, 8 * two, x, y, z):
            one, two = two, one
        stack[depth], stack[depth + 1] = two, one  # the nearer one is visited first
        depth += 2
    return best, found, best_s, best_r


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
