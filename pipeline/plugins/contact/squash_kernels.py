"""The compiled function of `Squash`: see the class there for the equations."""

from __future__ import annotations

import math

from flowsculpt.api.flows import block_kernel
from flowsculpt.api.meshes import Floats


@block_kernel
def squash(
    p: Floats, count: int, x: Floats, y: Floats, z: Floats, t: float, u: Floats, v: Floats, w: Floats
) -> None:
    """Numbers: top 0, base 1, margin 2, span 3, bend 4, x and z of the axis 5:7, spreads 7, undoes 8.

    The inverse of a point at or below the base is NaN.
    """
    top, base, margin, span, bend, ax, az = p[0], p[1], p[2], p[3], p[4], p[5], p[6]
    spreads, undoes = p[7] > 0.0, p[8] > 0.0
    least_slope = (1.0 + (bend * span) ** 2) ** -1.5
    upper_end = top if bend > 0.0 else top - span
    for i in range(count):
        down = top - y[i]
        if not y[i] < upper_end:
            continue
        if not undoes:
            depth = min(down, span)
            if down > span:
                height = base + margin * margin / (margin + least_slope * (down - span))
            else:
                height = top - depth / math.sqrt(1.0 + (bend * depth) ** 2)
        elif y[i] < base + margin:
            depth = span
            height = math.nan
            if y[i] > base:
                height = top - depth - (margin * margin / (y[i] - base) - margin) / least_slope
        else:
            cosine = 1.0 - (bend * down) ** 2
            depth = min(down / math.sqrt(cosine), span) if cosine > 0.0 else span
            height = top - depth
        v[i] += height - y[i]
        if spreads:
            root = math.sqrt(1.0 + (bend * depth) ** 2)
            factor = root * math.sqrt(root)
            if undoes:
                factor = 1.0 / factor
            u[i] += (factor - 1.0) * (x[i] - ax)
            w[i] += (factor - 1.0) * (z[i] - az)
