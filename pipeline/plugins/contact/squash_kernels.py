"""Compiled loops of `squash`: see the class there for the equations."""

from __future__ import annotations

import math

from flowsculpt.api.flows import kernel
from flowsculpt.api.meshes import Floats


@kernel("void(f8[:, ::1], f8[:, ::1], f8[::1], b1, b1)")
def squash(points: Floats, moved: Floats, numbers: Floats, spreads: bool, undoes: bool) -> None:
    """Write points (N, 3) after the map, or its inverse, to `moved`.

    The numbers are top, base, margin, span and bend of a Squash, and x and z of its axis. The inverse of a
    point at or below the base is NaN.
    """
    top, base, margin, span, bend = numbers[0], numbers[1], numbers[2], numbers[3], numbers[4]
    least_slope = (1.0 + (bend * span) ** 2) ** -1.5
    upper_end = top if bend > 0.0 else top - span
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if not y < upper_end:
            moved[i, 0], moved[i, 1], moved[i, 2] = x, y, z
            continue
        down = top - y
        if not undoes:
            v = min(down, span)
            if down > span:
                height = base + margin * margin / (margin + least_slope * (down - span))
            else:
                height = top - v / math.sqrt(1.0 + (bend * v) ** 2)
        elif y < base + margin:
            v = span
            height = math.nan
            if y > base:
                height = top - v - (margin * margin / (y - base) - margin) / least_slope
        else:
            cosine = 1.0 - (bend * down) ** 2
            v = min(down / math.sqrt(cosine), span) if cosine > 0.0 else span
            height = top - v
        factor = 1.0
        if spreads:
            root = math.sqrt(1.0 + (bend * v) ** 2)
            factor = root * math.sqrt(root)
            if undoes:
                factor = 1.0 / factor
        moved[i, 0] = numbers[5] + factor * (x - numbers[5])
        moved[i, 1] = height
        moved[i, 2] = numbers[6] + factor * (z - numbers[6])
