"""The picture that the key light sees, and what of its light reaches a place, compiled."""

from __future__ import annotations

import numpy as np

from render.raster.compiled import Array, exact, quick
from render.raster.kernels.projection import EDGE, box, corner

BLOCK = 8
"""Pixels of the shadow's picture that are looked at together."""

_AROUND = 3
_FAR, _BETWEEN = (-3, 0, 3), (-3, -2, 0, 1, 3)
"""The pixels of the shadow's picture that are looked at around a place, and those where these differ."""


@exact
def cast(screen: Array, faces: Array, side: int, near: Array) -> None:
    """One over the depth of the nearest triangle, into near (2, S, S), which is 0.

    side  0 where both sides may be seen; of a closed surface 1 or -1, as triangles that look at the light run
          counter-clockwise or clockwise: these go into near[0] then, and others into near[1]

    What goes on behind the light casts no shadow.
    """
    rows, columns = near.shape[1], near.shape[2]
    for f in range(faces.shape[0]):
        a, b, c = np.uint32(faces[f, 0]), np.uint32(faces[f, 1]), np.uint32(faces[f, 2])
        ax, ay, bx, by = screen[a, 0], screen[a, 1], screen[b, 0], screen[b, 1]
        cx, cy = screen[c, 0], screen[c, 1]
        area = (by - ay) * (cx - ax) - (bx - ax) * (cy - ay)
        if area == 0.0:
            continue
        which = 1 if area * side < 0.0 else 0
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
                    here = u * depth_a + v * depth_b + w * depth_c
                    if here > near[which, i, j]:
                        near[which, i, j] = here
                u += ux
                v += vx


@exact
def halve(near: Array) -> None:
    """Move the shadow of a closed surface halfway to where light would leave it, in what `cast` found.

    What is lit then lies clear of it, however steeply (Woo 1992).
    """
    for i in range(near.shape[1]):
        for j in range(near.shape[2]):
            if near[1, i, j] > 0.0:
                near[0, i, j] = 0.5 * (near[0, i, j] + near[1, i, j])


@exact
def largest(near: Array, blocks: Array) -> None:
    """Of each BLOCK of near (S, S) and the eight around it, into blocks (S / BLOCK, S / BLOCK)."""
    many = blocks.shape[0]
    own = np.zeros((many, many), np.float32)
    for i in range(near.shape[0]):
        for column in range(many):
            most = np.float32(0.0)
            for j in range(BLOCK):
                most = max(most, near[i, BLOCK * column + j])
            own[i // BLOCK, column] = max(own[i // BLOCK, column], most)
    for i in range(many):
        for j in range(many):
            blocks[i, j] = own[max(0, i - 1) : i + 2, max(0, j - 1) : j + 2].max()


@exact
def places(
    vertices: Array, normals: Array, which: Array, lift: float, origin: Array, axes: Array, out: Array
) -> None:
    """Where some of the vertices (V, 3) are looked up, `lift` above their surface: into out (3, N)."""
    raised = np.empty((1, 3))
    for n in range(which.shape[0]):
        v = which[n]
        for k in range(3):
            raised[0, k] = vertices[v, k] + lift * normals[v, k]
        out[0, n], out[1, n], out[2, n] = corner(raised, 0, origin, axes)


@quick
def reaches(at: Array, near: Array, blocks: Array, share: Array) -> None:
    """How much of the key light places (3, N) see, from 0 to 1, into share (N,); by those around them.

    near    (S, S), one over the depth that the light reaches; empty where there is no key light
    blocks  (S / BLOCK, S / BLOCK), as `largest` finds them
    """
    side = near.shape[0]
    for n in range(at.shape[1]):
        share[n] = 1.0
        if side == 0 or at[2, n] <= 0.0:
            continue
        here = 1.0 / at[2, n]
        row, column = int((1.0 - at[1, n] * here) / 2.0 * side), int((at[0, n] * here + 1.0) / 2.0 * side)
        if not (_AROUND <= row < side - _AROUND and _AROUND <= column < side - _AROUND):
            continue
        if blocks[row // BLOCK, column // BLOCK] <= here:
            continue
        lit = 0
        for di in _FAR:
            for dj in _FAR:
                lit += near[row + di, column + dj] <= here
        if lit == 0 or lit == 9:  # so do those between, but for the thinnest of shadows
            share[n] = lit / 9.0
            continue
        lit = 0
        for di in _BETWEEN:
            for dj in _BETWEEN:
                lit += near[row + di, column + dj] <= here
        share[n] = lit / 25.0
