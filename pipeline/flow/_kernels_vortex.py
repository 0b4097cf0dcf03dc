"""Turning about a line, by a profile of the distance from it."""

from __future__ import annotations

import math

from pipeline.arrays import Floats
from pipeline.flow import _kernels_opcodes as op
from pipeline.flow._kernels_block import EQUATION, LEAVES, Velocity, add_each
from pipeline.flow._kernels_ring import ring
from pipeline.kernels import kernel


@kernel("UniTuple(f8, 4)(f8[::1], i8, f8, f8, f8)", forceinline=True)
def about_axis(p: Floats, o: int, x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """axis × r and the squared distance from the axis: centre 0:3, unit axis 3:6."""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    ax, ay, az = p[o + 3], p[o + 4], p[o + 5]
    cx, cy, cz = ay * rz - az * ry, az * rx - ax * rz, ax * ry - ay * rx
    return cx, cy, cz, cx * cx + cy * cy + cz * cz


@kernel(EQUATION, forceinline=True)
def lamb_oseen(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """centre 0:3, unit axis 3:6, 1 / radius² 6, angular speed on the axis 7"""
    cx, cy, cz, distance2 = about_axis(p, o, x, y, z)
    ratio, spin = distance2 * p[o + 6], p[o + 7]
    if ratio > 0.02:
        spin *= (1.0 - math.exp(-ratio)) / ratio
    else:  # the same as a series, where the difference would lose digits
        spin *= 1.0 - ratio / 2.0 * (1.0 - ratio / 3.0 * (1.0 - ratio / 4.0 * (1.0 - ratio / 5.0)))
    return spin * cx, spin * cy, spin * cz


@kernel(EQUATION, forceinline=True)
def gaussian(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """the same"""
    cx, cy, cz, distance2 = about_axis(p, o, x, y, z)
    spin = p[o + 7] * math.exp(-distance2 * p[o + 6])
    return spin * cx, spin * cy, spin * cz


@kernel(EQUATION, forceinline=True)
def rankine(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """the same"""
    cx, cy, cz, distance2 = about_axis(p, o, x, y, z)
    spin = p[o + 7] / max(1.0, distance2 * p[o + 6])
    return spin * cx, spin * cy, spin * cz


@kernel(LEAVES)
def vortices(kind: int, p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Add the field of an opcode to n points of the level at s[b]."""
    if kind == op.LAMB_OSEEN:
        add_each(lamb_oseen, p, o, n, s, b)
    elif kind == op.GAUSSIAN:
        add_each(gaussian, p, o, n, s, b)
    elif kind == op.RANKINE:
        add_each(rankine, p, o, n, s, b)
    elif kind == op.RING:
        add_each(ring, p, o, n, s, b)
