"""The deformation that tracked surfaces are compared by."""

from __future__ import annotations

import math

from pipeline.arrays import Floats
from pipeline.flow import _kernels_opcodes as op
from pipeline.flow._kernels_block import EQUATION, LEAVES, Velocity, add_each
from pipeline.kernels import kernel


@kernel(EQUATION, forceinline=True)
def enright(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """centre 0:3, side 3, factor 4"""
    speed, half = p[o + 3] * p[o + 4], math.pi / p[o + 3]
    ax = half * (x - p[o]) + 0.5 * math.pi
    ay = half * (y - p[o + 1]) + 0.5 * math.pi
    az = half * (z - p[o + 2]) + 0.5 * math.pi
    fx, fy, fz = math.sin(2.0 * ax), math.sin(2.0 * ay), math.sin(2.0 * az)
    sx, sy, sz = math.sin(ax) ** 2, math.sin(ay) ** 2, math.sin(az) ** 2
    return 2.0 * speed * sx * fy * fz, -speed * fx * sy * fz, -speed * fx * fy * sz


@kernel(LEAVES)
def cells(kind: int, p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Add the field of an opcode to n points of the level at s[b]."""
    if kind == op.ENRIGHT:
        add_each(enright, p, o, n, s, b)
