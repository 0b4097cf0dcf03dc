"""Triangles put into a picture in display values, compiled: one after another, the nearest stays."""

from __future__ import annotations

import numpy as np

from render.raster.compiled import Array, exact, quick
from render.raster.kernels.large_triangles import FINER, TOP, Large, paint_large
from render.raster.kernels.projection import EDGE, WIDE, box


@exact
def paint(
    order: Array,
    faces: Array,
    first: int,
    screen: Array,
    shown: Array,
    large: Large,
    near: Array,
    colour: Array,
    name: Array,
) -> None:
    """Put faces into a picture of places, FINER times as fine as its pixels each way.

    order   (N,) of the faces (F, 3), in what order they come; `first`, what the first of them is called
    screen  (V, 3), as `project` finds them
    shown   (V, 3): display values of corners of small triangles
    near    (H, W), one over the depth of the nearest so far; colour (H, W) uint32, what it shows
    name    (H, W) int32, what it is called; empty where nobody asks
    """
    rows, columns = near.shape
    named = name.shape[0] > 0
    for n in range(order.shape[0]):
        f = order[n]
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        depth_a, depth_b, depth_c = screen[a, 2], screen[b, 2], screen[c, 2]
        if not (depth_a > 0.0 and depth_b > 0.0 and depth_c > 0.0):
            paint_large(a, b, c, first + f, large, near, colour, name)
            continue
        ax, ay, bx, by = screen[a, 0], screen[a, 1], screen[b, 0], screen[b, 1]
        cx, cy = screen[c, 0], screen[c, 1]
        left, right, top, bottom = box(ax, ay, bx, by, cx, cy, rows, columns)
        if max(right - left, bottom - top) >= WIDE:
            paint_large(a, b, c, first + f, large, near, colour, name)
            continue
        # shares of the corners a, b and c at a place, which are linear across the picture
        scale = 1.0 / ((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))
        ux, uy = (by - cy) * scale, (cx - bx) * scale
        vx, vy = (cy - ay) * scale, (ax - cx) * scale
        depth_u, depth_v = depth_a - depth_c, depth_b - depth_c
        red, green, blue = TOP * shown[c, 0] + 0.5, TOP * shown[c, 1] + 0.5, TOP * shown[c, 2] + 0.5
        red_u, red_v = TOP * (shown[a, 0] - shown[c, 0]), TOP * (shown[b, 0] - shown[c, 0])
        green_u, green_v = TOP * (shown[a, 1] - shown[c, 1]), TOP * (shown[b, 1] - shown[c, 1])
        blue_u, blue_v = TOP * (shown[a, 2] - shown[c, 2]), TOP * (shown[b, 2] - shown[c, 2])
        for i in range(top, bottom + 1):
            u = ux * (left - cx) + uy * (i - cy)
            v = vx * (left - cx) + vy * (i - cy)
            for j in range(left, right + 1):
                here = depth_c + u * depth_u + v * depth_v
                if (u >= -EDGE) & (v >= -EDGE) & (u + v <= 1.0 + EDGE) & (here > near[i, j]):
                    near[i, j] = here
                    colour[i, j] = (
                        int(red + u * red_u + v * red_v) << 20
                        | int(green + u * green_u + v * green_v) << 10
                        | int(blue + u * blue_u + v * blue_v)
                    )
                    if named:
                        name[i, j] = first + f
                u += ux
                v += vx


@quick
def pack(red: float, green: float, blue: float) -> int:
    """Display values in 32 bits."""
    return int(TOP * red + 0.5) << 20 | int(TOP * green + 0.5) << 10 | int(TOP * blue + 0.5)


@quick
def resolve(colour: Array, picture: Array) -> None:
    """The mean of the places of each pixel, into picture (H, W, 3)."""
    share = np.float32(1.0 / (TOP * FINER * FINER))
    first, second, ten = np.uint32(20), np.uint32(10), np.uint32(1023)
    for i in range(picture.shape[0]):
        for j in range(picture.shape[1]):
            red = green = blue = np.uint32(0)
            for di in range(FINER):
                for dj in range(FINER):
                    packed = colour[FINER * i + di, FINER * j + dj]
                    red += packed >> first
                    green += packed >> second & ten
                    blue += packed & ten
            picture[i, j, 0] = share * np.float32(red)
            picture[i, j, 1] = share * np.float32(green)
            picture[i, j, 2] = share * np.float32(blue)
