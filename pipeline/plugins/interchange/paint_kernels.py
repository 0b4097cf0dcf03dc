"""The nearest point of a chart of a painted model."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import AnyArray, Floats, Points
from pipeline.flow.kernels.external_kernels import DEEPEST, distance2_to_box, nearest_on_triangle
from pipeline.flow.kernels.instructions import doubles_at
from pipeline.kernels import kernel

ANY = -1
"""The number of a chart that lets all triangles count."""


@kernel("void(f8[:, ::1], i8[::1], i8, i8, i8[::1], i8[::1], f8[:, ::1])")
def find_nearest(
    points: Points,
    wanted: AnyArray,
    address: int,
    triangles: int,
    charts: AnyArray,
    found: AnyArray,
    places: Floats,
) -> None:
    """Find the nearest triangle of a chart at each point, and the nearest point in it.

    points     (N, 3)
    wanted     (N,) the charts whose triangles count, or ANY
    address    of the array of a `TriangleTree`
    triangles  start of the triangles in it
    charts     (T,) of the triangles, in the order of the tree
    found      (N,) receives triangles in the order of the tree, -1 where the chart has none
    places     (N, 2) receives s and r as `nearest_on_triangle` returns them
    """
    m, stack = doubles_at(address), np.empty(DEEPEST, np.int64)
    for i in range(len(points)):
        x, y, z, chart = points[i, 0], points[i, 1], points[i, 2], wanted[i]
        best, found[i] = np.inf, -1
        stack[0], depth = 0, 1
        while depth:
            depth -= 1
            at = 8 * stack[depth]
            if not distance2_to_box(m, at, x, y, z) < best:
                continue
            if m[at + 7] > 0.0:
                first = int(m[at + 6])
                for k in range(first, first + int(m[at + 7])):
                    if chart >= 0 and charts[k] != chart:
                        continue
                    t = triangles + 9 * k
                    s, r = nearest_on_triangle(m, t, x, y, z)
                    dx = m[t] + s * (m[t + 3] - m[t]) + r * (m[t + 6] - m[t]) - x
                    dy = m[t + 1] + s * (m[t + 4] - m[t + 1]) + r * (m[t + 7] - m[t + 1]) - y
                    dz = m[t + 2] + s * (m[t + 5] - m[t + 2]) + r * (m[t + 8] - m[t + 2]) - z
                    d2 = dx * dx + dy * dy + dz * dz
                    if d2 < best:
                        best, found[i], places[i, 0], places[i, 1] = d2, k, s, r
                continue
            one, two = at // 8 + 1, int(m[at + 6])
            if distance2_to_box(m, 8 * one, x, y, z) > distance2_to_box(m, 8 * two, x, y, z):
                one, two = two, one
            stack[depth], stack[depth + 1] = two, one  # the nearer one is visited first
            depth += 2
