"""Velocities, and the classical Runge-Kutta method along them: one step a frame, forwards or backwards."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar, cast

import numba
import numpy as np

from flowsculpt.pipeline.arrays import Points

F = TypeVar("F", bound=Callable[..., object])

Follow = Callable[[Points, int, int], Points]
"""(points (N, 3), from frame, to frame) -> their positions at the second frame."""

Velocity = Callable[[float, float, float, float], tuple[float, float, float]]
"""(x, y, z, t) -> velocity, in scene units per second."""


def compiled(function: F) -> F:
    """Compile with numba for this process only."""
    return cast(F, numba.njit(function))


@compiled
def stir(x: float, y: float, z: float, t: float) -> tuple[float, float, float]:
    """Two counter-rotating Gaussian vortices about z and a twist about y; free of divergence."""
    one = 4.0 * math.exp(-((x - 0.9) ** 2 + y * y) / 0.64)
    two = -4.0 * math.exp(-((x + 0.9) ** 2 + y * y) / 0.64)
    return 1.2 * y * z - (one + two) * y, one * (x - 0.9) + two * (x + 0.9), -1.2 * y * x


@compiled
def lorenz(x: float, y: float, z: float, t: float) -> tuple[float, float, float]:
    """Lorenz's velocity with σ = 10, ρ = 28, β = 8/3."""
    return 10.0 * (y - x), x * (28.0 - z) - y, x * y - 8.0 / 3.0 * z


@compiled
def enright(x: float, y: float, z: float, t: float) -> tuple[float, float, float]:
    """LeVeque's velocity (1996), with a period of 3."""
    fade, pi = math.cos(math.pi * t / 3.0), math.pi
    u, v, w = math.sin(2 * pi * x), math.sin(2 * pi * y), math.sin(2 * pi * z)
    return (
        2.0 * math.sin(pi * x) ** 2 * v * w * fade,
        -u * math.sin(pi * y) ** 2 * w * fade,
        -u * v * math.sin(pi * z) ** 2 * fade,
    )


@compiled
def abc(x: float, y: float, z: float, t: float) -> tuple[float, float, float]:
    """The ABC flow with period 4 along each axis, and speeds as in `pipeline/flow/catalogue/basic.py`."""
    k, a, b, c = math.pi / 2, 1.0, math.sqrt(2.0 / 3.0), math.sqrt(1.0 / 3.0)
    x, y, z = k * x, k * y, k * z
    return (
        a * math.sin(z) + c * math.cos(y),
        b * math.sin(x) + a * math.cos(z),
        c * math.sin(y) + b * math.cos(x),
    )


def following(velocity: Velocity, seconds: float) -> Follow:
    """Return the flow of a velocity over frames of so many seconds."""

    @compiled
    def trace(points: Points, time: float, h: float, steps: int, out: Points) -> None:
        for i in range(len(points)):
            x, y, z, t = points[i, 0], points[i, 1], points[i, 2], time
            for _ in range(steps):
                ax, ay, az = velocity(x, y, z, t)
                bx, by, bz = velocity(x + h / 2 * ax, y + h / 2 * ay, z + h / 2 * az, t + h / 2)
                cx, cy, cz = velocity(x + h / 2 * bx, y + h / 2 * by, z + h / 2 * bz, t + h / 2)
                dx, dy, dz = velocity(x + h * cx, y + h * cy, z + h * cz, t + h)
                x += h / 6 * (ax + 2 * bx + 2 * cx + dx)
                y += h / 6 * (ay + 2 * by + 2 * cy + dy)
                z += h / 6 * (az + 2 * bz + 2 * cz + dz)
                t += h
            out[i, 0], out[i, 1], out[i, 2] = x, y, z

    def follow(points: Points, start: int, end: int) -> Points:
        out = np.empty((len(points), 3))
        step = seconds if end >= start else -seconds
        trace(np.array(points, np.float64), start * seconds, step, abs(end - start), out)
        return out

    return follow
