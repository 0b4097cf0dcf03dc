"""The compiled functions of `Squash` and of `Press`: see the classes there for the equations."""

from __future__ import annotations

import math
from typing import Any

from numba import carray, types
from numba.extending import intrinsic

from flowsculpt.api.flows import block_kernel, kernel
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.contact.height_kernels import LEAN, height_at

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


@kernel("UniTuple(f8, 2)(f8[::1], f8, b1)", **LEAN)
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
    undoes = p[2] > 0.0
    upper_end = m[0] if m[4] > 0.0 else m[0] - m[3]
    highest = m[HEIGHTS] + upper_end
    ax, ay, az, ux, uy, uz, bx, by, bz = m[9], m[10], m[11], m[12], m[13], m[14], m[15], m[16], m[17]
    for i in range(count):
        up = ux * x[i] + uy * y[i] + uz * z[i]
        if not up < highest:
            continue
        a, b = ax * x[i] + ay * y[i] + az * z[i], bx * x[i] + by * y[i] + bz * z[i]
        ground = relief(m, a, b)
        if not up - ground < upper_end:
            continue
        height, factor = squashed(m, up - ground, undoes)
        da, db = (factor - 1.0) * (a - m[5]), (factor - 1.0) * (b - m[6])
        rise = height + (relief(m, a + da, b + db) if factor != 1.0 else ground) - up
        u[i] += ax * da + ux * rise + bx * db
        v[i] += ay * da + uy * rise + by * db
        w[i] += az * da + uz * rise + bz * db
