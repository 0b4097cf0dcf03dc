"""Which triangle is seen where, compiled: one triangle after another."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_GRAZING = 1e-12

_WIDE = 24
"""Pixels across from which on it pays to find where a row of a triangle begins and ends."""

_ROUNDED = 1e-9
"""Of a pixel, by which rows are longer, so that rounding leaves no gap between neighbours."""


@numba.njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]  # numba has no types
def project(vertices: Array, origin: Array, axes: Array, near: float, corners: Array, screen: Array) -> None:
    """Where vertices (V, 3) fall.

    axes     (3, 3): right and up, over half of what the lens sees there at a depth of 1; and forward
    corners  (V, 3): x and y from -1 to 1 across the picture (y up), times the depth; and the depth
    screen   (V, 3): x and y in the picture, from 0 (left, top) to 1; and one over the depth, 0 before `near`
    """
    for v in range(vertices.shape[0]):
        x, y, z = vertices[v, 0] - origin[0], vertices[v, 1] - origin[1], vertices[v, 2] - origin[2]
        for k in range(3):
            corners[v, k] = axes[k, 0] * x + axes[k, 1] * y + axes[k, 2] * z
        inverse = 1.0 / corners[v, 2] if corners[v, 2] > near else 0.0
        screen[v, 0] = 0.5 + 0.5 * corners[v, 0] * inverse
        screen[v, 1] = 0.5 - 0.5 * corners[v, 1] * inverse
        screen[v, 2] = inverse


@numba.njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]  # numba has no types
def fill(
    corners: Array,
    screen: Array,
    faces: Array,
    first: int,
    closed: bool,
    closest: float,
    near: Array,
    face: Array,
    seen: Array,
) -> None:
    """The nearest triangle at the middle of every pixel.

    first    what the first face is called
    closed   whether only faces that look at the lens can be seen
    closest  the depth from which on the lens sees
    near     (H, W), one over the depth of the nearest so far; `face` (H, W), what it is called
    seen     (V,) bool: becomes true for corners of triangles that were the nearest when their turn came
    """
    rows, columns = near.shape
    for f in range(faces.shape[0]):
        a, b, c = np.uint32(faces[f, 0]), np.uint32(faces[f, 1]), np.uint32(faces[f, 2])
        if not (screen[a, 2] > 0.0 and screen[b, 2] > 0.0 and screen[c, 2] > 0.0):
            if _fill_wide(corners[a], corners[b], corners[c], closest, first + f, near, face):
                seen[a] = seen[b] = seen[c] = True
            continue
        ax, ay = screen[a, 0] * columns - 0.5, screen[a, 1] * rows - 0.5
        bx, by = screen[b, 0] * columns - 0.5, screen[b, 1] * rows - 0.5
        cx, cy = screen[c, 0] * columns - 0.5, screen[c, 1] * rows - 0.5
        area = (by - ay) * (cx - ax) - (bx - ax) * (cy - ay)  # above 0: counter-clockwise, for rows go down
        if area == 0.0 or (closed and area < 0.0):
            continue
        left, right = max(0, int(np.ceil(min(ax, bx, cx)))), min(columns - 1, int(max(ax, bx, cx)))
        top, bottom = max(0, int(np.ceil(min(ay, by, cy)))), min(rows - 1, int(max(ay, by, cy)))
        if left > right or top > bottom:
            continue
        if right - left > _WIDE:
            if _fill_wide(corners[a], corners[b], corners[c], closest, first + f, near, face):
                seen[a] = seen[b] = seen[c] = True
            continue
        # shares of the corners a, b and c at a pixel, which are linear across the picture
        ux, uy = (by - cy) / -area, (cx - bx) / -area
        vx, vy = (cy - ay) / -area, (ax - cx) / -area
        depth_a, depth_b, depth_c = screen[a, 2], screen[b, 2], screen[c, 2]
        nearest = False
        for i in range(top, bottom + 1):
            u = ux * (left - cx) + uy * (i - cy)
            v = vx * (left - cx) + vy * (i - cy)
            for j in range(left, right + 1):
                w = 1.0 - u - v
                if u >= 0.0 and v >= 0.0 and w >= 0.0:
                    here = u * depth_a + v * depth_b + w * depth_c
                    if here > near[i, j]:
                        near[i, j] = here
                        face[i, j] = first + f
                        nearest = True
                u += ux
                v += vx
        if nearest:
            seen[a] = seen[b] = seen[c] = True


@numba.njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]  # numba has no types
def _fill_wide(a: Array, b: Array, c: Array, closest: float, name: int, near: Array, face: Array) -> bool:
    """A triangle that is large in the picture, or goes on behind the lens, which sees from `closest` on.

    Answers whether it is the nearest anywhere.

    In homogeneous coordinates (Olano and Greer 1997) nothing needs to be clipped: shares of the corners, each
    over the depth, are linear across the picture.
    """
    if max(a[2], b[2], c[2]) <= closest:
        return False
    rows, columns = near.shape
    n0, n1, n2 = np.cross(b, c), np.cross(c, a), np.cross(a, b)
    volume = a[0] * n0[0] + a[1] * n0[1] + a[2] * n0[2]
    if abs(volume) < _GRAZING * (abs(a[2]) + abs(b[2]) + abs(c[2])) ** 3:
        return False
    left, right, top, bottom = _bounds(a, b, c, closest, rows, columns)
    if left > right or top > bottom:
        return False
    u = _across(n0 / volume, rows, columns)
    v = _across(n1 / volume, rows, columns)
    w = _across(n2 / volume, rows, columns)
    total, nearest = u + v + w, False
    for i in range(top, bottom + 1):
        begin, end = left, right
        for share in (u, v, w):
            here = share[0] + share[1] * i
            if share[2] > 0.0:
                begin = max(begin, -here / share[2])
            elif share[2] < 0.0:
                end = min(end, -here / share[2])
            elif here < 0.0:
                end = -1.0
        begin, end = min(begin, right + 1.0), max(end, left - 1.0)  # slopes may be next to nothing
        for j in range(int(np.ceil(begin - _ROUNDED)), int(np.floor(end + _ROUNDED)) + 1):
            here = total[0] + total[1] * i + total[2] * j
            if here > near[i, j]:
                near[i, j] = here
                face[i, j] = name
                nearest = True
    return nearest


@numba.njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]  # numba has no types
def _across(n: Array, rows: int, columns: int) -> Array:
    """(3,): n · (x, y, 1) at the first pixel, and how it changes from row to row and column to column."""
    begin = n[0] * (1.0 / columns - 1.0) + n[1] * (1.0 - 1.0 / rows) + n[2]
    return np.array([begin, -2.0 / rows * n[1], 2.0 / columns * n[0]])


@numba.njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]  # numba has no types
def _bounds(
    a: Array, b: Array, c: Array, closest: float, rows: int, columns: int
) -> tuple[float, float, int, int]:
    """The columns and rows that a triangle may be seen in, as far as it is before the lens."""
    left, right, low, high = np.inf, -np.inf, np.inf, -np.inf
    for one, other in ((a, b), (b, a), (b, c), (c, b), (c, a), (a, c)):
        place = one
        if one[2] < closest:
            if other[2] < closest:
                continue
            place = one + (closest - one[2]) / (other[2] - one[2]) * (other - one)
        x, y = place[0] / place[2], place[1] / place[2]
        left, right, low, high = min(left, x), max(right, x), min(low, y), max(high, y)
    return (
        max(0.0, (left + 1.0) / 2.0 * columns - 1.5),
        min(columns - 1.0, (right + 1.0) / 2.0 * columns + 0.5),
        int(max(0.0, (1.0 - high) / 2.0 * rows - 1.5)),
        int(min(rows - 1.0, (1.0 - low) / 2.0 * rows + 0.5)),
    )


@numba.njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]  # numba has no types
def largest(near: Array, block: int, out: Array) -> None:
    """Of each block of `near` (S, S) and those around it, into `out` (S / block, S / block), which is 0."""
    many = out.shape[0]
    for i in range(near.shape[0]):
        row = i // block
        for j in range(near.shape[1]):
            if near[i, j] > 0.0:
                column = j // block
                for k in range(max(0, row - 1), min(many, row + 2)):
                    for m in range(max(0, column - 1), min(many, column + 2)):
                        out[k, m] = max(out[k, m], near[i, j])
