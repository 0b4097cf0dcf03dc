"""The compiled functions of `Squash` and of `Press`: see the classes there for the equations."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import carray, types
from numba.extending import intrinsic

from flowsculpt.api.flows import block_kernel, kernel
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.contact.height_kernels import LEAN, LEAN_CALLS, height_at

LEVEL, HEIGHTS = 18, 20
"""Places in the numbers of a press: after the 9 of its squash, and the 9 of its axes a, up and b,

LEVEL    the height below which the relief levels out, and the length over which it does
HEIGHTS  those of the heights
"""

_DOUBLES = types.CPointer(types.float64)


@intrinsic  # type: ignore[untyped-decorator]  # numba has no types
def numbers_at(typingctx: Any, address: Any) -> Any:
    """Return a pointer to the float64 numbers at an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(_DOUBLES))

    return _DOUBLES(types.int64), generate


@kernel("UniTuple(f8, 2)(UniTuple(f8, 6), f8)", **LEAN)
def squashed(p: tuple[float, ...], y: float) -> tuple[float, float]:
    """Return the height that the squash leads y to, and the stretch, 1 + κ² v², there.

    p  top, base, margin, span, bend, and the slope at the lowest point
    """
    top, base, margin, span, bend, slope = p
    down = top - y
    depth = min(down, span)
    stretched = 1.0 + (bend * depth) * (bend * depth)
    height = top - depth / math.sqrt(stretched)
    below = base + margin * margin / (margin + slope * max(down - span, 0.0))
    return below if down > span else height, stretched


@kernel("UniTuple(f8, 2)(UniTuple(f8, 6), f8)", **LEAN)
def unsquashed(p: tuple[float, ...], y: float) -> tuple[float, float]:
    """Return the height that the squash leads to y, and the stretch there; NaN at or below the base."""
    top, base, margin, span, bend, slope = p
    down = top - y
    cosine = max(1.0 - (bend * down) * (bend * down), 1e-300)
    depth = min(down / math.sqrt(cosine), span)
    is_below = y < base + margin
    depth = span if is_below else depth
    above_base = y - base
    lost = 0.0 if above_base > 0.0 else math.nan
    below = top - span - (margin * margin / max(above_base, 1e-300) - margin) / slope + lost
    return below if is_below else top - depth, 1.0 + (bend * depth) * (bend * depth)


@kernel("UniTuple(f8, 6)(f8, f8, f8, f8, f8)", **LEAN)
def shape_of(top: float, base: float, margin: float, span: float, bend: float) -> tuple[float, ...]:
    """Return these numbers and the slope of the squash at the lowest point."""
    stretched = 1.0 + (bend * span) * (bend * span)
    return top, base, margin, span, bend, 1.0 / (stretched * math.sqrt(stretched))


BLOCK = 256
"""Points at a time; loops over them have no branches, so they compile to vector instructions."""


@kernel("void(UniTuple(f8, 6), b1, b1, i8, f8[::1], f8[::1], f8[::1])", **LEAN_CALLS)
def squash_block(
    shape: tuple[float, ...], undoes: bool, spreads: bool, size: int, y: Floats, rises: Floats, more: Floats
) -> None:
    """Write how far heights rise, and by how much more than once distances from the axis are multiplied."""
    begin = shape[0] if shape[4] > 0.0 else shape[0] - shape[3]
    if undoes:
        for i in range(size):
            height, more[i] = unsquashed(shape, y[i])
            rises[i] = height - y[i] if y[i] < begin else 0.0
    else:
        for i in range(size):
            height, more[i] = squashed(shape, y[i])
            rises[i] = height - y[i] if y[i] < begin else 0.0
    for i in range(size):
        root = math.sqrt(more[i])
        factor = root * math.sqrt(root)
        factor = 1.0 / factor if undoes else factor
        more[i] = factor - 1.0 if spreads and y[i] < begin else 0.0


@block_kernel
def squash(
    p: Floats, count: int, x: Floats, y: Floats, z: Floats, t: float, u: Floats, v: Floats, w: Floats
) -> None:
    """Numbers: those of `shape_of`, x and z of the axis 5:7, spreads 7, and undoes 8."""
    shape = shape_of(p[0], p[1], p[2], p[3], p[4])
    ax, az, spreads, undoes = p[5], p[6], p[7] > 0.0, p[8] > 0.0
    heights, rises, more = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    for first in range(0, count, BLOCK):
        size = min(BLOCK, count - first)
        for i in range(size):
            heights[i] = y[first + i]
        squash_block(shape, undoes, spreads, size, heights, rises, more)
        for i in range(size):
            v[first + i] += rises[i]
        if spreads:
            for i in range(size):
                u[first + i] += more[i] * (x[first + i] - ax)
            for i in range(size):
                w[first + i] += more[i] * (z[first + i] - az)


@kernel("f8(f8[::1], f8, f8)", **LEAN)
def relief(m: Floats, a: float, b: float) -> float:
    """Return the height of the other subject at a place, which far below its top becomes a plain."""
    height = height_at(m, HEIGHTS, a, b)
    below = m[LEVEL] - height
    return m[LEVEL] - below / math.sqrt(1.0 + (below / m[LEVEL + 1]) ** 2) if below > 0.0 else height


@block_kernel
def press(
    p: Floats, count: int, x: Floats, y: Floats, z: Floats, t: float, u: Floats, v: Floats, w: Floats
) -> None:
    """Numbers: address of those of the press 0, how many they are 1, undoes 2."""
    m = carray(numbers_at(int(p[0])), (int(p[1]),))
    undoes, spreads, shape = p[2] > 0.0, m[7] > 0.0, shape_of(m[0], m[1], m[2], m[3], m[4])
    end = m[0] if m[4] > 0.0 else m[0] - m[3]
    highest = m[HEIGHTS] + end
    ax, ay, az, ux, uy, uz, bx, by, bz = m[9], m[10], m[11], m[12], m[13], m[14], m[15], m[16], m[17]
    a, b, up = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    ground, rises, more = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    for first in range(0, count, BLOCK):
        size = min(BLOCK, count - first)
        for i in range(size):
            px, py, pz = x[first + i], y[first + i], z[first + i]
            a[i], b[i] = ax * px + ay * py + az * pz, bx * px + by * py + bz * pz
            up[i] = ux * px + uy * py + uz * pz
        for i in range(size):
            ground[i] = relief(m, a[i], b[i]) if up[i] < highest else 0.0
            up[i] = up[i] - ground[i] if up[i] < highest else end
        squash_block(shape, undoes, spreads, size, up, rises, more)
        for i in range(size):
            if not up[i] < end:
                continue
            da, db = more[i] * (a[i] - m[5]), more[i] * (b[i] - m[6])
            rise = rises[i] + (relief(m, a[i] + da, b[i] + db) - ground[i] if spreads else 0.0)
            u[first + i] += ax * da + ux * rise + bx * db
            v[first + i] += ay * da + uy * rise + by * db
            w[first + i] += az * da + uz * rise + bz * db
