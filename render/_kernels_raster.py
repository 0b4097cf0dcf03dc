"""Filling triangles and drawing lines, compiled: one pixel after another."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_GRAZING = 1e-12


@numba.njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]  # numba has no types
def fill(corners: Array, faces: Array, depth: Array, face: Array, weight: Array) -> None:
    """The nearest triangle at the middle of every pixel.

    corners  (V, 3): x and y from -1 to 1 across the picture (y up), times the depth; and the depth
    depth    (H, W), the nearest so far; `face` (H, W) and `weight` (H, W, 2), that of its first two corners

    In homogeneous coordinates (Olano and Greer 1997): nothing needs to be clipped, not even what is behind
    the camera. Weights are linear on the triangle, not in the picture.
    """
    rows, columns = depth.shape
    for f in range(faces.shape[0]):
        a, b, c = corners[faces[f, 0]], corners[faces[f, 1]], corners[faces[f, 2]]
        if max(a[2], b[2], c[2]) <= 0.0:
            continue
        n0, n1, n2 = np.cross(b, c), np.cross(c, a), np.cross(a, b)
        volume = a[0] * n0[0] + a[1] * n0[1] + a[2] * n0[2]
        if abs(volume) < _GRAZING * (abs(a[2]) + abs(b[2]) + abs(c[2])) ** 3:
            continue
        left, right, low, high = -1.0, 1.0, -1.0, 1.0
        if min(a[2], b[2], c[2]) > 0.0:
            left = max(left, min(a[0] / a[2], b[0] / b[2], c[0] / c[2]))
            right = min(right, max(a[0] / a[2], b[0] / b[2], c[0] / c[2]))
            low = max(low, min(a[1] / a[2], b[1] / b[2], c[1] / c[2]))
            high = min(high, max(a[1] / a[2], b[1] / b[2], c[1] / c[2]))
        first, last = int((left + 1.0) / 2.0 * columns - 0.5), int((right + 1.0) / 2.0 * columns + 0.5)
        top, bottom = int((1.0 - high) / 2.0 * rows - 0.5), int((1.0 - low) / 2.0 * rows + 0.5)
        for i in range(max(0, top), min(rows, bottom + 1)):
            y = 1.0 - 2.0 * (i + 0.5) / rows
            for j in range(max(0, first), min(columns, last + 1)):
                x = 2.0 * (j + 0.5) / columns - 1.0
                u = (n0[0] * x + n0[1] * y + n0[2]) / volume
                v = (n1[0] * x + n1[1] * y + n1[2]) / volume
                w = (n2[0] * x + n2[1] * y + n2[2]) / volume
                total = u + v + w
                if u < 0.0 or v < 0.0 or w < 0.0 or total <= 0.0:
                    continue
                if 1.0 / total < depth[i, j]:
                    depth[i, j] = 1.0 / total
                    face[i, j] = f
                    weight[i, j, 0] = u / total
                    weight[i, j, 1] = v / total


@numba.njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]  # numba has no types
def draw_lines(ends: Array, inks: Array, width: float, hidden: float, depth: Array, picture: Array) -> None:
    """Short pieces of lines over a picture (H, W, 3), in order, with soft edges.

    ends    (N, 2, 3): where each piece begins and ends, pixels from the left and the top, and the depth
    inks    (N, 4): its colour, and how opaque it is
    width   of all, pixels
    hidden  what is left of its opacity where the surface (`depth`, (H, W)) is before it
    """
    rows, columns = depth.shape
    reach = width / 2.0 + 1.0
    for n in range(ends.shape[0]):
        x0, y0, z0 = ends[n, 0]
        x1, y1, z1 = ends[n, 1]
        dx, dy = x1 - x0, y1 - y0
        squared = dx * dx + dy * dy
        if squared < 1e-12 or min(z0, z1) <= 0.0:
            continue
        for i in range(max(0, int(min(y0, y1) - reach)), min(rows, int(max(y0, y1) + reach) + 1)):
            for j in range(max(0, int(min(x0, x1) - reach)), min(columns, int(max(x0, x1) + reach) + 1)):
                px, py = j + 0.5 - x0, i + 0.5 - y0
                along = (px * dx + py * dy) / squared
                if along < 0.0 or along >= 1.0:
                    continue  # the next piece has it
                beside = abs(px * dy - py * dx) / np.sqrt(squared)
                cover = min(1.0, width / 2.0 + 0.5 - beside)
                if cover <= 0.0:
                    continue
                opacity = inks[n, 3] * cover
                if z0 + along * (z1 - z0) > depth[i, j]:
                    opacity *= hidden
                for k in range(3):
                    picture[i, j, k] += opacity * (inks[n, k] - picture[i, j, k])
