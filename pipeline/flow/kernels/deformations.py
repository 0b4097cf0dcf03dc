"""Barr's deformations from one amount to another, for all points in parallel."""

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
    """Slide along `direction` in proportion to the height along the axis."""
    for i in prange(len(points)):
        rx, ry, rz = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        slide = by * (axis[0] * rx + axis[1] * ry + axis[2] * rz)
        out[i, 0] = points[i, 0] + slide * direction[0]
        out[i, 1] = points[i, 1] + slide * direction[1]
        out[i, 2] = points[i, 2] + slide * direction[2]


@kernel("void(f8[:, ::1], f8[::1], f8[::1], f8, f8[:, ::1])", parallel=True)
def taper(points: Points, centre: Floats, axis: Floats, by: float, out: Points) -> None:
    """Widen across the axis by exp(by × height along it)."""
    for i in prange(len(points)):
        rx, ry, rz = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        along = axis[0] * rx + axis[1] * ry + axis[2] * rz
        more = math.expm1(by * along)
        out[i, 0] = points[i, 0] + more * (rx - along * axis[0])
        out[i, 1] = points[i, 1] + more * (ry - along * axis[1])
        out[i, 2] = points[i, 2] + more * (rz - along * axis[2])


@kernel("void(f8[:, ::1], f8[::1], f8[::1], f8[::1], f8, f8, f8, f8[:, ::1])", parallel=True)
def bend(
    points: Points,
    centre: Floats,
    axis: Floats,
    towards: Floats,
    half: float,
    before: float,
    after: float,
    out: Points,
) -> None:
    """Unbend from the curvature `before`, bend to the curvature `after`: radians per unit."""
    for i in prange(len(points)):
        rx, ry, rz = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        height = axis[0] * rx + axis[1] * ry + axis[2] * rz
        offset = towards[0] * rx + towards[1] * ry + towards[2] * rz
        h, q = _unbent(height, offset, half, before)
        h, q = _bent(h, q, half, after)
        dh, dq = h - height, q - offset
        out[i, 0] = points[i, 0] + dh * axis[0] + dq * towards[0]
        out[i, 1] = points[i, 1] + dh * axis[1] + dq * towards[1]
        out[i, 2] = points[i, 2] + dh * axis[2] + dq * towards[2]


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
