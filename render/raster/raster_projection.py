"""Kernels: project vertices to the screen, and sort faces by their side. Decorators of all kernels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.kernel_cache import compiled

Array = NDArray[Any]

FAST_MATH = {"contract", "reassoc", "arcp", "nsz"}
"""Fast-math flags. A preview need not have the same bits on every processor."""

exact, fast = compiled(), compiled(fastmath=FAST_MATH)
"""`exact` keeps the order of operations, `fast` lets the compiler change it."""

LARGE_SIZE = 8
"""Subsamples across from which a triangle is large: shadows are computed per pixel, not at its corners."""

EDGE = 1e-9
"""Amount by which triangles are enlarged, so that rounding leaves no gap between neighbours."""

SMALL, LARGE = 1, 2
"""Bits of a vertex: a corner of small triangles, and of large ones."""

CLOCKWISE = 2
"""Shift of these bits for triangles that run clockwise on the screen."""


@exact
def project(
    vertices: Array, origin: Array, axes: Array, near: float, rows: int, columns: int, screen: Array
) -> None:
    """Project vertices (V, 3) into a picture of so many rows and columns.

    axes    (3, 3): right and up, over half of the view at depth 1, and forward
    screen  (V, 3), output: column and row, whole numbers at the middle of subsamples, and one over the
            depth, 0 nearer than `near`
    """
    for v in range(vertices.shape[0]):
        x, y, z = corner(vertices, v, origin, axes)
        inverse = 1.0 / z if z > near else 0.0
        screen[v, 0] = (0.5 + 0.5 * x * inverse) * columns - 0.5
        screen[v, 1] = (0.5 - 0.5 * y * inverse) * rows - 0.5
        screen[v, 2] = inverse


@exact
def corner(vertices: Array, v: int, origin: Array, axes: Array) -> tuple[float, float, float]:
    """Return x and y of a vertex, from -1 to 1 across the picture (y up) times its depth, and the depth."""
    x, y, z = vertices[v, 0] - origin[0], vertices[v, 1] - origin[1], vertices[v, 2] - origin[2]
    return (
        axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z,
        axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z,
        axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z,
    )


@exact
def sort_faces(
    screen: Array, faces: Array, rows: int, columns: int, order: Array, corners: Array
) -> tuple[int, int, float, bool]:
    """Sort the faces (F, 3) that may be visible by the side they show.

    order    (F,), output: from its beginning faces that run counter-clockwise or cross the camera plane, from
             its end backwards those that run clockwise
    corners  (V,) uint8, 0 at first; output: bits SMALL and LARGE of vertices

    Returns both counts; a volume, above 0 if the faces of a closed surface face outwards; and True if no face
    crosses the camera plane. If one does, the volume means nothing.
    """
    front, back, volume, is_whole = 0, faces.shape[0], 0.0, True
    for f in range(faces.shape[0]):
        a, b, c = np.uint32(faces[f, 0]), np.uint32(faces[f, 1]), np.uint32(faces[f, 2])
        if not (screen[a, 2] > 0.0 and screen[b, 2] > 0.0 and screen[c, 2] > 0.0):
            is_whole = False
            if screen[a, 2] > 0.0 or screen[b, 2] > 0.0 or screen[c, 2] > 0.0:
                order[front] = f
                front += 1
                corners[a] |= LARGE
                corners[b] |= LARGE
                corners[c] |= LARGE
            continue
        ax, ay, bx, by = screen[a, 0], screen[a, 1], screen[b, 0], screen[b, 1]
        cx, cy = screen[c, 0], screen[c, 1]
        # above 0 if counter-clockwise, since rows go down
        area = (by - ay) * (cx - ax) - (bx - ax) * (cy - ay)
        volume += area * (screen[a, 2] + screen[b, 2] + screen[c, 2])
        left, right, top, bottom = box(ax, ay, bx, by, cx, cy, rows, columns)
        if left > right or top > bottom or area == 0.0:
            continue
        bits = LARGE if max(right - left, bottom - top) >= LARGE_SIZE else SMALL
        if area > 0.0:
            order[front] = f
            front += 1
        else:
            bits <<= CLOCKWISE
            back -= 1
            order[back] = f
        corners[a] |= bits
        corners[b] |= bits
        corners[c] |= bits
    return front, faces.shape[0] - back, volume, is_whole


@exact
def box(
    ax: float, ay: float, bx: float, by: float, cx: float, cy: float, rows: int, columns: int
) -> tuple[int, int, int, int]:
    """Return the first and last column and the first and last row whose middles a triangle may cover."""
    left, right = _ends(ax, bx, cx, columns)
    top, bottom = _ends(ay, by, cy, rows)
    return left, right, top, bottom


@exact
def _ends(a: float, b: float, c: float, count: int) -> tuple[int, int]:
    """Return the range of three numbers, clipped to 0 … count - 1. `min` and `max` would also check for
    NaN.
    """
    low, high = (a, b) if a < b else (b, a)
    low, high = c if c < low else low, c if c > high else high
    begin, end = int(np.ceil(low)), int(np.floor(high))
    return begin if begin > 0 else 0, end if end < count else count - 1
