"""Strange attractors, upright: in their own coordinates z is our y (up), and y our −z.

All rows begin alike: origin 0:3, the point where the attractor's own coordinates are zero; scale 3, its units
per unit of ours; time scale / scale 4; then its own parameters from 5 on.
"""

from __future__ import annotations

import math

from pipeline.arrays import Floats
from pipeline.flow.kernels.instructions import ATTRACTORS, EQUATION, FIELD, Velocity, add_each
from pipeline.kernels import kernel

LORENZ, ROSSLER, AIZAWA, THOMAS, CHUA, HALVORSEN, CHEN = range(ATTRACTORS, ATTRACTORS + 7)


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


@kernel(FIELD)
def add_attractors(opcode: int, p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Add the velocity of one field of this family to n points of the level at s[b]."""
    if opcode == LORENZ:
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
