"""Where vertices fall in a picture, and which faces are seen there from which side, compiled."""

from __future__ import annotations

import numpy as np

from render.raster.compiled import Array, exact

WIDE = 8
"""Places of a picture across from which on a triangle is filled row by row, and shadows fall on it pixel by
pixel. What is smaller has them at its corners."""

EDGE = 1e-9
"""Of a triangle, by which it is larger, so that rounding leaves no gap between neighbours."""

SMALL, LARGE = 1, 2
"""How a vertex is marked: as a corner of small triangles, and of large ones."""

CLOCKWISE = 2
"""By how many bits marks of corners of triangles that run clockwise are shifted."""


@exact
def project(
    vertices: Array, origin: Array, axes: Array, near: float, rows: int, columns: int, screen: Array
) -> None:
    """Where vertices (V, 3) fall in a picture of so many rows and columns.

    axes    (3, 3): right and up, over half of what the lens sees there at a depth of 1; and forward
    screen  (V, 3): column and row, whole numbers in the middle of places; one over the depth, 0 before `near`
    """
    for v in range(vertices.shape[0]):
        x, y, z = corner(vertices, v, origin, axes)
        inverse = 1.0 / z if z > near else 0.0
        screen[v, 0] = (0.5 + 0.5 * x * inverse) * columns - 0.5
        screen[v, 1] = (0.5 - 0.5 * y * inverse) * rows - 0.5
        screen[v, 2] = inverse


@exact
def corner(vertices: Array, v: int, origin: Array, axes: Array) -> tuple[float, float, float]:
    """x and y of a vertex from -1 to 1 across the picture (y up), times its depth; and the depth."""
    x, y, z = vertices[v, 0] - origin[0], vertices[v, 1] - origin[1], vertices[v, 2] - origin[2]
    return (
        axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z,
        axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z,
        axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z,
    )


@exact
def sort_faces(
    screen: Array, faces: Array, rows: int, columns: int, order: Array, marks: Array
) -> tuple[int, int, float, bool]:
    """Faces (F, 3) that can be seen, by the side that they turn to the lens.

    order  (F,) becomes: from its begin those that run counter-clockwise, or go on behind the lens; from its
           end backwards those that run clockwise
    marks  (V,) uint8, 0 before: what vertices are corners of

    Answers how many there are of both; a volume, which is above 0 where the faces of a closed surface look
    outwards; and whether none goes on behind the lens, without which the volume says nothing.
    """
    front, back, volume, whole = 0, faces.shape[0], 0.0, True
    for f in range(faces.shape[0]):
        a, b, c = np.uint32(faces[f, 0]), np.uint32(faces[f, 1]), np.uint32(faces[f, 2])
        if not (screen[a, 2] > 0.0 and screen[b, 2] > 0.0 and screen[c, 2] > 0.0):
            whole = False
            if screen[a, 2] > 0.0 or screen[b, 2] > 0.0 or screen[c, 2] > 0.0:
                order[front] = f
                front += 1
                marks[a] |= LARGE
                marks[b] |= LARGE
                marks[c] |= LARGE
            continue
        ax, ay, bx, by = screen[a, 0], screen[a, 1], screen[b, 0], screen[b, 1]
        cx, cy = screen[c, 0], screen[c, 1]
        area = (by - ay) * (cx - ax) - (bx - ax) * (cy - ay)  # above 0: counter-clockwise, for rows go down
        volume += area * (screen[a, 2] + screen[b, 2] + screen[c, 2])
        left, right, top, bottom = box(ax, ay, bx, by, cx, cy, rows, columns)
        if left > right or top > bottom or area == 0.0:
            continue
        mark = LARGE if max(right - left, bottom - top) >= WIDE else SMALL
        if area > 0.0:
            order[front] = f
            front += 1
        else:
            mark <<= CLOCKWISE
            back -= 1
            order[back] = f
        marks[a] |= mark
        marks[b] |= mark
        marks[c] |= mark
    return front, faces.shape[0] - back, volume, whole


@exact
def box(
    ax: float, ay: float, bx: float, by: float, cx: float, cy: float, rows: int, columns: int
) -> tuple[int, int, int, int]:
    """The first and the last column and row whose middles a triangle may cover."""
    left, right = _ends(ax, bx, cx, columns)
    top, bottom = _ends(ay, by, cy, rows)
    return left, right, top, bottom


@exact
def _ends(a: float, b: float, c: float, many: int) -> tuple[int, int]:
    """Without `min` and `max`, which ask of each whether it is a number."""
    low, high = (a, b) if a < b else (b, a)
    low, high = c if c < low else low, c if c > high else high
    begin, end = int(np.ceil(low)), int(np.floor(high))
    return begin if begin > 0 else 0, end if end < many else many - 1
