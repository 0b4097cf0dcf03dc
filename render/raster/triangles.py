"""Kernels: draw triangles with a depth buffer, edges of faces, and segments of streamlines.

Triangles that cover many pixels or cross the camera plane have shadows per pixel. In homogeneous coordinates
(Olano and Greer 1997) nothing needs to be clipped: barycentric coordinates over the depth are linear across
the picture, and so are values of vertices over the depth.

No function is called per pixel: reference counts of its array arguments would be shared by all threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flowsculpt.render.raster.raster_shapes import EDGE, LARGE_SIZE, Array, box, corner, exact, fast
from flowsculpt.render.raster.shadows import CELLS, dim_floor, light_visibility

SUPERSAMPLING = 2  # subsamples along each side of a pixel, against jagged edges
WHITE = 1023.0  # white in a channel of ten bits: the colour of a subsample is packed into 32 bits

_EDGE_ON = 1e-12
_TOLERANCE = 1e-9  # part of a pixel by which rows are longer: rounding leaves no gap between neighbours


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


class Subsamples(NamedTuple):
    """A picture of subsamples, SUPERSAMPLING times as fine as its pixels each way.

    nearness  (H, W), one over the depth of the nearest triangle so far
    colour    (H, W) uint32, its packed colour
    face_ids  (H, W) int32, its id; empty if not wanted
    """

    nearness: Array
    colour: Array
    face_ids: Array


@exact
def draw_large_triangle(
    a: int, b: int, c: int, face_id: int, large: LargeTriangles, drawn: Subsamples
) -> None:
    """Draw a triangle as `draw_triangles` does. a, b, c: indices of its corners"""
    rows, columns = drawn.nearness.shape[0] // SUPERSAMPLING, drawn.nearness.shape[1] // SUPERSAMPLING
    corners, planes = np.empty((3, 3)), np.empty((3, 15))
    origin, values = large.origin, large.values
    for k, v in enumerate((a, b, c)):
        x, y, z = large.vertices[v, 0], large.vertices[v, 1], large.vertices[v, 2]
        x, y, z = corner(x - origin[0], y - origin[1], z - origin[2], large.axes)
        corners[k, 0], corners[k, 1], corners[k, 2] = x, y, z
    if max(corners[0, 2], corners[1, 2], corners[2, 2]) <= large.near:
        return
    if not _planes(corners, values, a, b, c, rows, columns, planes):
        return
    left, right, top, bottom = _bounds(corners, large.near, rows, columns)
    if left > right:
        return
    count = _cover(planes, left, right, top, bottom, drawn.nearness, large.hits)
    overlaps = _overlaps(values[a, 10], values[b, 10], values[c, 10])
    reaches_contact = overlaps and _overlaps(values[a, 11], values[b, 11], values[c, 11])
    _interpolate(planes, large.hits, count, 12 if reaches_contact else 10, large.at_hits)
    visible = large.at_hits[12, :count]
    # Whole rows: `ShadowMap.visibility` passes arrays of the same layout, so that one kernel does for both.
    light_visibility(large.at_hits[6:9], large.nearness, large.blocks, large.opacity, visible)
    if reaches_contact:
        dim_floor(large.at_hits[10:12, :count], large.contact, large.at_hits[13, :count])
    else:
        large.at_hits[13, :count] = 1.0
    _write(large.hits, large.at_hits, count, large.ambient, face_id, drawn)


@exact
def _overlaps(a: float, b: float, c: float) -> bool:
    """Tell whether the range of a coordinate of three corners overlaps the grid of the contact shadow."""
    return max(a, b, c) > 0.0 and min(a, b, c) < CELLS


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

    That point is always inside the triangle. The inner loop is vectorised: over pixels, in single precision.
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
def _write(hits: Array, at_hits: Array, count: int, ambient: float, face_id: int, drawn: Subsamples) -> None:
    """Write colours of covered subsamples, mixed by the visibility of the key light in at_hits[12].

    The contact shadow in at_hits[13] is a factor on values without the key light.
    """
    colour, face_ids, packed = drawn.colour, drawn.face_ids, hits[3]
    has_ids = face_ids.shape[0] > 0
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
            value = values[a, k] * planes[m, 0] + values[b, k] * planes[m, 1]
            planes[m, 3 + k] = value + values[c, k] * planes[m, 2]
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


@exact
def draw_triangles(
    order: Array,
    faces: Array,
    first_id: int,
    screen: Array,
    colours: Array,
    large: LargeTriangles,
    drawn: Subsamples,
) -> None:
    """Draw faces into a picture.

    order     (N,), indices of the faces (F, 3) to draw
    first_id  id of face 0
    screen    (V, 3), as `project` computes them
    colours   (V, 3): display values of corners of small triangles
    """
    nearness, colour, face_ids = drawn
    rows, columns = nearness.shape
    has_ids = face_ids.shape[0] > 0
    for n in range(order.shape[0]):
        f = order[n]
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        depth_a, depth_b, depth_c = screen[a, 2], screen[b, 2], screen[c, 2]
        if not (depth_a > 0.0 and depth_b > 0.0 and depth_c > 0.0):
            draw_large_triangle(a, b, c, first_id + f, large, drawn)
            continue
        ax, ay, bx, by = screen[a, 0], screen[a, 1], screen[b, 0], screen[b, 1]
        cx, cy = screen[c, 0], screen[c, 1]
        left, right, top, bottom = box(ax, ay, bx, by, cx, cy, rows, columns)
        if max(right - left, bottom - top) >= LARGE_SIZE:
            draw_large_triangle(a, b, c, first_id + f, large, drawn)
            continue
        # barycentric coordinates u, v of corners a and b are linear across the picture
        scale = 1.0 / ((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))
        ux, uy = (by - cy) * scale, (cx - bx) * scale
        vx, vy = (cy - ay) * scale, (ax - cx) * scale
        depth_u, depth_v = depth_a - depth_c, depth_b - depth_c
        red, green = WHITE * colours[c, 0] + 0.5, WHITE * colours[c, 1] + 0.5
        blue = WHITE * colours[c, 2] + 0.5
        red_u, red_v = WHITE * (colours[a, 0] - colours[c, 0]), WHITE * (colours[b, 0] - colours[c, 0])
        green_u, green_v = WHITE * (colours[a, 1] - colours[c, 1]), WHITE * (colours[b, 1] - colours[c, 1])
        blue_u, blue_v = WHITE * (colours[a, 2] - colours[c, 2]), WHITE * (colours[b, 2] - colours[c, 2])
        for i in range(top, bottom + 1):
            u = ux * (left - cx) + uy * (i - cy)
            v = vx * (left - cx) + vy * (i - cy)
            for j in range(left, right + 1):
                value = depth_c + u * depth_u + v * depth_v
                if (u >= -EDGE) & (v >= -EDGE) & (u + v <= 1.0 + EDGE) & (value > nearness[i, j]):
                    nearness[i, j] = value
                    colour[i, j] = (
                        int(red + u * red_u + v * red_v) << 20
                        | int(green + u * green_u + v * green_v) << 10
                        | int(blue + u * blue_u + v * blue_v)
                    )
                    if has_ids:
                        face_ids[i, j] = first_id + f
                u += ux
                v += vx


@fast
def pack(red: float, green: float, blue: float) -> int:
    """Return display values packed into 32 bits."""
    return int(WHITE * red + 0.5) << 20 | int(WHITE * green + 0.5) << 10 | int(WHITE * blue + 0.5)


@fast
def average(colour: Array, picture: Array) -> None:
    """Write the mean of the subsamples of each pixel into picture (H, W, 3), or the subsamples themselves."""
    step = colour.shape[0] // picture.shape[0]
    share = np.float32(1.0 / (WHITE * step * step))
    red_shift, green_shift, ten_bits = np.uint32(20), np.uint32(10), np.uint32(1023)
    for i in range(picture.shape[0]):
        for j in range(picture.shape[1]):
            red = green = blue = np.uint32(0)
            for di in range(step):
                for dj in range(step):
                    packed = colour[step * i + di, step * j + dj]
                    red += packed >> red_shift
                    green += packed >> green_shift & ten_bits
                    blue += packed & ten_bits
            picture[i, j, 0] = share * np.float32(red)
            picture[i, j, 1] = share * np.float32(green)
            picture[i, j, 2] = share * np.float32(blue)


@fast
def draw_edges(screen: Array, faces: Array, face_ids: Array, ink: Array, picture: Array) -> None:
    """Draw the edges of visible faces (F, 3) over a picture (H, W, 3) of display values.

    screen    (V, 3), as `project` computes them; faces that cross the camera plane have no edges
    face_ids  (SUPERSAMPLING H, SUPERSAMPLING W): the visible face; ids beyond F have no edges
    ink       (5,): colour, opacity, and width in pixels
    """
    share = ink[3] / (SUPERSAMPLING * SUPERSAMPLING)
    for i in range(face_ids.shape[0]):
        for j in range(face_ids.shape[1]):
            f = face_ids[i, j]
            if not 0 <= f < faces.shape[0]:
                continue
            distance = np.inf
            for k in range(3):
                a, b = faces[f, k], faces[f, (k + 1) % 3]
                if min(screen[a, 2], screen[b, 2]) <= 0.0:
                    continue
                dx, dy = screen[b, 0] - screen[a, 0], screen[b, 1] - screen[a, 1]
                across = abs((j - screen[a, 0]) * dy - (i - screen[a, 1]) * dx)
                distance = min(distance, across / max(np.sqrt(dx * dx + dy * dy), 1e-12))
            cover = share * min(1.0, max(0.0, ink[4] / 2.0 + 0.5 - distance / SUPERSAMPLING))
            for k in range(3):
                picture[i // SUPERSAMPLING, j // SUPERSAMPLING, k] += cover * (
                    ink[k] - picture[i // SUPERSAMPLING, j // SUPERSAMPLING, k]
                )


@fast
def draw_lines(ends: Array, inks: Array, width: float, hidden: float, depth: Array, picture: Array) -> None:
    """Draw short segments over a picture (H, W, 3), in order, with soft edges.

    ends    (N, 2, 3): the ends of each segment, pixels from the left and the top, and depth
    inks    (N, 4): colour and opacity
    width   pixels
    hidden  factor on the opacity behind the surface, of depth (H, W)
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
                    continue  # the next segment draws it
                distance = abs(px * dy - py * dx) / np.sqrt(squared)
                cover = min(1.0, width / 2.0 + 0.5 - distance)
                if cover <= 0.0:
                    continue
                opacity = inks[n, 3] * cover
                if z0 + along * (z1 - z0) > depth[i, j]:
                    opacity *= hidden
                for k in range(3):
                    picture[i, j, k] += opacity * (inks[n, k] - picture[i, j, k])
