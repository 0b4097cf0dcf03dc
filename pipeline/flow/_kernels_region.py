"""How much a point belongs to a region: 1 inside, 0 from `falloff` outside on, and a smooth way between.

The way is 1 − 6t⁵ + 15t⁴ − 10t³ of the distance t in falloffs (Perlin, *Improving Noise*, SIGGRAPH 2002), so
that velocities have continuous second derivatives; nowhere is it steeper than 1.875 / falloff. Without a
falloff the region ends at once.
"""

from __future__ import annotations

import math

from pipeline.arrays import Floats, Points
from pipeline.flow._kernels_opcodes import CLOSE_BALL, CLOSE_BOX
from pipeline.kernels import kernel

WEIGHT = "f8(f8[::1], i8, f8, f8, f8)"
"""(numbers, where the row begins among them, x, y, z) -> the weight there."""


@kernel("f8(f8, f8)", forceinline=True)
def fall(distance: float, falloff: float) -> float:
    """The weight at a distance from the region, which is nought or less inside."""
    t = min(max(distance, 0.0) / max(falloff, 1e-300), 1.0)
    return 1.0 - t * t * t * (10.0 + t * (6.0 * t - 15.0))


@kernel(WEIGHT, forceinline=True)
def ball_weight(p: Floats, o: int, x: float, y: float, z: float) -> float:
    """centre 0:3, radius 3, falloff 6"""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    return fall(math.sqrt(rx * rx + ry * ry + rz * rz) - p[o + 3], p[o + 6])


@kernel(WEIGHT, forceinline=True)
def box_weight(p: Floats, o: int, x: float, y: float, z: float) -> float:
    """centre 0:3, half its sides 3:6, falloff 6"""
    dx = max(abs(x - p[o]) - p[o + 3], 0.0)
    dy = max(abs(y - p[o + 1]) - p[o + 4], 0.0)
    dz = max(abs(z - p[o + 2]) - p[o + 5], 0.0)
    return fall(math.sqrt(dx * dx + dy * dy + dz * dz), p[o + 6])


@kernel(WEIGHT, forceinline=True)
def half_space_weight(p: Floats, o: int, x: float, y: float, z: float) -> float:
    """point on the plane 0:3, unit normal outwards 3:6, falloff 6"""
    height = p[o + 3] * (x - p[o]) + p[o + 4] * (y - p[o + 1]) + p[o + 5] * (z - p[o + 2])
    return fall(height, p[o + 6])


@kernel("void(f8[:, ::1], i8, f8[::1], f8[::1])")
def weights(points: Points, kind: int, row: Floats, out: Floats) -> None:
    """Weights (N,) at points (N, 3), for maps: `kind` is the opcode that closes a group by that region, and
    `row` its numbers."""
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if kind == CLOSE_BALL:
            out[i] = ball_weight(row, 0, x, y, z)
        elif kind == CLOSE_BOX:
            out[i] = box_weight(row, 0, x, y, z)
        else:
            out[i] = half_space_weight(row, 0, x, y, z)
