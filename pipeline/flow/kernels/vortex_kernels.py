"""Rotation about a line, by a profile over the distance from it; and a vortex ring."""

from __future__ import annotations

import math

from pipeline.arrays import Floats
from pipeline.flow.kernels.instructions import EQUATION, VORTICES, Velocity
from pipeline.kernels import kernel

LAMB_OSEEN, GAUSSIAN, RANKINE, RING = range(VORTICES, VORTICES + 4)


@kernel("UniTuple(f8, 4)(f8[::1], i8, f8, f8, f8)", forceinline=True)
def about_axis(p: Floats, o: int, x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Return axis × r and the squared distance from the axis. Numbers: centre 0:3, unit axis 3:6."""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    ax, ay, az = p[o + 3], p[o + 4], p[o + 5]
    cx, cy, cz = ay * rz - az * ry, az * rx - ax * rz, ax * ry - ay * rx
    return cx, cy, cz, cx * cx + cy * cy + cz * cz


@kernel(EQUATION, forceinline=True)
def lamb_oseen(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, unit axis 3:6, 1 / radius² 6, angular speed on the axis 7."""
    cx, cy, cz, distance2 = about_axis(p, o, x, y, z)
    ratio, spin = distance2 * p[o + 6], p[o + 7]
    if ratio > 0.02:
        spin *= (1.0 - math.exp(-ratio)) / ratio
    else:  # its series, where the difference would lose digits
        spin *= 1.0 - ratio / 2.0 * (1.0 - ratio / 3.0 * (1.0 - ratio / 4.0 * (1.0 - ratio / 5.0)))
    return spin * cx, spin * cy, spin * cz


@kernel(EQUATION, forceinline=True)
def gaussian(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, unit axis 3:6, 1 / radius² 6, angular speed on the axis 7."""
    cx, cy, cz, distance2 = about_axis(p, o, x, y, z)
    spin = p[o + 7] * math.exp(-distance2 * p[o + 6])
    return spin * cx, spin * cy, spin * cz


@kernel(EQUATION, forceinline=True)
def rankine(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, unit axis 3:6, 1 / radius² 6, angular speed on the axis 7."""
    cx, cy, cz, distance2 = about_axis(p, o, x, y, z)
    spin = p[o + 7] / max(1.0, distance2 * p[o + 6])
    return spin * cx, spin * cy, spin * cz


ROUNDS = 7
"""Rounds of the arithmetic-geometric mean: full precision down to a core of 1e-6 of the ring's radius."""


@kernel("UniTuple(f8, 3)(f8, f8)", forceinline=True)
def elliptic(m: float, root: float) -> tuple[float, float, float]:
    """Return K(m), 1 − E(m)/K(m) and (1 − E/K − m/2) / m²; root is √(1 − m).

    K and E are the complete elliptic integrals. All sums are of one sign, so that no digits are lost.

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
    """Numbers: centre 0:3, unit axis 3:6, radius 6, core² 7, circulation / 2π 8."""
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
