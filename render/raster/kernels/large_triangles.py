"""Triangles of many pixels, or that go on behind the lens, compiled: shadows fall on them pixel by pixel.

In homogeneous coordinates (Olano and Greer 1997) nothing needs to be clipped: shares of the corners, each
over the depth, are linear across the picture, and so is what corners show.

No function is called for a pixel: each array that it were given would be counted by all threads in turn.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from render.raster.compiled import Array, exact, quick
from render.raster.kernels.projection import corner
from render.raster.kernels.shadow_map import reaches

FINER = 2
"""Places of a picture to each side of a pixel, against jagged edges."""

TOP = 1023.0
"""What white is in a channel of ten bits: colours of places are packed into 32."""

_GRAZING = 1e-12

_ROUNDED = 1e-9
"""Of a pixel, by which rows are longer, so that rounding leaves no gap between neighbours."""


def _middles() -> Array:
    """(16, 2): for each set of places that a triangle may have in a pixel, the row and column of their
    middle, from that of the pixel."""
    bits = np.arange(2 ** (FINER * FINER))[:, None] >> np.arange(FINER * FINER) & 1
    inside = (np.arange(FINER) + 0.5) / FINER - 0.5
    places = np.stack([inside.repeat(FINER), np.tile(inside, FINER)], axis=1)
    return np.asarray(bits @ places / np.maximum(bits.sum(axis=1, keepdims=True), 1), dtype=np.float32)


_MIDDLES = _middles()


class Large(NamedTuple):
    """What large triangles need.

    vertices               (V, 3)
    origin, axes, closest  of the lens, and the depth from which on it sees
    values                 (V, 9): what a vertex shows in the key light, and out of it; and where it is
                           looked up in the shadow's picture
    reach, blocks          that picture, as `reaches` takes it
    hits                   (4, H W / FINER²) int32, room for the pixels that one triangle is seen in
    found                  (12, H W / FINER²) float32, room for what they show
    """

    vertices: Array
    origin: Array
    axes: Array
    closest: float
    values: Array
    reach: Array
    blocks: Array
    hits: Array
    found: Array


@exact
def paint_large(
    a: int, b: int, c: int, called: int, large: Large, near: Array, colour: Array, name: Array
) -> None:
    """Put a triangle into a picture, as `paint` does; a, b and c are its corners."""
    rows, columns = near.shape[0] // FINER, near.shape[1] // FINER
    corners, planes = np.empty((3, 3)), np.empty((3, 12))
    for k, v in enumerate((a, b, c)):
        corners[k, 0], corners[k, 1], corners[k, 2] = corner(large.vertices, v, large.origin, large.axes)
    if max(corners[0, 2], corners[1, 2], corners[2, 2]) <= large.closest:
        return
    if not _planes(corners, large.values, a, b, c, rows, columns, planes):
        return
    left, right, top, bottom = _bounds(corners, large.closest, rows, columns)
    if left > right:
        return
    many = _cover(planes, left, right, top, bottom, near, large.hits)
    _interpolate(planes, large.hits, many, large.found)
    reaches(large.found[6:9, :many], large.reach, large.blocks, large.found[9, :many])
    _show(large.hits, large.found, many, called, colour, name)


@exact
def _cover(planes: Array, left: float, right: float, top: int, bottom: int, near: Array, hits: Array) -> int:
    """Where a triangle is the nearest; answers in how many pixels.

    hits  (4, N) become their rows and columns, and which of their places, a bit for each
    """
    many = 0
    slope, fall = planes[2, :3].sum(), planes[1, :3].sum()
    within = (1.0 - 1.0 / FINER) / 2.0
    reaching, line = within * (np.abs(planes[1, :3]) + np.abs(planes[2, :3])), np.empty(3)
    for i in range(top, bottom + 1):
        begin, end = left, right
        for k in range(3):
            line[k] = planes[0, k] + planes[1, k] * i
            here = line[k] + reaching[k]
            if planes[2, k] > 0.0:
                begin = max(begin, -here / planes[2, k])
            elif planes[2, k] < 0.0:
                end = min(end, -here / planes[2, k])
            elif here < 0.0:
                end = -1.0
        begin, end = min(begin, right + 1.0), max(end, left - 1.0)  # slopes may be next to nothing
        for j in range(int(np.ceil(begin - _ROUNDED)), int(np.floor(end + _ROUNDED)) + 1):
            u, v, w = line[0] + planes[2, 0] * j, line[1] + planes[2, 1] * j, line[2] + planes[2, 2] * j
            inner = u >= reaching[0] and v >= reaching[1] and w >= reaching[2]
            bits = 0
            for s in range(FINER * FINER):
                y, x = (s // FINER + 0.5) / FINER - 0.5, (s % FINER + 0.5) / FINER - 0.5
                here = u + v + w + fall * y + slope * x
                row, column = FINER * i + s // FINER, FINER * j + s % FINER
                if here > near[row, column] and (
                    inner
                    or (
                        u + planes[1, 0] * y + planes[2, 0] * x >= -_ROUNDED * reaching[0]
                        and v + planes[1, 1] * y + planes[2, 1] * x >= -_ROUNDED * reaching[1]
                        and w + planes[1, 2] * y + planes[2, 2] * x >= -_ROUNDED * reaching[2]
                    )
                ):
                    near[row, column] = here
                    bits |= 1 << s
            if bits:
                hits[0, many], hits[1, many], hits[2, many] = i, j, bits
                many += 1
    return many


@quick
def _interpolate(planes: Array, hits: Array, many: int, found: Array) -> None:
    """What corners show, in the middle of the places of pixels that a triangle has: into found (9, N).

    There it is never beside the triangle, where no corner says what is seen. Pixels are the inner loop, in
    single precision, so that several are found at a time.
    """
    x = np.float32(planes[0, 0] + planes[0, 1] + planes[0, 2])
    y = np.float32(planes[1, 0] + planes[1, 1] + planes[1, 2])
    z = np.float32(planes[2, 0] + planes[2, 1] + planes[2, 2])
    depth = found[9]
    rows, columns = found[10], found[11]
    for n in range(many):
        rows[n] = np.float32(hits[0, n]) + _MIDDLES[hits[2, n], 0]
        columns[n] = np.float32(hits[1, n]) + _MIDDLES[hits[2, n], 1]
    for n in range(many):
        depth[n] = np.float32(1.0) / (x + y * rows[n] + z * columns[n])
    for k in range(9):
        x, y, z = np.float32(planes[0, 3 + k]), np.float32(planes[1, 3 + k]), np.float32(planes[2, 3 + k])
        row = found[k]
        for n in range(many):
            row[n] = (x + y * rows[n] + z * columns[n]) * depth[n]


@quick
def _show(hits: Array, found: Array, many: int, called: int, colour: Array, name: Array) -> None:
    """Pixels as much in the key light as found[9] says, at the places that the triangle has there."""
    named, packed = name.shape[0] > 0, hits[3]
    none, white, half = np.float32(0.0), np.float32(TOP), np.float32(0.5)
    packed[:many] = 0
    for k in range(3):
        with_key, without = found[k], found[3 + k]
        for n in range(many):
            shown = white * (without[n] + found[9, n] * (with_key[n] - without[n])) + half
            shown = shown if shown > none else none
            packed[n] = packed[n] << 10 | np.int32(shown if shown < white else white)
    for n in range(many):
        i, j = FINER * hits[0, n], FINER * hits[1, n]
        for s in range(FINER * FINER):
            if hits[2, n] >> s & 1:
                colour[i + s // FINER, j + s % FINER] = packed[n]
                if named:
                    name[i + s // FINER, j + s % FINER] = called


@exact
def _planes(
    corners: Array,
    values: Array,
    a: int,
    b: int,
    c: int,
    rows: int,
    columns: int,
    planes: Array,
) -> bool:
    """What is linear across a picture of so many pixels: shares of the corners, and what they show, over the
    depth. Into planes (3, 12): at the first pixel, from row to row, and from column to column.

    False for a triangle that is seen from its edge.
    """
    p, q, r = corners[0], corners[1], corners[2]
    n = np.stack((np.cross(q, r), np.cross(r, p), np.cross(p, q)))
    volume = p[0] * n[0, 0] + p[1] * n[0, 1] + p[2] * n[0, 2]
    if not abs(volume) >= _GRAZING * (abs(p[2]) + abs(q[2]) + abs(r[2])) ** 3:
        return False
    for k in range(3):
        x, y, z = n[k, 0] / volume, n[k, 1] / volume, n[k, 2] / volume
        planes[0, k] = x * (1.0 / columns - 1.0) + y * (1.0 - 1.0 / rows) + z
        planes[1, k], planes[2, k] = -2.0 / rows * y, 2.0 / columns * x
    for k in range(9):
        for m in range(3):
            planes[m, 3 + k] = (
                values[a, k] * planes[m, 0] + values[b, k] * planes[m, 1] + values[c, k] * planes[m, 2]
            )
    return True


@exact
def _bounds(corners: Array, closest: float, rows: int, columns: int) -> tuple[float, float, int, int]:
    """The columns and rows that a triangle may be seen in, as far as it is before the lens."""
    left, right, low, high = np.inf, -np.inf, np.inf, -np.inf
    for here, there in ((0, 1), (1, 0), (1, 2), (2, 1), (2, 0), (0, 2)):
        x, y, z = corners[here, 0], corners[here, 1], corners[here, 2]
        if z < closest:
            if corners[there, 2] < closest:
                continue
            along = (closest - z) / (corners[there, 2] - z)
            x += along * (corners[there, 0] - x)
            y += along * (corners[there, 1] - y)
            z = closest
        x, y = x / z, y / z
        left, right, low, high = min(left, x), max(right, x), min(low, y), max(high, y)
    return (
        max(0.0, (left + 1.0) / 2.0 * columns - 1.5),
        min(columns - 1.0, (right + 1.0) / 2.0 * columns + 0.5),
        int(max(0.0, (1.0 - high) / 2.0 * rows - 1.5)),
        int(min(rows - 1.0, (1.0 - low) / 2.0 * rows + 0.5)),
    )
