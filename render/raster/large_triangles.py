"""Kernels: draw triangles that cover many pixels or cross the camera plane, with shadows per pixel.

In homogeneous coordinates (Olano and Greer 1997) nothing needs to be clipped: barycentric coordinates over
the depth are linear across the picture, and so are values of vertices over the depth.

No function is called per pixel: reference counts of its array arguments would be shared by all threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from render.raster.contact import CELLS, dim_floor
from render.raster.raster_projection import Array, corner, exact, fast
from render.raster.shadow_map import light_visibility

SUPERSAMPLING = 2
"""Subsamples along each side of a pixel, against jagged edges."""

WHITE = 1023.0
"""White in a channel of ten bits: the colour of a subsample is packed into 32 bits."""

_EDGE_ON = 1e-12

_TOLERANCE = 1e-9
"""Part of a pixel by which rows are longer, so that rounding leaves no gap between neighbours."""


def _middles() -> Array:
    """Return the mean row and column (16, 2) of each set of subsamples, from the middle of the pixel."""
    subsamples = SUPERSAMPLING * SUPERSAMPLING
    bits = np.arange(2**subsamples)[:, None] >> np.arange(subsamples) & 1
    inside = (np.arange(SUPERSAMPLING) + 0.5) / SUPERSAMPLING - 0.5
    places = np.stack([inside.repeat(SUPERSAMPLING), np.tile(inside, SUPERSAMPLING)], axis=1)
    return np.asarray(bits @ places / np.maximum(bits.sum(axis=1, keepdims=True), 1), dtype=np.float32)


_MIDDLES = _middles()


class LargeTriangles(NamedTuple):
    """The inputs and buffers of large triangles.

    vertices            (V, 3)
    origin, axes, near  of the camera, as of `project`
    values              (V, 12): display values in the key light (3) and in its shadow (3), coordinates in
                        the shadow map (3), `bulges`, and the place on the grid of the contact shadow (2)
    nearness, blocks    the shadow map, as of `light_visibility`
    contact             the contact shadow, as `dim_floor` takes it
    ambient             the fraction of display values on the floor that all but the key light make
    opacity             the fraction of the key light that the shadow lacks
    hits                (4, H W / SUPERSAMPLING²) int32, buffer for the pixels of one triangle
    at_hits             (15, H W / SUPERSAMPLING²) float32, buffer for their values
    """

    vertices: Array
    origin: Array
    axes: Array
    near: float
    values: Array
    nearness: Array
    blocks: Array
    contact: Array
    ambient: float
    opacity: float
    hits: Array
    at_hits: Array


@exact
def draw_large_triangle(
    a: int,
    b: int,
    c: int,
    face_id: int,
    large: LargeTriangles,
    nearness: Array,
    colour: Array,
    face_ids: Array,
) -> None:
    """Draw a triangle as `draw_triangles` does. a, b, c: indices of its corners"""
    rows, columns = nearness.shape[0] // SUPERSAMPLING, nearness.shape[1] // SUPERSAMPLING
    corners, planes = np.empty((3, 3)), np.empty((3, 15))
    for k, v in enumerate((a, b, c)):
        corners[k, 0], corners[k, 1], corners[k, 2] = corner(large.vertices, v, large.origin, large.axes)
    if max(corners[0, 2], corners[1, 2], corners[2, 2]) <= large.near:
        return
    if not _planes(corners, large.values, a, b, c, rows, columns, planes):
        return
    left, right, top, bottom = _bounds(corners, large.near, rows, columns)
    if left > right:
        return
    count = _cover(planes, left, right, top, bottom, nearness, large.hits)
    reaches_contact = _overlaps(large.values, a, b, c, 10) and _overlaps(large.values, a, b, c, 11)
    _interpolate(planes, large.hits, count, 12 if reaches_contact else 10, large.at_hits)
    visible = large.at_hits[12, :count]
    light_visibility(large.at_hits[6:9, :count], large.nearness, large.blocks, large.opacity, visible)
    if reaches_contact:
        dim_floor(large.at_hits[10:12, :count], large.contact, large.at_hits[13, :count])
    else:
        large.at_hits[13, :count] = 1.0
    _write(large.hits, large.at_hits, count, large.ambient, face_id, colour, face_ids)


@exact
def _overlaps(values: Array, a: int, b: int, c: int, k: int) -> bool:
    """Tell whether a triangle's range of one coordinate overlaps the grid of the contact shadow."""
    low, high = min(values[a, k], values[b, k], values[c, k]), max(values[a, k], values[b, k], values[c, k])
    return high > 0.0 and low < CELLS


@exact
def _cover(
    planes: Array, left: float, right: float, top: int, bottom: int, nearness: Array, hits: Array
) -> int:
    """Write the depth of a triangle where it is the nearest, and return in how many pixels.

    hits  (4, N), output: their rows and columns, and a bit for each of their subsamples
    """
    count = 0
    column_slope, row_slope = planes[2, :3].sum(), planes[1, :3].sum()
    within = (1.0 - 1.0 / SUPERSAMPLING) / 2.0
    reach, line = within * (np.abs(planes[1, :3]) + np.abs(planes[2, :3])), np.empty(3)
    for i in range(top, bottom + 1):
        begin, end = left, right
        for k in range(3):
            line[k] = planes[0, k] + planes[1, k] * i
            value = line[k] + reach[k]
            if planes[2, k] > 0.0:
                begin = max(begin, -value / planes[2, k])
            elif planes[2, k] < 0.0:
                end = min(end, -value / planes[2, k])
            elif value < 0.0:
                end = -1.0
        begin, end = min(begin, right + 1.0), max(end, left - 1.0)  # slopes may be almost 0
        for j in range(int(np.ceil(begin - _TOLERANCE)), int(np.floor(end + _TOLERANCE)) + 1):
            u, v, w = line[0] + planes[2, 0] * j, line[1] + planes[2, 1] * j, line[2] + planes[2, 2] * j
            inner = u >= reach[0] and v >= reach[1] and w >= reach[2]
            bits = 0
            for s in range(SUPERSAMPLING * SUPERSAMPLING):
                y = (s // SUPERSAMPLING + 0.5) / SUPERSAMPLING - 0.5
                x = (s % SUPERSAMPLING + 0.5) / SUPERSAMPLING - 0.5
                value = u + v + w + row_slope * y + column_slope * x
                row, column = SUPERSAMPLING * i + s // SUPERSAMPLING, SUPERSAMPLING * j + s % SUPERSAMPLING
                if value > nearness[row, column] and (
                    inner
                    or (
                        u + planes[1, 0] * y + planes[2, 0] * x >= -_TOLERANCE * reach[0]
                        and v + planes[1, 1] * y + planes[2, 1] * x >= -_TOLERANCE * reach[1]
                        and w + planes[1, 2] * y + planes[2, 2] * x >= -_TOLERANCE * reach[2]
                    )
                ):
                    nearness[row, column] = value
                    bits |= 1 << s
            if bits:
                hits[0, count], hits[1, count], hits[2, count] = i, j, bits
                count += 1
    return count


@fast
def _interpolate(planes: Array, hits: Array, count: int, channels: int, at_hits: Array) -> None:
    """Interpolate the first values of corners at the mean of a pixel's covered subsamples, into at_hits.

    That point is always inside the triangle. Pixels are the inner loop, in single precision, so that it is
    vectorised.
    """
    x = np.float32(planes[0, 0] + planes[0, 1] + planes[0, 2])
    y = np.float32(planes[1, 0] + planes[1, 1] + planes[1, 2])
    z = np.float32(planes[2, 0] + planes[2, 1] + planes[2, 2])
    depth = at_hits[12]
    rows, columns = at_hits[13], at_hits[14]
    for n in range(count):
        rows[n] = np.float32(hits[0, n]) + _MIDDLES[hits[2, n], 0]
        columns[n] = np.float32(hits[1, n]) + _MIDDLES[hits[2, n], 1]
    for n in range(count):
        depth[n] = np.float32(1.0) / (x + y * rows[n] + z * columns[n])
    for k in range(channels):
        x, y, z = np.float32(planes[0, 3 + k]), np.float32(planes[1, 3 + k]), np.float32(planes[2, 3 + k])
        row = at_hits[k]
        for n in range(count):
            row[n] = (x + y * rows[n] + z * columns[n]) * depth[n]


@fast
def _write(
    hits: Array,
    at_hits: Array,
    count: int,
    ambient: float,
    face_id: int,
    colour: Array,
    face_ids: Array,
) -> None:
    """Write colours of covered subsamples, mixed by the visibility of the key light in at_hits[12].

    The contact shadow in at_hits[13] is a factor on values without the key light.
    """
    has_ids, packed = face_ids.shape[0] > 0, hits[3]
    none, white, half, one = np.float32(0.0), np.float32(WHITE), np.float32(0.5), np.float32(1.0)
    part, visible, open_above = np.float32(ambient), at_hits[12], at_hits[13]
    for n in range(count):
        visible[n] += at_hits[9, n] * visible[n] * (one - visible[n])
    packed[:count] = 0
    for k in range(3):
        with_key, without = at_hits[k], at_hits[3 + k]
        for n in range(count):
            dark = open_above[n] * without[n]
            lit = (one - part * (one - open_above[n])) * with_key[n]
            shown = white * (dark + visible[n] * (lit - dark)) + half
            shown = shown if shown > none else none
            packed[n] = packed[n] << 10 | np.int32(shown if shown < white else white)
    for n in range(count):
        i, j = SUPERSAMPLING * hits[0, n], SUPERSAMPLING * hits[1, n]
        for s in range(SUPERSAMPLING * SUPERSAMPLING):
            if hits[2, n] >> s & 1:
                colour[i + s // SUPERSAMPLING, j + s % SUPERSAMPLING] = packed[n]
                if has_ids:
                    face_ids[i + s // SUPERSAMPLING, j + s % SUPERSAMPLING] = face_id


@exact
def _planes(
    corners: Array, values: Array, a: int, b: int, c: int, rows: int, columns: int, planes: Array
) -> bool:
    """Compute barycentric coordinates and values over the depth as linear functions of row and column.

    planes  (3, 15), output: at the first pixel, per row, and per column

    Returns False for a triangle seen edge-on.
    """
    p, q, r = corners[0], corners[1], corners[2]
    n = np.empty((3, 3))
    for k in range(3):  # np.cross and np.stack take two seconds to compile
        i, j = (k + 1) % 3, (k + 2) % 3
        n[0, k] = q[i] * r[j] - q[j] * r[i]
        n[1, k] = r[i] * p[j] - r[j] * p[i]
        n[2, k] = p[i] * q[j] - p[j] * q[i]
    volume = p[0] * n[0, 0] + p[1] * n[0, 1] + p[2] * n[0, 2]
    if not abs(volume) >= _EDGE_ON * (abs(p[2]) + abs(q[2]) + abs(r[2])) ** 3:
        return False
    for k in range(3):
        x, y, z = n[k, 0] / volume, n[k, 1] / volume, n[k, 2] / volume
        planes[0, k] = x * (1.0 / columns - 1.0) + y * (1.0 - 1.0 / rows) + z
        planes[1, k], planes[2, k] = -2.0 / rows * y, 2.0 / columns * x
    for k in range(12):
        for m in range(3):
            planes[m, 3 + k] = (
                values[a, k] * planes[m, 0] + values[b, k] * planes[m, 1] + values[c, k] * planes[m, 2]
            )
    return True


@exact
def _bounds(corners: Array, near: float, rows: int, columns: int) -> tuple[float, float, int, int]:
    """Return first and last column, first and last row of the part of a triangle in front of the camera."""
    left, right, low, high = np.inf, -np.inf, np.inf, -np.inf
    for start, end in ((0, 1), (1, 0), (1, 2), (2, 1), (2, 0), (0, 2)):
        x, y, z = corners[start, 0], corners[start, 1], corners[start, 2]
        if z < near:
            if corners[end, 2] < near:
                continue
            along = (near - z) / (corners[end, 2] - z)
            x += along * (corners[end, 0] - x)
            y += along * (corners[end, 1] - y)
            z = near
        x, y = x / z, y / z
        left, right, low, high = min(left, x), max(right, x), min(low, y), max(high, y)
    return (
        max(0.0, (left + 1.0) / 2.0 * columns - 1.5),
        min(columns - 1.0, (right + 1.0) / 2.0 * columns + 0.5),
        int(max(0.0, (1.0 - high) / 2.0 * rows - 1.5)),
        int(min(rows - 1.0, (1.0 - low) / 2.0 * rows + 0.5)),
    )
