"""Interpolation of velocities sampled on a grid.

Its constants are one flat array: the three counts 0:3, the interpolation 3 (1: cubic), the mode outside 4
(see below), and the three axes from 5 on. Samples are another, three numbers each, the last axis running
fastest.
"""

from __future__ import annotations

import math

import numpy as np

from pipeline.arrays import AnyArray, Floats
from pipeline.flow.kernels.instructions import doubles_at
from pipeline.kernels import block_kernel, kernel

CLAMP, ZERO, REPEAT = 0, 1, 2

_FLOATS = "CPointer(f8)"


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


@kernel(f"void({_FLOATS}, i8, i8, i8, f8, f8[:, ::1], i8[:, ::1], f8[::1])")
def add_taps(
    samples: Floats,
    ny: int,
    nz: int,
    size: int,
    share: float,
    weights: Floats,
    indices: AnyArray,
    out: Floats,
) -> None:
    """Add share × the weighted sum of size³ samples around a point."""
    for i in range(size):
        for j in range(size):
            across = share * weights[0, i] * weights[1, j]
            row = (indices[0, i] * ny + indices[1, j]) * nz
            for k in range(size):
                weight, at = across * weights[2, k], 3 * (row + indices[2, k])
                out[0] += weight * samples[at]
                out[1] += weight * samples[at + 1]
                out[2] += weight * samples[at + 2]


@kernel(f"b1({_FLOATS}, f8, f8, f8, f8[:, ::1], i8[:, ::1])")
def find_taps(m: Floats, x: float, y: float, z: float, weights: Floats, indices: AnyArray) -> bool:
    """Compute weights and indices of the samples around a point along each axis; tell whether it has any."""
    axis, outside, inside = 5, int(m[4]), True
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


@block_kernel
def sampled(
    numbers: Floats,
    count: int,
    xs: Floats,
    ys: Floats,
    zs: Floats,
    t: float,
    us: Floats,
    vs: Floats,
    ws: Floats,
) -> None:
    """Numbers: address of the constants 0, of the samples before 1 and after 2, share of the latter 3,
    centre 4:7, scale 7, factor on velocities 8.
    """
    m, before, after = doubles_at(int(numbers[0])), doubles_at(int(numbers[1])), doubles_at(int(numbers[2]))
    share, cx, cy, cz = numbers[3], numbers[4], numbers[5], numbers[6]
    shrink, factor = 1.0 / numbers[7], numbers[8]
    ny, nz, size = int(m[1]), int(m[2]), 4 if m[3] > 0.0 else 2
    weights, indices, velocity = np.zeros((3, 4)), np.zeros((3, 4), np.int64), np.zeros(3)
    for i in range(count):
        x, y, z = (xs[i] - cx) * shrink, (ys[i] - cy) * shrink, (zs[i] - cz) * shrink
        if find_taps(m, x, y, z, weights, indices):
            velocity[:] = 0.0
            add_taps(before, ny, nz, size, 1.0 - share, weights, indices, velocity)
            if share > 0.0:
                add_taps(after, ny, nz, size, share, weights, indices, velocity)
            us[i] += factor * velocity[0]
            vs[i] += factor * velocity[1]
            ws[i] += factor * velocity[2]
