"""The compiled functions of `Heights`: see the class there for what they compute."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from flowsculpt.api.flows import kernel
from flowsculpt.api.meshes import Floats, Indices

HIGHEST, FALL, COLUMNS, ROWS, FIRST, CELL, FLAT, NODES = 0, 1, 2, 3, 4, 6, 7, 11
"""Places in the numbers of heights.

HIGHEST  no height is above it
FALL     how fast heights fall outside of the nodes, per square of the distance, 1/units
COLUMNS, ROWS  numbers of nodes along a and b
FIRST    a and b of the first node
CELL     distance from one node to the next
FLAT     least a and b, and largest a and b, of places that are all as high as the highest
NODES    their values, row by row: weights of cubic B-splines
"""


LEAN: dict[str, Any] = {"_nrt": False, "error_model": "numpy", "forceinline": True}
"""Options for small kernels that allocate nothing: counting references would take longer than they do."""


@kernel("void(f8[:, ::1], i4[:, ::1], f8, f8, f8, f8[:, ::1])")
def raise_to_faces(
    points: Floats, faces: Indices, first_a: float, first_b: float, cell: float, heights: Floats
) -> None:
    """Raise heights (rows, columns) of nodes to the faces (F, 3) of points (V, 3) above them: a, up and b."""
    rows, columns = heights.shape
    for f in range(len(faces)):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay = (points[i, 0] - first_a) / cell, (points[i, 2] - first_b) / cell
        bx, by = (points[j, 0] - first_a) / cell - ax, (points[j, 2] - first_b) / cell - ay
        cx, cy = (points[k, 0] - first_a) / cell - ax, (points[k, 2] - first_b) / cell - ay
        area = bx * cy - by * cx
        if area == 0.0:
            continue
        slack = 1e-9
        low_x, high_x = ax + min(0.0, bx, cx) - slack, ax + max(0.0, bx, cx) + slack
        low_y, high_y = ay + min(0.0, by, cy) - slack, ay + max(0.0, by, cy) + slack
        for row in range(max(0, math.ceil(low_y)), min(rows - 1, math.floor(high_y)) + 1):
            for column in range(max(0, math.ceil(low_x)), min(columns - 1, math.floor(high_x)) + 1):
                x, y = column - ax, row - ay
                s, t = (x * cy - y * cx) / area, (bx * y - by * x) / area
                if s >= -slack and t >= -slack and s + t <= 1.0 + slack:
                    up = (1.0 - s - t) * points[i, 1] + s * points[j, 1] + t * points[k, 1]
                    heights[row, column] = max(heights[row, column], up)


@kernel("void(f8[:, ::1], f8)")
def round_off(heights: Floats, fall: float) -> None:
    """Raise heights of each row to the parabolas by which those of other nodes fall: by fall · distance².

    Each row is the upper hull of its parabolas, of which two meet in one place.
    """
    rows, count = heights.shape
    line, tops, begins = np.empty(count), np.empty(count, np.int64), np.empty(count + 1)
    for row in range(rows):
        last = -1
        for i in range(count):
            line[i] = heights[row, i]
            if line[i] == -math.inf:
                continue
            begin = -math.inf
            while last >= 0:
                j = tops[last]
                begin = 0.5 * (i + j) + (line[j] - line[i]) / (2.0 * fall * (i - j))
                if begin > begins[last]:
                    break
                last -= 1
                begin = -math.inf
            last += 1
            tops[last], begins[last] = i, begin
        if last < 0:
            continue
        begins[last + 1] = math.inf
        at = 0
        for i in range(count):
            while begins[at + 1] < i:
                at += 1
            j = tops[at]
            heights[row, i] = line[j] - fall * (i - j) * (i - j)


@kernel("void(f8[:, ::1], i4[::1])")
def widen_flat(heights: Floats, flat: Indices) -> None:
    """Move the sides of a rectangle of nodes outwards, in turn, as long as all in it are as high.

    flat  least column and row, and largest column and row
    """
    height, side, tried = heights[flat[1], flat[0]], 0, 0
    while tried < 4:
        left, low, right, high = flat
        line = flat[side] + (1 if side > 1 else -1)
        is_even = 0 <= line < heights.shape[1 - side % 2]
        if is_even:
            nodes = heights[low : high + 1, line] if side % 2 == 0 else heights[line, left : right + 1]
            is_even = (nodes == height).all()
        flat[side] = line if is_even else flat[side]
        tried = 0 if is_even else tried + 1
        side = (side + 1) % 4


@kernel("b1(f8[::1], f8, f8)", **LEAN)
def is_flat(m: Floats, a: float, b: float) -> bool:
    """Tell whether a place is among those that are as high as the highest."""
    return (m[FLAT] <= a) & (a <= m[FLAT + 2]) & (m[FLAT + 1] <= b) & (b <= m[FLAT + 3])  # without branches


@kernel("UniTuple(f8, 3)(f8, f8, f8, f8)", **LEAN)
def node_before(a: float, first: float, cell: float, count: float) -> tuple[float, float, float]:
    """Return the node before a place along one side, how far behind that it is, and how far outside."""
    x = (a - first) * (1.0 / cell)
    inner = min(max(1.0, x), count - 2.0)  # in this order NaN becomes 1
    node = math.floor(min(inner, count - 3.0))
    return node, inner - node, x - inner


@kernel("UniTuple(f8, 4)(f8)", **LEAN)
def weights_at(s: float) -> tuple[float, float, float, float]:
    """Return the weights of four nodes, times six."""
    u = 1.0 - s
    return u * u * u, 4.0 - 3.0 * s * s * (1.0 + u), 4.0 - 3.0 * u * u * (1.0 + s), s * s * s


@kernel("UniTuple(f8, 4)(f8)", **LEAN)
def slopes_at(s: float) -> tuple[float, float, float, float]:
    """Return the derivatives of those weights, times a third."""
    u = 1.0 - s
    return -u * u, s * (3.0 * s - 4.0), 1.0 + s * (2.0 - 3.0 * s), s * s


@kernel("f8(f8[::1], f8, f8)", **LEAN)
def rise_outside(m: Floats, a: float, b: float) -> float:
    """Return how much higher a place is than the nearest one within the nodes: a parabola goes on there."""
    column, s, dx = node_before(a, m[FIRST], m[CELL], m[COLUMNS])
    row, t, dy = node_before(b, m[FIRST + 1], m[CELL], m[ROWS])
    if dx == 0.0 and dy == 0.0:
        return 0.0
    columns, weights_a, weights_b = int(m[COLUMNS]), weights_at(s), weights_at(t)
    slopes_a, slopes_b = slopes_at(s), slopes_at(t)
    rise = -m[FALL] * m[CELL] * m[CELL] * (dx * dx + dy * dy)
    for j in range(4):
        for i in range(4):
            height = m[NODES + (int(row) - 1 + j) * columns + int(column) - 1 + i]
            rise += (dx * slopes_a[i] * weights_b[j] + dy * weights_a[i] * slopes_b[j]) * height / 12.0
    return rise


@kernel("void(f8[::1], f8[::1], f8[::1], f8[::1], f8[::1])")
def write_heights(m: Floats, a: Floats, b: Floats, room: Floats, heights: Floats) -> None:
    """Write the heights at N places; `room` is for 7 N numbers. One loop for each step is twice as fast."""
    n, columns, rows, first_a, first_b, cell = len(a), m[COLUMNS], m[ROWS], m[FIRST], m[FIRST + 1], m[CELL]
    nodes, along, across = room[4 * n :], room[5 * n :], room[6 * n :]
    for i in range(n):
        column, along[i], _ = node_before(a[i], first_a, cell, columns)
        row, across[i], _ = node_before(b[i], first_b, cell, rows)
        nodes[i] = NODES + (row - 1.0) * columns + column - 1.0
    for i in range(n):
        o, (t0, t1, t2, t3) = int(nodes[i]), weights_at(across[i])
        p, q, r = o + int(columns), o + 2 * int(columns), o + 3 * int(columns)
        for k in range(4):
            room[4 * i + k] = t0 * m[o + k] + t1 * m[p + k] + t2 * m[q + k] + t3 * m[r + k]
    for i in range(n):
        s0, s1, s2, s3 = weights_at(along[i])
        summed = s0 * room[4 * i] + s1 * room[4 * i + 1] + s2 * room[4 * i + 2] + s3 * room[4 * i + 3]
        heights[i] = summed * (1.0 / 36.0)
    for i in range(n):
        heights[i] = m[HIGHEST] if is_flat(m, a[i], b[i]) else heights[i] + rise_outside(m, a[i], b[i])
