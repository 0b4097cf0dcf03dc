"""A vortex bent to a circle, by complete elliptic integrals."""

from __future__ import annotations

import math

from pipeline.arrays import Floats
from pipeline.flow._kernels_block import EQUATION, Velocity
from pipeline.kernels import kernel

ROUNDS = 7
"""Of the arithmetic-geometric mean: full precision down to a core of a millionth of the ring's radius."""


@kernel("UniTuple(f8, 3)(f8, f8)", forceinline=True)
def elliptic(m: float, root: float) -> tuple[float, float, float]:
    """K(m), 1 − E(m)/K(m) and (1 − E/K − m/2) / m² of the complete elliptic integrals; root is √(1 − m).

    All sums are of one sign, so that no digits are lost.

    Source: Abramowitz & Stegun (1964), 17.6.3 and 17.6.4.
    """
    mean, other, gap = 0.5 * (1.0 + root), math.sqrt(root), 0.5 / (1.0 + root)  # gap: of the means, by m
    tail, power = gap * gap, 1.0
    for _ in range(ROUNDS - 1):
        following = 0.5 * (mean + other)
        gap *= gap * m / (4.0 * following)
        other = math.sqrt(mean * other)
        mean = following
        power *= 2.0
        tail += power * gap * gap
    return 0.5 * math.pi / mean, 0.5 * m + m * m * tail, tail


@kernel(EQUATION, forceinline=True)
def ring(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """centre 0:3, unit axis 3:6, radius 6, core² 7, circulation / 2π 8"""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    ax, ay, az, radius = p[o + 3], p[o + 4], p[o + 5], p[o + 6]
    height = ax * rx + ay * ry + az * rz
    qx, qy, qz = rx - height * ax, ry - height * ay, rz - height * az
    away2 = qx * qx + qy * qy + qz * qz
    away = math.sqrt(away2)
    deep2, radius2 = height * height + p[o + 7], radius * radius
    far2, near2 = (radius + away) ** 2 + deep2, (radius - away) ** 2 + deep2
    m = 4.0 * radius * away / far2
    first, lack, tail = elliptic(m, math.sqrt(near2 / far2))
    speed = p[o + 8] * first / math.sqrt(far2)
    along = speed * (1.0 + (radius2 - away2 - deep2) / near2 * (1.0 - lack))
    # away from the axis, by the distance from it: 16 R² / far⁴ stands for m² / distance²
    spread = speed * height * 16.0 * radius2 / (far2 * near2) * (0.25 - tail * (1.0 - 0.5 * m))
    return along * ax + spread * qx, along * ay + spread * qy, along * az + spread * qz
