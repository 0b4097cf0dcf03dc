"""The compiled functions of `Heights`: see the class there for what they compute."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from flowsculpt.api.flows import kernel
from flowsculpt.api.meshes import Floats, Indices

HIGHEST, FALL, COLUMNS, ROWS, FIRST, CELL, NODES = 0, 1, 2, 3, 4, 6, 7
"""Places in the numbers of heights.

HIGHEST  no height is above it
FALL     how fast heights fall outside of the nodes, per square of the distance, 1/units
COLUMNS, ROWS  numbers of nodes along a and b
FIRST    a and b of the first node
CELL     distance from one node to the next
NODES    their values, row by row: weights of cubic B-splines
Then follows for each node whether those of the cell that begins there are all as high: 1, else 0.
"""


LEAN: dict[str, Any] = {"_nrt": False, "error_model": "numpy", "forceinline": True}
"""Options for small kernels that allocate nothing: counting references would take longer than they do."""

LEAN_CALLS: dict[str, Any] = {**LEAN, "forceinline": False}
"""The same for larger ones."""


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
    """Raise heights to the parabolas by which those of other nodes fall: by fall · (distance in nodes)².

    Rows first, then columns: parabolas of distances along both add up. Each line is the upper hull of its
    parabolas, of which two meet in one place.
    """
    rows, columns = heights.shape
    longest = max(rows, columns)
    line, tops, begins = np.empty(longest), np.empty(longest, np.int64), np.empty(longest + 1)
    for turn in range(2):
        for k in range(rows if turn == 0 else columns):
            count = columns if turn == 0 else rows
            last = -1
            for i in range(count):
                line[i] = heights[k, i] if turn == 0 else heights[i, k]
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
                value = line[j] - fall * (i - j) * (i - j)
                if turn == 0:
                    heights[k, i] = value
                else:
                    heights[i, k] = value


@kernel("void(f8[:, ::1], f8[:, ::1])")
def flag_even(heights: Floats, even: Floats) -> None:
    """Write 1 at nodes with which 4 × 4 of one height begin: there splines are constant."""
    rows, columns = heights.shape
    for row in range(rows - 3):
        for column in range(columns - 3):
            is_even = True
            for k in range(16):
                if heights[row + k // 4, column + k % 4] != heights[row, column]:
                    is_even = False
                    break
            even[row, column] = 1.0 if is_even else 0.0


@kernel("f8(f8[::1], i8, f8, f8)", **LEAN)
def height_at(m: Floats, begin: int, a: float, b: float) -> float:
    """Return the height at a place, of numbers from `begin` on; outside of the nodes a parabola goes on."""
    columns = int(m[begin + COLUMNS])
    x, y = (a - m[begin + FIRST]) / m[begin + CELL], (b - m[begin + FIRST + 1]) / m[begin + CELL]
    inner_x, inner_y = min(max(x, 1.0), columns - 2.0), min(max(y, 1.0), m[begin + ROWS] - 2.0)
    i, j = min(int(inner_x), columns - 3), min(int(inner_y), int(m[begin + ROWS]) - 3)
    o = begin + NODES + (j - 1) * columns + i - 1
    dx, dy = x - inner_x, y - inner_y
    if m[o + columns * int(m[begin + ROWS])] > 0.0 and dx == 0.0 and dy == 0.0:
        return m[o]
    s, t = inner_x - i, inner_y - j
    u, v = 1.0 - s, 1.0 - t
    s0, s1, s2, s3 = u * u * u, 4.0 - 3.0 * s * s * (1.0 + u), 4.0 - 3.0 * u * u * (1.0 + s), s * s * s
    t0, t1, t2, t3 = v * v * v, 4.0 - 3.0 * t * t * (1.0 + v), 4.0 - 3.0 * v * v * (1.0 + t), t * t * t
    p, q, r = o + columns, o + 2 * columns, o + 3 * columns
    # column by column: four sums side by side compile to vector instructions
    c0 = t0 * m[o] + t1 * m[p] + t2 * m[q] + t3 * m[r]
    c1 = t0 * m[o + 1] + t1 * m[p + 1] + t2 * m[q + 1] + t3 * m[r + 1]
    c2 = t0 * m[o + 2] + t1 * m[p + 2] + t2 * m[q + 2] + t3 * m[r + 2]
    c3 = t0 * m[o + 3] + t1 * m[p + 3] + t2 * m[q + 3] + t3 * m[r + 3]
    height = (s0 * c0 + s1 * c1 + s2 * c2 + s3 * c3) / 36.0
    if dx == 0.0 and dy == 0.0:
        return height
    height -= m[begin + FALL] * m[begin + CELL] * m[begin + CELL] * (dx * dx + dy * dy)
    if dx != 0.0:  # slope along a
        slope = -u * u * c0 + s * (3.0 * s - 4.0) * c1 + (1.0 + s * (2.0 - 3.0 * s)) * c2 + s * s * c3
        height += dx * slope / 12.0
    if dy != 0.0:
        t0, t1, t2, t3 = -v * v, t * (3.0 * t - 4.0), 1.0 + t * (2.0 - 3.0 * t), t * t
        row0 = s0 * m[o] + s1 * m[o + 1] + s2 * m[o + 2] + s3 * m[o + 3]
        row1 = s0 * m[p] + s1 * m[p + 1] + s2 * m[p + 2] + s3 * m[p + 3]
        row2 = s0 * m[q] + s1 * m[q + 1] + s2 * m[q + 2] + s3 * m[q + 3]
        row3 = s0 * m[r] + s1 * m[r + 1] + s2 * m[r + 2] + s3 * m[r + 3]
        height += dy * (t0 * row0 + t1 * row1 + t2 * row2 + t3 * row3) / 12.0
    return height


@kernel("void(f8[::1], f8[:, ::1], f8[::1])")
def heights_at(m: Floats, points: Floats, heights: Floats) -> None:
    """Write the heights (N,) under points (N, 3): a, up and b."""
    for i in range(len(points)):
        heights[i] = height_at(m, 0, points[i, 0], points[i, 2])
