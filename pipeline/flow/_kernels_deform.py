"""Deformations of Barr's kind, from one amount to another, point by point in parallel."""

from __future__ import annotations

import math

from numba import prange

from pipeline.arrays import Floats, Points
from pipeline.kernels import kernel


@kernel("void(f8[:, ::1], f8[::1], f8[::1], f8, f8[:, ::1])", parallel=True)
def twist(points: Points, centre: Floats, axis: Floats, by: float, out: Points) -> None:
    """Turn about the axis by `by` radians per unit along it."""
    for i in prange(len(points)):
        rx, ry, rz = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        along = axis[0] * rx + axis[1] * ry + axis[2] * rz
        c, s = math.cos(by * along), math.sin(by * along)
        qx, qy, qz = rx - along * axis[0], ry - along * axis[1], rz - along * axis[2]
        out[i, 0] = points[i, 0] + (c - 1.0) * qx + s * (axis[1] * qz - axis[2] * qy)
        out[i, 1] = points[i, 1] + (c - 1.0) * qy + s * (axis[2] * qx - axis[0] * qz)
        out[i, 2] = points[i, 2] + (c - 1.0) * qz + s * (axis[0] * qy - axis[1] * qx)


@kernel("void(f8[:, ::1], f8[::1], f8[::1], f8, f8, f8[:, ::1])", parallel=True)
def stretch(points: Points, centre: Floats, axis: Floats, lengthen: float, widen: float, out: Points) -> None:
    """Scale along the axis and across it."""
    for i in prange(len(points)):
        rx, ry, rz = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        along = (lengthen - widen) * (axis[0] * rx + axis[1] * ry + axis[2] * rz)
        out[i, 0] = centre[0] + widen * rx + along * axis[0]
        out[i, 1] = centre[1] + widen * ry + along * axis[1]
        out[i, 2] = centre[2] + widen * rz + along * axis[2]


@kernel("void(f8[:, ::1], f8[::1], f8[::1], f8[::1], f8, f8[:, ::1])", parallel=True)
def shear(points: Points, centre: Floats, axis: Floats, direction: Floats, by: float, out: Points) -> None:
    """Slide in `direction` in proportion to the height along the axis."""
    for i in prange(len(points)):
        rx, ry, rz = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        slide = by * (axis[0] * rx + axis[1] * ry + axis[2] * rz)
        out[i, 0] = points[i, 0] + slide * direction[0]
        out[i, 1] = points[i, 1] + slide * direction[1]
        out[i, 2] = points[i, 2] + slide * direction[2]


@kernel("void(f8[:, ::1], f8[::1], f8[::1], f8, f8[:, ::1])", parallel=True)
def taper(points: Points, centre: Floats, axis: Floats, by: float, out: Points) -> None:
    """Widen by exp(by × height along the axis)."""
    for i in prange(len(points)):
        rx, ry, rz = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        along = axis[0] * rx + axis[1] * ry + axis[2] * rz
        more = math.expm1(by * along)
        out[i, 0] = points[i, 0] + more * (rx - along * axis[0])
        out[i, 1] = points[i, 1] + more * (ry - along * axis[1])
        out[i, 2] = points[i, 2] + more * (rz - along * axis[2])
