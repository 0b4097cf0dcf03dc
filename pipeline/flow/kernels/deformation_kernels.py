"""Barr's deformations from one amount to another: rows of a step plan that move points themselves.

Such a row is a step of its own. Its numbers begin with a point on the axis 0:3 and the unit axis 3:6.
"""

from __future__ import annotations

import math

import numpy as np

from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.flow.kernels.instructions import BLOCK, DEFORMATIONS, X, Y, Z, load, store
from flowsculpt.pipeline.kernels import kernel

TWIST = DEFORMATIONS  # radians per unit along the axis 6
STRETCH = DEFORMATIONS + 1  # factor along the axis 6, and across it 7
SHEAR = DEFORMATIONS + 2  # unit direction of sliding 6:9, slide by height 9
TAPER = DEFORMATIONS + 3  # it widens by exp(6 × height)
BEND = DEFORMATIONS + 4  # unit direction 6:9, half the bent length 9, its curvature before 10 and after 11

_MAP = "UniTuple(f8, 3)(f8[::1], f8, f8, f8)"


@kernel(_MAP, forceinline=True)
def twist(p: Floats, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Turn a point about the axis by so many radians per unit along it."""
    rx, ry, rz = x - p[0], y - p[1], z - p[2]
    along = p[3] * rx + p[4] * ry + p[5] * rz
    c, s = math.cos(p[6] * along), math.sin(p[6] * along)
    qx, qy, qz = rx - along * p[3], ry - along * p[4], rz - along * p[5]
    return (
        x + (c - 1.0) * qx + s * (p[4] * qz - p[5] * qy),
        y + (c - 1.0) * qy + s * (p[5] * qx - p[3] * qz),
        z + (c - 1.0) * qz + s * (p[3] * qy - p[4] * qx),
    )


@kernel(_MAP, forceinline=True)
def stretch(p: Floats, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Scale a point along the axis and across it."""
    rx, ry, rz = x - p[0], y - p[1], z - p[2]
    along = (p[6] - p[7]) * (p[3] * rx + p[4] * ry + p[5] * rz)
    return p[0] + p[7] * rx + along * p[3], p[1] + p[7] * ry + along * p[4], p[2] + p[7] * rz + along * p[5]


@kernel(_MAP, forceinline=True)
def shear(p: Floats, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Slide a point in proportion to its height along the axis."""
    slide = p[9] * (p[3] * (x - p[0]) + p[4] * (y - p[1]) + p[5] * (z - p[2]))
    return x + slide * p[6], y + slide * p[7], z + slide * p[8]


@kernel(_MAP, forceinline=True)
def taper(p: Floats, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Widen across the axis by an exponential of the height along it."""
    rx, ry, rz = x - p[0], y - p[1], z - p[2]
    along = p[3] * rx + p[4] * ry + p[5] * rz
    more = math.expm1(p[6] * along)
    return (x + more * (rx - along * p[3]), y + more * (ry - along * p[4]), z + more * (rz - along * p[5]))


@kernel(_MAP, forceinline=True)
def bend(p: Floats, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Unbend a point from one curvature, and bend it to the other: radians per unit."""
    rx, ry, rz = x - p[0], y - p[1], z - p[2]
    height = p[3] * rx + p[4] * ry + p[5] * rz
    offset = p[6] * rx + p[7] * ry + p[8] * rz
    h, q = _unbent(height, offset, p[9], p[10])
    h, q = _bent(h, q, p[9], p[11])
    dh, dq = h - height, q - offset
    return x + dh * p[3] + dq * p[6], y + dh * p[4] + dq * p[7], z + dh * p[5] + dq * p[8]


@kernel("UniTuple(f8, 2)(f8, f8, f8, f8)", forceinline=True)
def _bent(h: float, q: float, half: float, k: float) -> tuple[float, float]:
    """Return height and offset after bending to the curvature k."""
    if k == 0.0:
        return h, q
    along = min(max(h, -half), half)
    angle, beyond = k * along, h - along
    sine, cosine, small = math.sin(angle), math.cos(angle), math.sin(0.5 * angle)
    return sine / k - q * sine + beyond * cosine, 2.0 * small * small / k + q * cosine + beyond * sine


@kernel("UniTuple(f8, 2)(f8, f8, f8, f8)", forceinline=True)
def _unbent(h: float, q: float, half: float, k: float) -> tuple[float, float]:
    """Return height and offset before bending to the curvature k.

    A point on the arc unbends by its angle about the centre of curvature, one beyond the arc by the rotation
    of the arc's end.
    """
    if k == 0.0:
        return h, q
    near = 1.0 - k * q
    angle = math.atan2(k * h, near)
    if abs(angle) <= abs(k) * half:
        return angle / k, (2.0 * q - k * (h * h + q * q)) / (1.0 + math.hypot(k * h, near))
    end = math.copysign(half, h)
    sine, cosine, small = math.sin(k * end), math.cos(k * end), math.sin(0.5 * k * end)
    dh, dq = h - sine / k, q - 2.0 * small * small / k
    return end + dh * cosine + dq * sine, dq * cosine - dh * sine


@kernel("void(i8, f8[::1], i8, i8, f8[::1], i8)")
def deform(opcode: int, p: Floats, o: int, n: int, s: Floats, at: int) -> None:
    """Move n points, in three runs at s[at], by the deformation of a row that begins at p[o]."""
    row, runs = p[o:], s[at:]
    for i in range(n):
        x, y, z = runs[X + i], runs[Y + i], runs[Z + i]
        if opcode == TWIST:
            x, y, z = twist(row, x, y, z)
        elif opcode == STRETCH:
            x, y, z = stretch(row, x, y, z)
        elif opcode == SHEAR:
            x, y, z = shear(row, x, y, z)
        elif opcode == TAPER:
            x, y, z = taper(row, x, y, z)
        else:
            x, y, z = bend(row, x, y, z)
        runs[X + i], runs[Y + i], runs[Z + i] = x, y, z


@kernel("void(i8, f8[:, ::1], f8[:, ::1])")
def deform_each(opcode: int, rows: Floats, points: Points) -> None:
    """Move points (N, 3), each by a row (N, K) of its own, in place."""
    place = np.empty(3 * BLOCK)
    for i in range(len(points)):
        load(points, i, 1, place, 0)
        deform(opcode, rows[i], 0, 1, place, 0)
        store(place, 0, i, 1, points)
