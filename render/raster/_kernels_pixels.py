"""What pixels show of the triangles that are seen in them, compiled: one pixel after another."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

FINER = 2
"""Triangles are looked for so many times as finely as pixels along both sides, against jagged edges."""

BLOCK = 16
"""Pixels of the shadow's picture that are looked at together."""

_APART = 1.5
_TAPS = 2
"""How many pixels of the shadow's picture are looked at around a place each way, and how far apart."""


_ALIKE = 1.0 / 64.0
"""Of the red that is shown: two places of a pixel that differ less show one surface."""

_SLIGHT = 1.0 / 512.0
"""Of the red that is shown: where the key light adds less, nobody asks for its shadow."""

QUICK = {"contract", "reassoc", "arcp", "nsz"}
"""What may be done with sums and quotients: a picture for a moment need not have the same bits everywhere."""

compiled = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=QUICK)


@compiled  # type: ignore[untyped-decorator]  # numba has no types
def empty(face: Array, colour: Array, picture: Array) -> None:
    """A picture (H, W, 3) of what is behind everything, where no face is seen."""
    share = 1.0 / (FINER * FINER)
    for i in range(picture.shape[0]):
        for j in range(picture.shape[1]):
            vacant = 0
            for s in range(FINER * FINER):
                vacant += face[FINER * i + s // FINER, FINER * j + s % FINER] < 0
            for k in range(3):
                picture[i, j, k] = share * vacant * colour[k]


@compiled  # type: ignore[untyped-decorator]  # numba has no types
def mix(
    corners: Array,
    faces: Array,
    first: int,
    values: Array,
    shadow: tuple[Array, Array],
    face: Array,
    picture: Array,
) -> None:
    """Add a shape to a picture (H, W, 3), each pixel the mean of FINER × FINER places.

    corners  (V, 3), as `project` finds them; `first`, what the first of the faces is called
    values   (V, 9): what a vertex shows in the key light, and out of it; and its place in the shadow's
             picture, as `corners`
    shadow   (S, S), one over the depth that the key light reaches; and (S / BLOCK, S / BLOCK), the largest of
             each block and those around it. Empty without a key light
    face     (FINER H, FINER W): what is seen

    A face that fills several places of a pixel is looked at in one of them, and where two opposite places
    show the same the others do too.
    """
    rows, columns = face.shape
    reached, blocks = shadow
    planes, held = np.zeros((3, 3)), -1
    one = two = three = np.uint32(0)
    for i in range(picture.shape[0]):
        for j in range(picture.shape[1]):
            here = 0
            for s in range(FINER * FINER):
                f = face[FINER * i + s // FINER, FINER * j + s % FINER] - first
                here += 0 <= f < faces.shape[0]
            if here == 0:
                continue
            kept, lit, looked, red, green, blue, r, g, b = -1, -1.0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for t in range(FINER * FINER):
                s = FINER * FINER - 1 - (t - 1) if t else 0  # opposite places first
                row, column = FINER * i + s // FINER, FINER * j + s % FINER
                f = face[row, column] - first
                if not 0 <= f < faces.shape[0]:
                    continue
                before = r
                if f != kept:
                    x, y = 2.0 * (column + 0.5) / columns - 1.0, 1.0 - 2.0 * (row + 0.5) / rows
                    if f != held:
                        one, two, three = (
                            np.uint32(faces[f, 0]),
                            np.uint32(faces[f, 1]),
                            np.uint32(faces[f, 2]),
                        )
                        _across(corners, one, two, three, planes)
                        held = f
                    u, v, w = _shares(planes, x, y)
                    r = u * values[one, 0] + v * values[two, 0] + w * values[three, 0]
                    g = u * values[one, 1] + v * values[two, 1] + w * values[three, 1]
                    b = u * values[one, 2] + v * values[two, 2] + w * values[three, 2]
                    less = u * values[one, 3] + v * values[two, 3] + w * values[three, 3]
                    if r - less > _SLIGHT:
                        if lit < 0.0:
                            lit = _light(
                                u * values[one, 6] + v * values[two, 6] + w * values[three, 6],
                                u * values[one, 7] + v * values[two, 7] + w * values[three, 7],
                                u * values[one, 8] + v * values[two, 8] + w * values[three, 8],
                                reached,
                                blocks,
                            )
                        out = 1.0 - lit
                        r += out * (less - r)
                        g += out * (u * values[one, 4] + v * values[two, 4] + w * values[three, 4] - g)
                        b += out * (u * values[one, 5] + v * values[two, 5] + w * values[three, 5] - b)
                    kept = f
                looked, red, green, blue = looked + 1, red + r, green + g, blue + b
                if looked == 2 and here == FINER * FINER and abs(r - before) < _ALIKE:
                    break
            share = here / (FINER * FINER * looked)
            picture[i, j, 0] += share * red
            picture[i, j, 1] += share * green
            picture[i, j, 2] += share * blue


@compiled  # type: ignore[untyped-decorator]  # numba has no types
def _shares(planes: Array, x: float, y: float) -> tuple[float, float, float]:
    """How much of each corner of a triangle is at a place of the picture; together 1."""
    u = planes[0, 0] * x + planes[0, 1] * y + planes[0, 2]
    v = planes[1, 0] * x + planes[1, 1] * y + planes[1, 2]
    w = planes[2, 0] * x + planes[2, 1] * y + planes[2, 2]
    whole = 1.0 / (u + v + w)
    return u * whole, v * whole, w * whole


@compiled  # type: ignore[untyped-decorator]  # numba has no types
def _across(corners: Array, a: int, b: int, c: int, planes: Array) -> None:
    """How much of each corner of a triangle is at a place of the picture, into rows of planes (3, 3): times
    x, y and 1, and up to a factor that all have.

    By cross products (Olano and Greer 1997), so that corners may lie behind the lens.
    """
    ax, ay, az = corners[a, 0], corners[a, 1], corners[a, 2]
    bx, by, bz = corners[b, 0], corners[b, 1], corners[b, 2]
    cx, cy, cz = corners[c, 0], corners[c, 1], corners[c, 2]
    planes[0, 0], planes[0, 1], planes[0, 2] = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    planes[1, 0], planes[1, 1], planes[1, 2] = cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax
    planes[2, 0], planes[2, 1], planes[2, 2] = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@compiled  # type: ignore[untyped-decorator]  # numba has no types
def _light(x: float, y: float, z: float, near: Array, blocks: Array) -> float:
    """How much of the key light a place sees, from 0 to 1, by those around it in the shadow's picture."""
    side = near.shape[0]
    if side == 0 or z <= 0.0:
        return 1.0
    here = 1.0 / z
    row, column = int((1.0 - y * here) / 2.0 * side), int((x * here + 1.0) / 2.0 * side)
    if not (0 <= row < side and 0 <= column < side) or blocks[row // BLOCK, column // BLOCK] <= here:
        return 1.0
    lit = 0
    for di in range(-_TAPS, _TAPS + 1, _TAPS):
        for dj in range(-_TAPS, _TAPS + 1, _TAPS):
            i, j = int(row + _APART * di), int(column + _APART * dj)
            lit += not (0 <= i < side and 0 <= j < side) or near[i, j] <= here
    if lit in (0, 9):  # so do those between, but for the thinnest of shadows
        return lit / 9.0
    lit = 0
    for di in range(-_TAPS, _TAPS + 1):
        for dj in range(-_TAPS, _TAPS + 1):
            i, j = int(row + _APART * di), int(column + _APART * dj)
            lit += not (0 <= i < side and 0 <= j < side) or near[i, j] <= here
    return lit / (2 * _TAPS + 1) ** 2


@compiled  # type: ignore[untyped-decorator]  # numba has no types
def draw_edges(screen: Array, faces: Array, first: int, face: Array, ink: Array, picture: Array) -> None:
    """The edges of the faces that are seen, over a picture (H, W, 3) of display values.

    screen  (V, 3), as `project` finds them; faces that go on behind the lens have no edges
    ink     (5,): colour, how opaque, and how wide in pixels
    """
    rows, columns = picture.shape[0], picture.shape[1]
    share = ink[3] / (FINER * FINER)
    for i in range(FINER * rows):
        for j in range(FINER * columns):
            f = face[i, j] - first
            if not 0 <= f < faces.shape[0]:
                continue
            x, y = (j + 0.5) / FINER, (i + 0.5) / FINER
            away = np.inf
            for k in range(3):
                a, b = faces[f, k], faces[f, (k + 1) % 3]
                if min(screen[a, 2], screen[b, 2]) <= 0.0:
                    continue
                dx, dy = (screen[b, 0] - screen[a, 0]) * columns, (screen[b, 1] - screen[a, 1]) * rows
                across = abs((x - screen[a, 0] * columns) * dy - (y - screen[a, 1] * rows) * dx)
                away = min(away, across / max(np.sqrt(dx * dx + dy * dy), 1e-12))
            cover = share * min(1.0, max(0.0, ink[4] / 2.0 + 0.5 - away))
            for k in range(3):
                picture[i // FINER, j // FINER, k] += cover * (ink[k] - picture[i // FINER, j // FINER, k])


@compiled  # type: ignore[untyped-decorator]  # numba has no types
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
