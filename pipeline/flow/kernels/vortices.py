"""Rotation about a line, by a profile over the distance from it; a vortex ring; and turbulence.

Turbulence is the curl of a potential of gradient noise, with exact derivatives.
"""

from __future__ import annotations

import math
from typing import Any

from numba import uint64

from pipeline.arrays import Floats
from pipeline.flow.kernels.instructions import EQUATION, VORTICES, Velocity
from pipeline.kernels import block_kernel, kernel

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


Nine = tuple[float, float, float, float, float, float, float, float, float]

_X, _Y, _Z = uint64(0x9E3779B97F4A7C15), uint64(0xC2B2AE3D27D4EB4F), uint64(0x165667B19E3779F9)
_MOMENT, _OCTAVE = uint64(0xD6E8FEB86659FD93), uint64(0xA0761D6478BD642F)
_FIRST, _SECOND = uint64(0xBF58476D1CE4E5B9), uint64(0x94D049BB133111EB)
_LAST = uint64(127)


@kernel("u8(u8)", forceinline=True)
def hash_bits(h: Any) -> Any:
    """Return bits that each depend on all bits of `h` (finaliser of splitmix64: Steele, Lea & Flood 2014)."""
    h = (h ^ (h >> uint64(30))) * _FIRST
    h = (h ^ (h >> uint64(27))) * _SECOND
    return h ^ (h >> uint64(31))


@kernel("f8(f8)", forceinline=True)
def fade(s: float) -> float:
    """Return the fade at s, from 0 to 1 with three derivatives zero at the ends.

    Perlin's quintic (*Improving Noise*, 2002) has two: the velocity gradient would have kinks, at which a
    Runge-Kutta step of order 4 falls to order 3.
    """
    return s * s * s * s * (35.0 - s * (84.0 - s * (70.0 - s * 20.0)))


@kernel("f8(f8)", forceinline=True)
def fade_slope(s: float) -> float:
    """Return the derivative of `fade`."""
    r = s * (1.0 - s)
    return 140.0 * r * r * r


@kernel("f8(u8, u8, u8, f8, f8)", forceinline=True)
def component(h: int, k: int, shift: int, before: float, after: float) -> float:
    """Return a component, −63.5 to 63.5, from seven bits of each hash, rotated from one to the other."""
    return before * (float((h >> shift) & _LAST) - 63.5) + after * (float((k >> shift) & _LAST) - 63.5)


@kernel("UniTuple(f8, 9)(u8, u8, u8, f8, f8)", forceinline=True)
def gradients(corner: int, now: int, next_draw: int, before: float, after: float) -> Nine:
    """Return the gradients of three potentials at a lattice corner, at a time between two random draws."""
    h, k = hash_bits(corner ^ now), hash_bits(corner ^ next_draw)
    return (
        component(h, k, uint64(0), before, after),
        component(h, k, uint64(7), before, after),
        component(h, k, uint64(14), before, after),
        component(h, k, uint64(21), before, after),
        component(h, k, uint64(28), before, after),
        component(h, k, uint64(35), before, after),
        component(h, k, uint64(42), before, after),
        component(h, k, uint64(49), before, after),
        component(h, k, uint64(56), before, after),
    )


@kernel("UniTuple(f8, 3)(u8, u8, f8, f8, f8, f8, f8)", forceinline=True)
def curl(
    now: int, next_draw: int, before: float, after: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Return the curl of three noises at a point, in lattice units.

    A noise is the sum over the corners c of its cell of weight(x − c) · gradient(c) · (x − c); this is its
    derivative, term by term.
    """
    fx, fy, fz = math.floor(x), math.floor(y), math.floor(z)
    dx, dy, dz = x - fx, y - fy, z - fz
    hx, hy, hz = uint64(int(fx)) * _X, uint64(int(fy)) * _Y, uint64(int(fz)) * _Z
    sx, sy, sz = fade(dx), fade(dy), fade(dz)
    ex, ey, ez = fade_slope(dx), fade_slope(dy), fade_slope(dz)
    u, v, w = 0.0, 0.0, 0.0
    for corner in range(8):
        i, j, k = corner & 1, (corner >> 1) & 1, corner >> 2
        lattice = (hx + uint64(i) * _X) ^ (hy + uint64(j) * _Y) ^ (hz + uint64(k) * _Z)
        ax, ay, az, bx, by, bz, cx, cy, cz = gradients(lattice, now, next_draw, before, after)
        rx, ry, rz = dx - i, dy - j, dz - k
        wx, gx = (sx, ex) if i else (1.0 - sx, -ex)
        wy, gy = (sy, ey) if j else (1.0 - sy, -ey)
        wz, gz = (sz, ez) if k else (1.0 - sz, -ez)
        weight = wx * wy * wz
        gx, gy, gz = gx * wy * wz, wx * gy * wz, wx * wy * gz
        a = ax * rx + ay * ry + az * rz
        b = bx * rx + by * ry + bz * rz
        c = cx * rx + cy * ry + cz * rz
        u += gy * c + weight * cy - gz * b - weight * bz
        v += gz * a + weight * az - gx * c - weight * cx
        w += gx * b + weight * bx - gy * a - weight * ay
    return u, v, w


@block_kernel
def curl_noise(
    numbers: Floats, count: int, x: Floats, y: Floats, z: Floats, t: float, u: Floats, v: Floats, w: Floats
) -> None:
    """Numbers: frequency 0 and speed 1 of the first octave, octaves 2, the factors on both per octave 3 4,
    seed 5, age 6 (a new random draw at whole numbers).
    """
    frequency, speed, moment = numbers[0], numbers[1], math.floor(numbers[6])
    quarter = 0.5 * math.pi * fade(numbers[6] - moment)
    before, after = math.cos(quarter), math.sin(quarter)
    for octave in range(int(numbers[2])):
        seed = hash_bits(uint64(int(numbers[5])) + uint64(octave) * _OCTAVE)
        now, next_draw = seed ^ (uint64(int(moment)) * _MOMENT), seed ^ (uint64(int(moment) + 1) * _MOMENT)
        for i in range(count):
            du, dv, dw = curl(
                now, next_draw, before, after, frequency * x[i], frequency * y[i], frequency * z[i]
            )
            u[i] += speed * du
            v[i] += speed * dv
            w[i] += speed * dw
        frequency *= numbers[3]
        speed *= numbers[4]
