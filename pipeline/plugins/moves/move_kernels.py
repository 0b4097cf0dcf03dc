"""The compiled function of `move`: points by a rigid motion at times that depend on the point."""

from __future__ import annotations

import math

import numpy as np
from numba import carray

from flowsculpt.api.flows import block_kernel, kernel
from flowsculpt.api.meshes import Floats

COUNT, FIRST, STEP, CENTRE, AXIS, LEADS, SLOWNESS, ROUND, ALONG, SAMPLES = 0, 1, 2, 3, 6, 9, 12, 13, 14, 17
"""Places in the numbers of a motion.

COUNT     how many samples; with one, it holds at all times
FIRST     time of the first sample, s
STEP      from one to the next, s
CENTRE    of the turn
AXIS      unit vector
LEADS     the place that is not late
SLOWNESS  seconds that a point is late by its distance from there
ROUND     units within which the delay is round rather than a cone, or an edge
ALONG     unit vector along which the distance counts, ahead alone; zeros for that in all directions
SAMPLES   offset x, y, z and angle, radians, of each sample
"""


@kernel("f8[::1](voidptr, i8)")
def floats_at(address: int, count: int) -> Floats:
    """Return the float64 numbers at an address."""
    numbers: Floats = carray(address, (count,), np.float64)
    return numbers


MOST_TRIES = 80
"""Tries to find the time of a point, far more than any takes."""


@kernel("void(f8[::1], f8, f8[::1])")
def motion_at(m: Floats, time: float, pose: Floats) -> None:
    """Write offset and angle at a time, between samples by Catmull and Rom's cubic; the ends hold."""
    count = int(m[COUNT])
    at = min(max((time - m[FIRST]) / m[STEP], 0.0), count - 1.0)
    i = min(int(at), max(count - 2, 0))
    s = at - i
    for k in range(4):
        b = m[SAMPLES + 4 * i + k]
        c = m[SAMPLES + 4 * min(i + 1, count - 1) + k]
        a, d = m[SAMPLES + 4 * max(i - 1, 0) + k], m[SAMPLES + 4 * min(i + 2, count - 1) + k]
        pose[k] = b + 0.5 * s * (c - a + s * (2.0 * a - 5.0 * b + 4.0 * c - d + s * (3.0 * (b - c) + d - a)))


@kernel("UniTuple(f8, 3)(f8[::1], f8[::1], f8, f8, f8, b1)")
def placed(m: Floats, pose: Floats, x: float, y: float, z: float, undoes: bool) -> tuple[float, float, float]:
    """Return a point moved by a pose, or back."""
    if undoes:
        x, y, z = x - pose[0], y - pose[1], z - pose[2]
    rx, ry, rz = x - m[CENTRE], y - m[CENTRE + 1], z - m[CENTRE + 2]
    ax, ay, az = m[AXIS], m[AXIS + 1], m[AXIS + 2]
    angle = -pose[3] if undoes else pose[3]
    sine, half = math.sin(angle), math.sin(0.5 * angle)
    more = 2.0 * half * half  # 1 − cos
    along = ax * rx + ay * ry + az * rz
    x += sine * (ay * rz - az * ry) - more * (rx - along * ax)
    y += sine * (az * rx - ax * rz) - more * (ry - along * ay)
    z += sine * (ax * ry - ay * rx) - more * (rz - along * az)
    if not undoes:
        x, y, z = x + pose[0], y + pose[1], z + pose[2]
    return x, y, z


@kernel("f8(f8[::1], f8, f8, f8)")
def delay(m: Floats, x: float, y: float, z: float) -> float:
    """Return by how many seconds a point at its own place is late."""
    rx, ry, rz = x - m[LEADS], y - m[LEADS + 1], z - m[LEADS + 2]
    ax, ay, az = m[ALONG], m[ALONG + 1], m[ALONG + 2]
    if ax != 0.0 or ay != 0.0 or az != 0.0:
        ahead = ax * rx + ay * ry + az * rz
        return 0.5 * m[SLOWNESS] * (ahead + math.sqrt(ahead * ahead + m[ROUND] * m[ROUND]))
    r = math.sqrt(rx * rx + ry * ry + rz * rz + m[ROUND] * m[ROUND]) - m[ROUND]
    return m[SLOWNESS] * r


@kernel("f8(f8[::1], f8, f8, f8, f8, f8[::1])")
def lateness(m: Floats, time: float, x: float, y: float, z: float, pose: Floats) -> float:
    """Return the delay of the point that a motion has moved to x, y, z, and write its pose.

    The delay d is the root of delay(M(time − d)⁻¹ x) − d, which falls where no parts pass through each
    other: by secants within a bracket, which is halved where a secant leads out of it.
    """
    low, high = 0.0, max(time - m[FIRST], 0.0)
    d, before, f_before = low, high, 0.0
    for tried in range(MOST_TRIES):
        motion_at(m, time - d, pose)
        qx, qy, qz = placed(m, pose, x, y, z, True)
        f = delay(m, qx, qy, qz) - d
        if f >= 0.0:
            low = d
        else:
            high = d
        if abs(f) < 1e-16 or high - low < 1e-16:
            break
        following = d + f  # a step of the fixed-point iteration
        if tried and f != f_before:
            following = d - f * (d - before) / (f - f_before)
        if not low < following < high:
            following = 0.5 * (low + high)
        if following == d:
            break
        before, f_before, d = d, f, following
    return d


@block_kernel
def move(
    p: Floats, count: int, x: Floats, y: Floats, z: Floats, t: float, u: Floats, v: Floats, w: Floats
) -> None:
    """Numbers: address of those of the motion 0, how many they are 1, time 2, undoes 3."""
    m = floats_at(int(p[0]), int(p[1]))
    time, undoes, pose = p[2], p[3] > 0.0, np.empty(4)
    is_late = m[SLOWNESS] > 0.0
    motion_at(m, time, pose)
    for i in range(count):
        if is_late:
            if undoes:
                lateness(m, time, x[i], y[i], z[i], pose)
            else:
                motion_at(m, time - delay(m, x[i], y[i], z[i]), pose)
        nx, ny, nz = placed(m, pose, x[i], y[i], z[i], undoes)
        u[i] += nx - x[i]
        v[i] += ny - y[i]
        w[i] += nz - z[i]
