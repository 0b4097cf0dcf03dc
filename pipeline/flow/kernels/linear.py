"""Uniform velocities, and those that grow in proportion to the distance."""

from __future__ import annotations

from pipeline.arrays import Floats
from pipeline.flow.kernels.block import EQUATION, FIELD, Velocity, add_each
from pipeline.flow.kernels.opcodes import LINEAR
from pipeline.kernels import kernel

TRANSLATION, ROTATION, SCALING, STRAIN = range(LINEAR, LINEAR + 4)


@kernel(EQUATION, forceinline=True)
def translation(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: velocity 0:3."""
    return p[o], p[o + 1], p[o + 2]


@kernel(EQUATION, forceinline=True)
def rotation(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, unit axis 3:6, angular speed 6."""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    ax, ay, az, speed = p[o + 3], p[o + 4], p[o + 5], p[o + 6]
    return speed * (ay * rz - az * ry), speed * (az * rx - ax * rz), speed * (ax * ry - ay * rx)


@kernel(EQUATION, forceinline=True)
def strain(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, unit axis 3:6, rate along it 6, rate across it 7."""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    ax, ay, az, across = p[o + 3], p[o + 4], p[o + 5], p[o + 7]
    more = (p[o + 6] - across) * (ax * rx + ay * ry + az * rz)
    return across * rx + more * ax, across * ry + more * ay, across * rz + more * az


@kernel(EQUATION, forceinline=True)
def scaling(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, rates 3:6."""
    return p[o + 3] * (x - p[o]), p[o + 4] * (y - p[o + 1]), p[o + 5] * (z - p[o + 2])


@kernel(FIELD)
def add_linear(opcode: int, p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Add the velocity of one field of this family to n points of the level at s[b]."""
    if opcode == TRANSLATION:
        add_each(translation, p, o, n, s, b)
    elif opcode == ROTATION:
        add_each(rotation, p, o, n, s, b)
    elif opcode == SCALING:
        add_each(scaling, p, o, n, s, b)
    elif opcode == STRAIN:
        add_each(strain, p, o, n, s, b)
