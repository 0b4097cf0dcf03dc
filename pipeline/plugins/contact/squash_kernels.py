"""The compiled functions of `Squash` and of `Press`: see the classes there for the equations."""

from __future__ import annotations

import math
from typing import Any

from numba import carray, types
from numba.extending import intrinsic

from flowsculpt.api.flows import block_kernel, kernel
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.contact.height_kernels import height_at

SQUASH, SIDE, HEIGHTS = 0, 9, 18
"""Places in the numbers of a press: those of its squash, its axes u, up and v, and those of the heights."""

_DOUBLES = types.CPointer(types.float64)


@intrinsic  # type: ignore[untyped-decorator]  # numba has no types
def numbers_at(typingctx: Any, address: Any) -> Any:
    """Return a pointer to the float64 numbers at an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(_DOUBLES))

    return _DOUBLES(types.int64), generate


@kernel("UniTuple(f8, 2)(f8[::1], f8, b1)")
def squashed(p: Floats, y: float, undoes: bool) -> tuple[float, float]:
    """Return the height that the squash leads y to, and the factor on distances from the axis.

    p  top 0, base 1, margin 2, span 3, bend 4, spreads 7

    The inverse of a height at or below the base is NaN.
    """
    top, base, margin, span, bend = p[0], p[1], p[2], p[3], p[4]
    down = top - y
    if not undoes:
        depth = min(down, span)
        stretched = 1.0 + (bend * depth) ** 2
        root = math.sqrt(stretched)
        height = top - depth / root
        if down > span:
            least_slope = 1.0 / (root * stretched)
            height = base + margin * margin / (margin + least_slope * (down - span))
    elif y < base + margin:
        depth = span
        stretched = 1.0 + (bend * span) ** 2
        root = math.sqrt(stretched)
        height = math.nan
        if y > base:
            height = top - span - (margin * margin / (y - base) - margin) * root * stretched
    else:
        cosine = 1.0 - (bend * down) ** 2
        depth = min(down / math.sqrt(cosine), span) if cosine > 0.0 else span
        root = math.sqrt(1.0 + (bend * depth) ** 2)
        height = top - depth
    if not p[7] > 0.0:
        return height, 1.0
    factor = root * math.sqrt(root)
    return height, 1.0 / factor if undoes else factor


@block_kernel
def squash(
    p: Floats, count: int, x: Floats, y: Floats, z: Floats, t: float, u: Floats, v: Floats, w: Floats
) -> None:
    """Numbers: those of `squashed`, x and z of the axis 5:7, and undoes 8."""
    top, span, bend = p[0], p[3], p[4]
    upper_end = top if bend > 0.0 else top - span
    undoes = p[8] > 0.0
    numbers = carray(p, (9,))
    for i in range(count):
        if y[i] < upper_end:
            height, factor = squashed(numbers, y[i], undoes)
            v[i] += height - y[i]
            u[i] += (factor - 1.0) * (x[i] - p[5])
            w[i] += (factor - 1.0) * (z[i] - p[6])


@block_kernel
def press(
    p: Floats, count: int, x: Floats, y: Floats, z: Floats, t: float, u: Floats, v: Floats, w: Floats
) -> None:
    """Numbers: address of those of the press 0, how many they are 1, undoes 2."""
    m = carray(numbers_at(int(p[0])), (int(p[1]),))
    numbers, axes, heights = m[SQUASH:SIDE], m[SIDE:HEIGHTS], m[HEIGHTS:]
    undoes, bend = p[2] > 0.0, numbers[4]
    upper_end = numbers[0] if bend > 0.0 else numbers[0] - numbers[3]
    highest = heights[0] + upper_end
    for i in range(count):
        up = axes[3] * x[i] + axes[4] * y[i] + axes[5] * z[i]
        if not up < highest:
            continue
        a = axes[0] * x[i] + axes[1] * y[i] + axes[2] * z[i]
        b = axes[6] * x[i] + axes[7] * y[i] + axes[8] * z[i]
        ground = height_at(heights, a, b)
        if not up - ground < upper_end:
            continue
        height, factor = squashed(numbers, up - ground, undoes)
        da, db = (factor - 1.0) * (a - numbers[5]), (factor - 1.0) * (b - numbers[6])
        rise = height + height_at(heights, a + da, b + db) - up
        u[i] += axes[0] * da + axes[3] * rise + axes[6] * db
        v[i] += axes[1] * da + axes[4] * rise + axes[7] * db
        w[i] += axes[2] * da + axes[5] * rise + axes[8] * db
