"""How much a point belongs to a region: 1 inside, 0 from `falloff` outside on, and a way between.

The way is by default 1 − 6t⁵ + 15t⁴ − 10t³ of the distance t in falloffs (Perlin, *Improving Noise*, SIGGRAPH
2002), so that velocities have continuous second derivatives; nowhere is it steeper than 1.875 / falloff.
Without a falloff the region ends at once.
"""

from __future__ import annotations

import math

from numba import carray, prange

from pipeline.arrays import Floats, Points
from pipeline.flow import _kernels_opcodes as op
from pipeline.flow._kernels_closed import distance_outside
from pipeline.flow._kernels_external import doubles_at
from pipeline.kernels import kernel

WEIGHT = "f8(f8[::1], i8, f8, f8, f8)"
"""(numbers, where the row begins among them, x, y, z) -> the weight there."""

SMOOTH, SINE, LINEAR = range(3)
"""Forms of the fall."""


@kernel("f8(f8, f8, f8)", forceinline=True)
def fall(distance: float, falloff: float, form: float) -> float:
    """The weight at a distance from the region, which is nought or less inside."""
    t = min(max(distance, 0.0) / max(falloff, 1e-300), 1.0)
    if form == LINEAR:
        return 1.0 - t
    if form == SINE:
        return 0.5 + 0.5 * math.cos(math.pi * t)
    return 1.0 - t * t * t * (10.0 + t * (6.0 * t - 15.0))


@kernel(WEIGHT, forceinline=True)
def ball_weight(p: Floats, o: int, x: float, y: float, z: float) -> float:
    """centre 0:3, radius 3"""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    return fall(math.sqrt(rx * rx + ry * ry + rz * rz) - p[o + 3], p[o + 6], p[o + 9])


@kernel(WEIGHT, forceinline=True)
def box_weight(p: Floats, o: int, x: float, y: float, z: float) -> float:
    """centre 0:3, half its sides 3:6"""
    dx = max(abs(x - p[o]) - p[o + 3], 0.0)
    dy = max(abs(y - p[o + 1]) - p[o + 4], 0.0)
    dz = max(abs(z - p[o + 2]) - p[o + 5], 0.0)
    return fall(math.sqrt(dx * dx + dy * dy + dz * dz), p[o + 6], p[o + 9])


@kernel(WEIGHT, forceinline=True)
def half_space_weight(p: Floats, o: int, x: float, y: float, z: float) -> float:
    """point on the plane 0:3, unit normal outwards 3:6"""
    height = p[o + 3] * (x - p[o]) + p[o + 4] * (y - p[o + 1]) + p[o + 5] * (z - p[o + 2])
    return fall(height, p[o + 6], p[o + 9])


@kernel("UniTuple(f8, 2)(f8[::1], i8, f8, f8, f8)", forceinline=True)
def _beyond_and_across(p: Floats, o: int, x: float, y: float, z: float) -> tuple[float, float]:
    """How far a point lies beyond the ends of a line, and how far from its axis."""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    along = p[o + 3] * rx + p[o + 4] * ry + p[o + 5] * rz
    qx, qy, qz = rx - along * p[o + 3], ry - along * p[o + 4], rz - along * p[o + 5]
    return max(abs(along) - p[o + 10], 0.0), math.sqrt(qx * qx + qy * qy + qz * qz)


@kernel(WEIGHT, forceinline=True)
def capsule_weight(p: Floats, o: int, x: float, y: float, z: float) -> float:
    """centre 0:3, unit axis 3:6, half the length of its line 10, radius 11"""
    beyond, across = _beyond_and_across(p, o, x, y, z)
    return fall(math.sqrt(beyond * beyond + across * across) - p[o + 11], p[o + 6], p[o + 9])


@kernel(WEIGHT, forceinline=True)
def cylinder_weight(p: Floats, o: int, x: float, y: float, z: float) -> float:
    """centre 0:3, unit axis 3:6, half its length 10, radius 11"""
    beyond, across = _beyond_and_across(p, o, x, y, z)
    out = max(across - p[o + 11], 0.0)
    return fall(math.sqrt(beyond * beyond + out * out), p[o + 6], p[o + 9])


@kernel("f8(f8[::1], i8, i8, f8, f8)", forceinline=True)
def _on_a_side(d: Floats, at: int, nz: int, fy: float, fz: float) -> float:
    """Bilinear among four nodes, of which d[at] is the first."""
    near = (1.0 - fz) * d[at] + fz * d[at + 1]
    far = (1.0 - fz) * d[at + nz] + fz * d[at + nz + 1]
    value: float = (1.0 - fy) * near + fy * far
    return value


@kernel(WEIGHT, forceinline=True)
def sampled_weight(p: Floats, o: int, x: float, y: float, z: float) -> float:
    """origin 0:3, spacing 3, address 4 of: nodes along x, y and z, then distances, z running fastest

    Between nodes distances are trilinear; outside of the grid they are those of its rim. What is at no place
    is outside.
    """
    if math.isnan(x) or math.isnan(y) or math.isnan(z):
        return 0.0
    sizes = carray(doubles_at(int(p[o + 4])), 3)
    nx, ny, nz = int(sizes[0]), int(sizes[1]), int(sizes[2])
    d = carray(doubles_at(int(p[o + 4]) + 24), nx * ny * nz)
    gx = min(max((x - p[o]) / p[o + 3], 0.0), nx - 1.0)
    gy = min(max((y - p[o + 1]) / p[o + 3], 0.0), ny - 1.0)
    gz = min(max((z - p[o + 2]) / p[o + 3], 0.0), nz - 1.0)
    i, j, k = min(int(gx), nx - 2), min(int(gy), ny - 2), min(int(gz), nz - 2)
    fx, fy, fz = gx - i, gy - j, gz - k
    at = (i * ny + j) * nz + k
    distance: float = (1.0 - fx) * _on_a_side(d, at, nz, fy, fz) + fx * _on_a_side(
        d, at + ny * nz, nz, fy, fz
    )
    return fall(distance, p[o + 6], p[o + 9])


@kernel(WEIGHT)
def mesh_weight(p: Floats, o: int, x: float, y: float, z: float) -> float:
    """where the surface's origin is put 0:3, scale 3, address 4 of what `_kernels_closed` knows of it

    What is at no place is outside.
    """
    if math.isnan(x) or math.isnan(y) or math.isnan(z):
        return 0.0
    shrink = 1.0 / p[o + 3]
    rim = shrink * p[o + 6]
    away = distance_outside(
        int(p[o + 4]), shrink * (x - p[o]), shrink * (y - p[o + 1]), shrink * (z - p[o + 2]), rim
    )
    return fall(away, rim, p[o + 9])


@kernel(WEIGHT)
def _of_kind(row: Floats, kind: int, x: float, y: float, z: float) -> float:
    """The weight by a region whose closing opcode is `kind`."""
    if kind == op.CLOSE_BALL:
        return ball_weight(row, 0, x, y, z)
    if kind == op.CLOSE_BOX:
        return box_weight(row, 0, x, y, z)
    if kind == op.CLOSE_HALF_SPACE:
        return half_space_weight(row, 0, x, y, z)
    if kind == op.CLOSE_MESH:
        return mesh_weight(row, 0, x, y, z)
    if kind == op.CLOSE_CAPSULE:
        return capsule_weight(row, 0, x, y, z)
    if kind == op.CLOSE_CYLINDER:
        return cylinder_weight(row, 0, x, y, z)
    return sampled_weight(row, 0, x, y, z)


@kernel("void(f8[:, ::1], i8, f8[::1], f8[::1])", parallel=True)
def weights(points: Points, kind: int, row: Floats, out: Floats) -> None:
    """Factors (N,) at points (N, 3), for maps: `kind` is the opcode that closes a group by that region, and
    `row` its numbers."""
    for i in prange(len(points)):
        inside = _of_kind(row, kind, points[i, 0], points[i, 1], points[i, 2])
        out[i] = inside * row[7] + (1.0 - inside) * row[8]
