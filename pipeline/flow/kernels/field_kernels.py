"""Equations of velocity fields: linear, expansion, attractors, cells; and the choice of one by its opcode.

Opcodes stand in stored keys: a family's numbers never change. The equations of vortices are in `vortices`.
"""

from __future__ import annotations

import math

import numpy as np

from pipeline.arrays import Floats
from pipeline.flow.kernels import vortex_kernels as vortices
from pipeline.flow.kernels.instructions import (
    ATTRACTORS,
    CELLULAR,
    EQUATION,
    EXPANSION,
    FIELD,
    LINEAR,
    Velocity,
    add_each,
)
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


LORENZ, ROSSLER, AIZAWA, THOMAS, CHUA, HALVORSEN, CHEN = range(ATTRACTORS, ATTRACTORS + 7)
"""Strange attractors, upright: in their own coordinates z is our y (up), and y our −z.

All rows begin alike: origin 0:3, the point where the attractor's own coordinates are zero; scale 3, its units
per unit of ours; time scale / scale 4; then its own parameters from 5 on.
"""


@kernel("UniTuple(f8, 3)(f8[::1], i8, f8, f8, f8)", forceinline=True)
def to_own_axes(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Return a point in the attractor's coordinates."""
    scale = p[o + 3]
    return scale * (x - p[o]), -scale * (z - p[o + 2]), scale * (y - p[o + 1])


@kernel("UniTuple(f8, 3)(f8[::1], i8, f8, f8, f8)", forceinline=True)
def to_scene_axes(p: Floats, o: int, u: float, v: float, w: float) -> Velocity:
    """Return a velocity of the attractor's coordinates in those of the scene."""
    speed = p[o + 4]
    return speed * u, speed * w, -speed * v


@kernel(EQUATION, forceinline=True)
def lorenz(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: sigma 5, rho 6, beta 7."""
    x, y, z = to_own_axes(p, o, x, y, z)
    return to_scene_axes(p, o, p[o + 5] * (y - x), x * (p[o + 6] - z) - y, x * y - p[o + 7] * z)


@kernel(EQUATION, forceinline=True)
def rossler(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: a 5, b 6, c 7."""
    x, y, z = to_own_axes(p, o, x, y, z)
    return to_scene_axes(p, o, -y - z, x + p[o + 5] * y, p[o + 6] + z * (x - p[o + 7]))


@kernel(EQUATION, forceinline=True)
def aizawa(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: a 5, b 6, c 7, d 8, e 9, f 10."""
    x, y, z = to_own_axes(p, o, x, y, z)
    u = (z - p[o + 6]) * x - p[o + 8] * y
    v = p[o + 8] * x + (z - p[o + 6]) * y
    w = p[o + 7] + p[o + 5] * z - z * z * z / 3.0
    w += p[o + 10] * z * x * x * x - (x * x + y * y) * (1.0 + p[o + 9] * z)
    return to_scene_axes(p, o, u, v, w)


@kernel(EQUATION, forceinline=True)
def thomas(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: b 5."""
    x, y, z = to_own_axes(p, o, x, y, z)
    b = p[o + 5]
    return to_scene_axes(p, o, math.sin(y) - b * x, math.sin(z) - b * y, math.sin(x) - b * z)


@kernel(EQUATION, forceinline=True)
def chua(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: alpha 5, beta 6, c 7."""
    x, y, z = to_own_axes(p, o, x, y, z)
    return to_scene_axes(p, o, p[o + 5] * (y - x * x * x - p[o + 7] * x), x - y + z, -p[o + 6] * y)


@kernel(EQUATION, forceinline=True)
def halvorsen(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: a 5."""
    x, y, z = to_own_axes(p, o, x, y, z)
    a = p[o + 5]
    u = -a * x - 4.0 * (y + z) - y * y
    v = -a * y - 4.0 * (z + x) - z * z
    return to_scene_axes(p, o, u, v, -a * z - 4.0 * (x + y) - x * x)


@kernel(EQUATION, forceinline=True)
def chen(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: a 5, b 6, c 7."""
    x, y, z = to_own_axes(p, o, x, y, z)
    a, c = p[o + 5], p[o + 7]
    return to_scene_axes(p, o, a * (y - x), (c - a) * x - x * z + c * y, x * y - p[o + 6] * z)


ENRIGHT, ABC, TAYLOR_GREEN, DOUBLE_GYRE, KNEADING = range(CELLULAR, CELLULAR + 5)
"""Flows in cells that repeat: waves of velocity along one axis that vary along another."""


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
def add_field(opcode: int, p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Add the velocity of one field, whose row begins at p[o], to n points of the level at s[b]."""
    if opcode == TRANSLATION:
        add_each(translation, p, o, n, s, b)
    elif opcode == ROTATION:
        add_each(rotation, p, o, n, s, b)
    elif opcode == SCALING:
        add_each(scaling, p, o, n, s, b)
    elif opcode == STRAIN:
        add_each(strain, p, o, n, s, b)
    elif opcode == vortices.LAMB_OSEEN:
        add_each(vortices.lamb_oseen, p, o, n, s, b)
    elif opcode == vortices.GAUSSIAN:
        add_each(vortices.gaussian, p, o, n, s, b)
    elif opcode == vortices.RANKINE:
        add_each(vortices.rankine, p, o, n, s, b)
    elif opcode == vortices.RING:
        add_each(vortices.ring, p, o, n, s, b)
    elif opcode == BALL:
        add_each(ball, p, o, n, s, b)
    elif opcode == DISC:
        add_each(disc, p, o, n, s, b)
    elif opcode == SOURCE:
        add_each(source, p, o, n, s, b)
    elif opcode == SQUEEZE:
        add_each(squeeze, p, o, n, s, b)
    elif opcode == LORENZ:
        add_each(lorenz, p, o, n, s, b)
    elif opcode == ROSSLER:
        add_each(rossler, p, o, n, s, b)
    elif opcode == AIZAWA:
        add_each(aizawa, p, o, n, s, b)
    elif opcode == THOMAS:
        add_each(thomas, p, o, n, s, b)
    elif opcode == CHUA:
        add_each(chua, p, o, n, s, b)
    elif opcode == HALVORSEN:
        add_each(halvorsen, p, o, n, s, b)
    elif opcode == CHEN:
        add_each(chen, p, o, n, s, b)
    elif opcode == ENRIGHT:
        add_each(enright, p, o, n, s, b)
    elif opcode == ABC:
        add_each(abc, p, o, n, s, b)
    elif opcode == TAYLOR_GREEN:
        add_each(taylor_green, p, o, n, s, b)
    elif opcode == DOUBLE_GYRE:
        add_each(double_gyre, p, o, n, s, b)
    elif opcode == KNEADING:
        add_each(kneading, p, o, n, s, b)
