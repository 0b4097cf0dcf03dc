"""The compiled functions of `Squash` and of `Press`: see the classes there for the equations."""

from __future__ import annotations

import math

import numpy as np
from numba import carray

from flowsculpt.api.flows import block_kernel, kernel
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.contact.height_kernels import HIGHEST, LEAN, is_flat, write_heights

BLOCK = 256
"""Points at a time; loops over them have no branches, so they compile to vector instructions."""


@kernel("f8[::1](voidptr, i8)")
def floats_at(address: int, count: int) -> Floats:
    """Return the float64 numbers at an address."""
    numbers: Floats = carray(address, (count,), np.float64)
    return numbers


@kernel("UniTuple(f8, 2)(UniTuple(f8, 6), f8)", **LEAN)
def squashed(p: tuple[float, ...], y: float) -> tuple[float, float]:
    """Return the height that the squash leads y to, and r = √(1 + κ² v²): distances grow by r^(3/2).

    p  top, base, margin, span, bend, and the slope at the lowest point
    """
    top, base, margin, span, bend, slope = p
    down = top - y
    depth = min(down, span)
    root = math.sqrt(1.0 + (bend * depth) * (bend * depth))
    below = base + margin * margin / (margin + slope * max(down - span, 0.0))
    return below if down > span else top - depth / root, root


@kernel("UniTuple(f8, 2)(UniTuple(f8, 6), f8)", **LEAN)
def unsquashed(p: tuple[float, ...], y: float) -> tuple[float, float]:
    """Return the height that the squash leads to y, and 1/r of `squashed`; NaN at or below the base."""
    top, base, margin, span, bend, slope = p
    down = top - y
    is_below = y < base + margin
    least = 1.0 / (1.0 + (bend * span) * (bend * span))
    root = math.sqrt(least if is_below else max(least, 1.0 - (bend * down) * (bend * down)))
    above_base = y - base
    lost = 0.0 if above_base > 0.0 else math.nan
    below = top - span - (margin * margin / max(above_base, 1e-300) - margin) * (1.0 / slope) + lost
    return below if is_below else top - min(down / root, span), root


@kernel("UniTuple(f8, 6)(f8, f8, f8, f8, f8)", **LEAN)
def shape_of(top: float, base: float, margin: float, span: float, bend: float) -> tuple[float, ...]:
    """Return these numbers and the slope of the squash at the lowest point."""
    stretched = 1.0 + (bend * span) * (bend * span)
    return top, base, margin, span, bend, 1.0 / (stretched * math.sqrt(stretched))


@kernel("void(UniTuple(f8, 6), b1, b1, f8[::1], f8[::1], f8[::1])", **LEAN)
def squash_block(
    shape: tuple[float, ...], undoes: bool, spreads: bool, y: Floats, rises: Floats, more: Floats
) -> None:
    """Write how far heights rise, and by how much more than once distances from the axis are multiplied."""
    begin = shape[0] if shape[4] > 0.0 else shape[0] - shape[3]
    for i in range(len(y)):
        height, root = unsquashed(shape, y[i]) if undoes else squashed(shape, y[i])
        rises[i] = height - y[i] if y[i] < begin else 0.0
        more[i] = root * math.sqrt(root) - 1.0 if spreads and y[i] < begin else 0.0


@block_kernel
def squash(
    p: Floats, count: int, x: Floats, y: Floats, z: Floats, t: float, u: Floats, v: Floats, w: Floats
) -> None:
    """Numbers: those of `shape_of`, x and z of the axis 5:7, spreads 7, and undoes 8."""
    shape = shape_of(p[0], p[1], p[2], p[3], p[4])
    ax, az, spreads, undoes = p[5], p[6], p[7] > 0.0, p[8] > 0.0
    heights, room = carray(y, (count,)), np.empty((2, BLOCK))
    for first in range(0, count, BLOCK):
        size, near = min(BLOCK, count - first), 0
        for i in range(first, first + size):
            near += heights[i] < shape[0]
        if near == 0:
            continue
        rises, more = room[0, :size], room[1, :size]
        squash_block(shape, undoes, spreads, heights[first : first + size], rises, more)
        for i in range(size):
            v[first + i] += rises[i]
        if spreads:
            for i in range(size):
                u[first + i] += more[i] * (x[first + i] - ax)
                w[first + i] += more[i] * (z[first + i] - az)


LEVEL = 18
"""Place in the numbers of a press of the height below which its relief levels out; then over what length."""

A, B, UP, RISES, MORE, GROUND, DA, DB, HEIGHT, ROOM = range(0, 10 * BLOCK, BLOCK)
"""Places in the numbers of a block of points: where they are, with UP over the other subject in the end,
those of `squash_block`, the height of the other, how far they move along a and b, those of `write_heights`.
"""


@kernel("f8(f8[::1], f8)", **LEAN)
def levelled(m: Floats, height: float) -> float:
    """Return the height of the relief, which far below the top of the other subject becomes a plain."""
    below = m[LEVEL] - height
    return m[LEVEL] - below / math.sqrt(1.0 + (below / m[LEVEL + 1]) ** 2) if below > 0.0 else height


@kernel("void(f8[::1], f8[::1], f8[::1], i8, f8)", **LEAN)
def write_relief(m: Floats, h: Floats, s: Floats, size: int, limit: float) -> None:
    """Write GROUND, the heights of the other subject under points below a limit."""
    uneven, flat = 0, levelled(m, h[HIGHEST])
    for i in range(size):
        uneven += (s[UP + i] < limit) & (not is_flat(h, s[A + i], s[B + i]))
    if uneven == 0:
        for i in range(size):
            s[GROUND + i] = flat if s[UP + i] < limit else s[GROUND + i]
    else:
        write_heights(h, s[A : A + size], s[B : B + size], s[ROOM:], s[HEIGHT : HEIGHT + size])
        for i in range(size):
            s[GROUND + i] = levelled(m, s[HEIGHT + i]) if s[UP + i] < limit else s[GROUND + i]


@block_kernel
def press(
    p: Floats, count: int, x: Floats, y: Floats, z: Floats, t: float, u: Floats, v: Floats, w: Floats
) -> None:
    """Numbers: address of those of the press 0 and of the heights 1, how many these are 2, undoes 3."""
    m, h = floats_at(int(p[0]), LEVEL + 2), floats_at(int(p[1]), int(p[2]))
    undoes, spreads, shape = p[3] > 0.0, m[7] > 0.0, shape_of(m[0], m[1], m[2], m[3], m[4])
    end = m[0] if m[4] > 0.0 else m[0] - m[3]
    top, highest, middle_a, middle_b = h[HIGHEST], h[HIGHEST] + end, m[5], m[6]
    ax, ay, az, ux, uy, uz, bx, by, bz = m[9], m[10], m[11], m[12], m[13], m[14], m[15], m[16], m[17]
    s = np.empty(ROOM + 7 * BLOCK)
    for first in range(0, count, BLOCK):
        size, near = min(BLOCK, count - first), 0
        for i in range(size):
            px, py, pz = x[first + i], y[first + i], z[first + i]
            s[A + i] = ax * px + ay * py + az * pz
            s[B + i] = bx * px + by * py + bz * pz
            s[UP + i] = ux * px + uy * py + uz * pz
            s[GROUND + i] = top
            near += s[UP + i] < highest
        if near == 0:
            continue
        write_relief(m, h, s, size, highest)
        for i in range(size):
            s[UP + i] = s[UP + i] - s[GROUND + i] if s[UP + i] < highest else end
        squash_block(
            shape, undoes, spreads, s[UP : UP + size], s[RISES : RISES + size], s[MORE : MORE + size]
        )
        for i in range(size):
            s[DA + i] = s[MORE + i] * (s[A + i] - middle_a)
            s[DB + i] = s[MORE + i] * (s[B + i] - middle_b)
        if spreads:
            for i in range(size):
                s[A + i] += s[DA + i]
                s[B + i] += s[DB + i]
                s[RISES + i] -= s[GROUND + i]
            write_relief(m, h, s, size, end)
            for i in range(size):
                s[RISES + i] += s[GROUND + i]
        for i in range(size):
            da, db, rise = s[DA + i], s[DB + i], s[RISES + i]
            u[first + i] += ax * da + ux * rise + bx * db
            v[first + i] += ay * da + uy * rise + by * db
            w[first + i] += az * da + uz * rise + bz * db
