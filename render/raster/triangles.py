"""Kernels: draw triangles with a depth buffer, edges of faces, and segments of streamlines."""

from __future__ import annotations

import numpy as np

from render.raster.large_triangles import SUPERSAMPLING, WHITE, LargeTriangles, draw_large_triangle
from render.raster.raster_projection import EDGE, LARGE_SIZE, Array, box, exact, fast


@exact
def draw_triangles(
    order: Array,
    faces: Array,
    first_id: int,
    screen: Array,
    colours: Array,
    large: LargeTriangles,
    nearness: Array,
    colour: Array,
    face_ids: Array,
) -> None:
    """Draw faces into a picture of subsamples, SUPERSAMPLING times as fine as its pixels each way.

    order      (N,), indices of the faces (F, 3) to draw
    first_id   id of face 0
    screen     (V, 3), as `project` computes them
    colours    (V, 3): display values of corners of small triangles
    nearness   (H, W), one over the depth of the nearest triangle so far
    colour     (H, W) uint32, its packed colour
    face_ids   (H, W) int32, its id; empty if not wanted
    """
    rows, columns = nearness.shape
    has_ids = face_ids.shape[0] > 0
    for n in range(order.shape[0]):
        f = order[n]
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        depth_a, depth_b, depth_c = screen[a, 2], screen[b, 2], screen[c, 2]
        if not (depth_a > 0.0 and depth_b > 0.0 and depth_c > 0.0):
            draw_large_triangle(a, b, c, first_id + f, large, nearness, colour, face_ids)
            continue
        ax, ay, bx, by = screen[a, 0], screen[a, 1], screen[b, 0], screen[b, 1]
        cx, cy = screen[c, 0], screen[c, 1]
        left, right, top, bottom = box(ax, ay, bx, by, cx, cy, rows, columns)
        if max(right - left, bottom - top) >= LARGE_SIZE:
            draw_large_triangle(a, b, c, first_id + f, large, nearness, colour, face_ids)
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
    """Write the mean of the subsamples of each pixel into picture (H, W, 3)."""
    share = np.float32(1.0 / (WHITE * SUPERSAMPLING * SUPERSAMPLING))
    red_shift, green_shift, ten_bits = np.uint32(20), np.uint32(10), np.uint32(1023)
    for i in range(picture.shape[0]):
        for j in range(picture.shape[1]):
            red = green = blue = np.uint32(0)
            for di in range(SUPERSAMPLING):
                for dj in range(SUPERSAMPLING):
                    packed = colour[SUPERSAMPLING * i + di, SUPERSAMPLING * j + dj]
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
