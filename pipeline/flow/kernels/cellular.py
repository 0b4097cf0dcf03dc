"""Flows in cells that repeat: waves of velocity along one axis that vary along another."""

from __future__ import annotations

import math

import numpy as np

from pipeline.arrays import Floats
from pipeline.flow.kernels.instructions import CELLULAR, EQUATION, FIELD, Velocity, add_each
from pipeline.kernels import kernel

ENRIGHT, ABC, TAYLOR_GREEN, DOUBLE_GYRE, KNEADING = range(CELLULAR, CELLULAR + 5)


@kernel(EQUATION, forceinline=True)
def enright(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, side 3, factor 4."""
    speed, half = p[o + 3] * p[o + 4], math.pi / p[o + 3]
    ax = half * (x - p[o]) + 0.5 * math.pi
    ay = half * (y - p[o + 1]) + 0.5 * math.pi
    az = half * (z - p[o + 2]) + 0.5 * math.pi
    fx, fy, fz = math.sin(2.0 * ax), math.sin(2.0 * ay), math.sin(2.0 * az)
    sx, sy, sz = math.sin(ax) ** 2, math.sin(ay) ** 2, math.sin(az) ** 2
    return 2.0 * speed * sx * fy * fz, -speed * fx * sy * fz, -speed * fx * fy * sz


@kernel(EQUATION, forceinline=True)
def abc(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, wave number 3, a 4, b 5, c 6."""
    kx, ky, kz = p[o + 3] * (x - p[o]), p[o + 3] * (y - p[o + 1]), p[o + 3] * (z - p[o + 2])
    a, b, c = p[o + 4], p[o + 5], p[o + 6]
    return (
        a * math.sin(kz) + c * math.cos(ky),
        b * math.sin(kx) + a * math.cos(kz),
        c * math.sin(ky) + b * math.cos(kx),
    )


@kernel(EQUATION, forceinline=True)
def taylor_green(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, wave number 3, speed 4."""
    kx, ky, kz = p[o + 3] * (x - p[o]), p[o + 3] * (y - p[o + 1]), p[o + 3] * (z - p[o + 2])
    speed = p[o + 4] * math.cos(kz)
    return speed * math.sin(kx) * math.cos(ky), -speed * math.cos(kx) * math.sin(ky), 0.0


@kernel(EQUATION, forceinline=True)
def double_gyre(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, 1 / height 3, π · speed 4, swing 5."""
    across, py, swing = p[o + 3] * (x - p[o]) + 1.0, p[o + 3] * (y - p[o + 1]) + 0.5, p[o + 5]
    across -= 4.0 * np.floor(0.25 * across)
    mirrored = across > 2.0
    px = 3.0 - across if mirrored else across - 1.0
    bent, slope = px + swing * (px * px - 1.0) + 1.0, 1.0 + 2.0 * swing * px
    u = -p[o + 4] * math.sin(math.pi * bent) * math.cos(math.pi * py)
    v = p[o + 4] * math.cos(math.pi * bent) * math.sin(math.pi * py) * slope
    return (-u if mirrored else u), v, 0.0


@kernel(EQUATION, forceinline=True)
def kneading(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, wave number 3, speeds 4:7."""
    kx, ky, kz = p[o + 3] * (x - p[o]), p[o + 3] * (y - p[o + 1]), p[o + 3] * (z - p[o + 2])
    return p[o + 4] * math.sin(ky), p[o + 5] * math.sin(kz), p[o + 6] * math.sin(kx)


@kernel(FIELD)
def add_cellular(opcode: int, p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Add the velocity of one field of this family to n points of the level at s[b]."""
    if opcode == ENRIGHT:
        add_each(enright, p, o, n, s, b)
    elif opcode == ABC:
        add_each(abc, p, o, n, s, b)
    elif opcode == TAYLOR_GREEN:
        add_each(taylor_green, p, o, n, s, b)
    elif opcode == DOUBLE_GYRE:
        add_each(double_gyre, p, o, n, s, b)
    elif opcode == KNEADING:
        add_each(kneading, p, o, n, s, b)
