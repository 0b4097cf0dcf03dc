"""Kernels: render the shadow map, and look up the visibility of the key light."""

from __future__ import annotations

import numpy as np

from render.raster.raster_projection import EDGE, Array, box, corner, exact, fast

BLOCK = 8
"""Pixels along a block of the shadow map that is tested at once."""

_RADIUS = 4
_COARSE, _FINE = (-4, 0, 4), (-4, -2, 0, 2, 4)
"""Offsets of a filter's pixels: the coarse ones first, the fine ones where these differ."""


@exact
def render_depth(screen: Array, faces: Array, side: int, nearness: Array) -> None:
    """Write one over the depth of the nearest triangle into nearness (2, S, S), which is 0 at first.

    side  0 if both sides may be visible. For a closed surface 1 or -1, as triangles that face the light run
          counter-clockwise or clockwise: these go into nearness[0], others into nearness[1]

    Triangles that cross the plane of the light cast no shadow.
    """
    rows, columns = nearness.shape[1], nearness.shape[2]
    for f in range(faces.shape[0]):
        a, b, c = np.uint32(faces[f, 0]), np.uint32(faces[f, 1]), np.uint32(faces[f, 2])
        ax, ay, bx, by = screen[a, 0], screen[a, 1], screen[b, 0], screen[b, 1]
        cx, cy = screen[c, 0], screen[c, 1]
        area = (by - ay) * (cx - ax) - (bx - ax) * (cy - ay)
        if area == 0.0:
            continue
        layer = 1 if area * side < 0.0 else 0
        left, right, top, bottom = box(ax, ay, bx, by, cx, cy, rows, columns)
        if left > right or top > bottom:
            continue
        depth_a, depth_b, depth_c = screen[a, 2], screen[b, 2], screen[c, 2]
        if not (depth_a > 0.0 and depth_b > 0.0 and depth_c > 0.0):
            continue
        ux, uy = (by - cy) / -area, (cx - bx) / -area
        vx, vy = (cy - ay) / -area, (ax - cx) / -area
        for i in range(top, bottom + 1):
            u = ux * (left - cx) + uy * (i - cy)
            v = vx * (left - cx) + vy * (i - cy)
            for j in range(left, right + 1):
                w = 1.0 - u - v
                if u >= -EDGE and v >= -EDGE and w >= -EDGE:
                    value = u * depth_a + v * depth_b + w * depth_c
                    if value > nearness[layer, i, j]:
                        nearness[layer, i, j] = value
                u += ux
                v += vx


@exact
def move_halfway(nearness: Array) -> None:
    """Move the depth of a closed surface halfway to its far side, in the output of `render_depth`.

    Lit points are then clear of their own shadow at every angle (Woo 1992).
    """
    for i in range(nearness.shape[1]):
        for j in range(nearness.shape[2]):
            if nearness[1, i, j] > 0.0:
                nearness[0, i, j] = 0.5 * (nearness[0, i, j] + nearness[1, i, j])


@exact
def block_maxima(nearness: Array, blocks: Array) -> None:
    """Write the maximum of each block of nearness (S, S) and its neighbours into blocks (S / BLOCK, S /
    BLOCK).
    """
    count = blocks.shape[0]
    maxima = np.zeros((count, count), np.float32)
    for i in range(nearness.shape[0]):
        for column in range(count):
            largest = np.float32(0.0)
            for j in range(BLOCK):
                largest = max(largest, nearness[i, BLOCK * column + j])
            maxima[i // BLOCK, column] = max(maxima[i // BLOCK, column], largest)
    for i in range(count):
        for j in range(count):
            blocks[i, j] = maxima[max(0, i - 1) : i + 2, max(0, j - 1) : j + 2].max()


@exact
def light_coordinates(
    vertices: Array, normals: Array, which: Array, lift: float, origin: Array, axes: Array, out: Array
) -> None:
    """Write the coordinates of some vertices, moved by `lift` along their normals, into out (3, N).

    which  (N,), their indices; coordinates as of `projection.corner`
    """
    point = np.empty((1, 3))
    for n in range(which.shape[0]):
        v = which[n]
        for k in range(3):
            point[0, k] = vertices[v, k] + lift * normals[v, k]
        out[0, n], out[1, n], out[2, n] = corner(point, 0, origin, axes)


@fast
def light_visibility(
    coordinates: Array, nearness: Array, blocks: Array, opacity: float, fraction: Array
) -> None:
    """Write the visible fraction of the key light, 0 to 1, at coordinates (3, N) into fraction (N,).

    nearness  (S, S), one over the depth that the light reaches; empty if there is no key light
    blocks    (S / BLOCK, S / BLOCK), as `block_maxima` computes them
    opacity   the fraction of the light that a shadow lacks
    """
    side = nearness.shape[0]
    for n in range(coordinates.shape[1]):
        fraction[n] = 1.0
        if side == 0 or coordinates[2, n] <= 0.0:
            continue
        value = 1.0 / coordinates[2, n]
        row = int((1.0 - coordinates[1, n] * value) / 2.0 * side)
        column = int((coordinates[0, n] * value + 1.0) / 2.0 * side)
        if not (_RADIUS <= row < side - _RADIUS and _RADIUS <= column < side - _RADIUS):
            continue
        if blocks[row // BLOCK, column // BLOCK] <= value:
            continue
        passed = 0
        for di in _COARSE:
            for dj in _COARSE:
                passed += nearness[row + di, column + dj] <= value
        if passed == 0 or passed == 9:  # only the thinnest shadows differ between
            fraction[n] = 1.0 - opacity * (1.0 - passed / 9.0)
            continue
        passed = 0
        for di in _FINE:
            for dj in _FINE:
                passed += nearness[row + di, column + dj] <= value
        fraction[n] = 1.0 - opacity * (1.0 - passed / 25.0)
