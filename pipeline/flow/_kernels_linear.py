"""Velocities that grow in proportion to the distance, or not at all."""

from __future__ import annotations

from pipeline.arrays import Floats
from pipeline.flow import _kernels_opcodes as op
from pipeline.flow._kernels_block import EQUATION, LEAVES, Velocity, add_each
from pipeline.kernels import kernel


@kernel(EQUATION, forceinline=True)
def translation(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """velocity 0:3"""
    return p[o], p[o + 1], p[o + 2]


@kernel(EQUATION, forceinline=True)
def rotation(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """centre 0:3, unit axis 3:6, angular speed 6"""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    ax, ay, az, speed = p[o + 3], p[o + 4], p[o + 5], p[o + 6]
    return speed * (ay * rz - az * ry), speed * (az * rx - ax * rz), speed * (ax * ry - ay * rx)


@kernel(EQUATION, forceinline=True)
def strain(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """centre 0:3, unit axis 3:6, rate along it 6, rate across it 7"""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    ax, ay, az, across = p[o + 3], p[o + 4], p[o + 5], p[o + 7]
    more = (p[o + 6] - across) * (ax * rx + ay * ry + az * rz)
    return across * rx + more * ax, across * ry + more * ay, across * rz + more * az


@kernel(EQUATION, forceinline=True)
def scaling(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """centre 0:3, rates 3:6"""
    return p[o + 3] * (x - p[o]), p[o + 4] * (y - p[o + 1]), p[o + 5] * (z - p[o + 2])


@kernel(LEAVES)
def linear(kind: int, p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Add the field of an opcode to n points of the level at s[b]."""
    if kind == op.TRANSLATION:
        add_each(translation, p, o, n, s, b)
    elif kind == op.ROTATION:
        add_each(rotation, p, o, n, s, b)
    elif kind == op.SCALING:
        add_each(scaling, p, o, n, s, b)
    elif kind == op.STRAIN:
        add_each(strain, p, o, n, s, b)
