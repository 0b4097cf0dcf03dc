"""Uniform velocities, linear ones (proportional to the distance), expansion, sources and squeezing."""

from __future__ import annotations

import math

from pipeline.arrays import Floats
from pipeline.flow.kernels.instructions import EQUATION, EXPANSION, FIELD, LINEAR, Velocity, add_each
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


BALL, DISC, SOURCE, SQUEEZE = range(EXPANSION, EXPANSION + 4)


@kernel(EQUATION, forceinline=True)
def ball(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, -, 1 / radius² 6, rate 7."""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    inside = max(0.0, 1.0 - (rx * rx + ry * ry + rz * rz) * p[o + 6])
    rate = p[o + 7] * inside * inside
    return rate * rx, rate * ry, rate * rz


@kernel(EQUATION, forceinline=True)
def disc(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, unit axis 3:6, 1 / radius² 6, rate 7."""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    along = p[o + 3] * rx + p[o + 4] * ry + p[o + 5] * rz
    qx, qy, qz = rx - along * p[o + 3], ry - along * p[o + 4], rz - along * p[o + 5]
    inside = max(0.0, 1.0 - (qx * qx + qy * qy + qz * qz) * p[o + 6])
    rate = p[o + 7] * inside * inside
    return rate * qx, rate * qy, rate * qz


@kernel(EQUATION, forceinline=True)
def source(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, core² 3, flux / 4π 4."""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    distance2 = rx * rx + ry * ry + rz * rz + p[o + 3]
    rate = p[o + 4] / (distance2 * math.sqrt(distance2))
    return rate * rx, rate * ry, rate * rz


@kernel(EQUATION, forceinline=True)
def squeeze(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, unit axis 3:6, 1 / length² 6, 1 / radius² 7, rate 8."""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    ax, ay, az = p[o + 3], p[o + 4], p[o + 5]
    height = ax * rx + ay * ry + az * rz
    qx, qy, qz = rx - height * ax, ry - height * ay, rz - height * az
    high, wide = height * height * p[o + 6], (qx * qx + qy * qy + qz * qz) * p[o + 7]
    rate = p[o + 8] * math.exp(-high - wide)
    along, across = rate * height * (1.0 - wide), -0.5 * rate * (1.0 - 2.0 * high)
    return along * ax + across * qx, along * ay + across * qy, along * az + across * qz


@kernel(FIELD)
def add_expansion(opcode: int, p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Add the velocity of one field of this family to n points of the level at s[b]."""
    if opcode == BALL:
        add_each(ball, p, o, n, s, b)
    elif opcode == DISC:
        add_each(disc, p, o, n, s, b)
    elif opcode == SOURCE:
        add_each(source, p, o, n, s, b)
    elif opcode == SQUEEZE:
        add_each(squeeze, p, o, n, s, b)
