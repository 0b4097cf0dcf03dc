"""Kernels: draw triangles in display values with a depth buffer."""

from __future__ import annotations

import numpy as np

from render.raster.kernels.decorators import Array, exact, fast
from render.raster.kernels.large_triangles import SUPERSAMPLING, WHITE, LargeTriangles, draw_large_triangle
from render.raster.kernels.projection import EDGE, LARGE_SIZE, box


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
        red, green, blue = (
            WHITE * colours[c, 0] + 0.5,
            WHITE * colours[c, 1] + 0.5,
            WHITE * colours[c, 2] + 0.5,
        )
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
