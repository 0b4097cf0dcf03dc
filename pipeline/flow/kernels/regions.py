"""The weight of a point in a region: 1 inside, 0 beyond the falloff, and a smooth transition between.

The default transition is 1 − 6t⁵ + 15t⁴ − 10t³ of the distance t in falloffs (Perlin, *Improving Noise*,
SIGGRAPH 2002), so that velocities have continuous second derivatives; its slope is at most 1.875 / falloff.
Without a falloff the weight drops at once.
"""

from __future__ import annotations

import math

from numba import carray, prange

from pipeline.arrays import Floats, Points
from pipeline.flow.kernels import opcodes as op
from pipeline.flow.kernels.closed_surface import distance_outside
from pipeline.flow.kernels.external import doubles_at
from pipeline.kernels import kernel

WEIGHT = "f8(f8[::1], i8, f8, f8, f8)"
"""(numbers, start of the row among them, x, y, z) -> weight."""

SMOOTH, SINE, LINEAR = range(3)
"""Shapes of the falloff."""


@kernel("f8(f8, f8, f8)", forceinline=True)
def falloff_weight(distance: float, falloff: float, shape: float) -> float:
    """Return the weight at a distance from the region, which is 0 or less inside."""
    t = min(max(distance, 0.0) / max(falloff, 1e-300), 1.0)
    if shape == LINEAR:
        return 1.0 - t
    if shape == SINE:
        return 0.5 + 0.5 * math.cos(math.pi * t)
    return 1.0 - t * t * t * (10.0 + t * (6.0 * t - 15.0))


@kernel(WEIGHT, forceinline=True)
def ball_weight(p: Floats, o: int, x: float, y: float, z: float) -> float:
    """Numbers: centre 0:3, radius 3."""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    return falloff_weight(math.sqrt(rx * rx + ry * ry + rz * rz) - p[o + 3], p[o + 6], p[o + 9])


@kernel(WEIGHT, forceinline=True)
def box_weight(p: Floats, o: int, x: float, y: float, z: float) -> float:
    """Numbers: centre 0:3, half its sides 3:6."""
    dx = max(abs(x - p[o]) - p[o + 3], 0.0)
    dy = max(abs(y - p[o + 1]) - p[o + 4], 0.0)
    dz = max(abs(z - p[o + 2]) - p[o + 5], 0.0)
    return falloff_weight(math.sqrt(dx * dx + dy * dy + dz * dz), p[o + 6], p[o + 9])


@kernel(WEIGHT, forceinline=True)
def half_space_weight(p: Floats, o: int, x: float, y: float, z: float) -> float:
    """Numbers: point on the plane 0:3, unit normal outwards 3:6."""
    height = p[o + 3] * (x - p[o]) + p[o + 4] * (y - p[o + 1]) + p[o + 5] * (z - p[o + 2])
    return falloff_weight(height, p[o + 6], p[o + 9])


@kernel("UniTuple(f8, 2)(f8[::1], i8, f8, f8, f8)", forceinline=True)
def _distances_from_line(p: Floats, o: int, x: float, y: float, z: float) -> tuple[float, float]:
    """Return the distances of a point from the ends of a line, along it, and from its axis."""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    along = p[o + 3] * rx + p[o + 4] * ry + p[o + 5] * rz
    qx, qy, qz = rx - along * p[o + 3], ry - along * p[o + 4], rz - along * p[o + 5]
    return max(abs(along) - p[o + 10], 0.0), math.sqrt(qx * qx + qy * qy + qz * qz)


@kernel(WEIGHT, forceinline=True)
def capsule_weight(p: Floats, o: int, x: float, y: float, z: float) -> float:
    """Numbers: centre 0:3, unit axis 3:6, half the length of its line 10, radius 11."""
    beyond, across = _distances_from_line(p, o, x, y, z)
    return falloff_weight(math.sqrt(beyond * beyond + across * across) - p[o + 11], p[o + 6], p[o + 9])


@kernel(WEIGHT, forceinline=True)
def cylinder_weight(p: Floats, o: int, x: float, y: float, z: float) -> float:
    """Numbers: centre 0:3, unit axis 3:6, half its length 10, radius 11."""
    beyond, across = _distances_from_line(p, o, x, y, z)
    out = max(across - p[o + 11], 0.0)
    return falloff_weight(math.sqrt(beyond * beyond + out * out), p[o + 6], p[o + 9])


@kernel("f8(f8[::1], i8, i8, f8, f8)", forceinline=True)
def _bilinear(d: Floats, at: int, nz: int, fy: float, fz: float) -> float:
    """Interpolate between four nodes, the first of which is d[at]."""
    near = (1.0 - fz) * d[at] + fz * d[at + 1]
    far = (1.0 - fz) * d[at + nz] + fz * d[at + nz + 1]
    value: float = (1.0 - fy) * near + fy * far
    return value


@kernel(WEIGHT, forceinline=True)
def sampled_weight(p: Floats, o: int, x: float, y: float, z: float) -> float:
    """Numbers: origin 0:3, spacing 3, address 4 of the node counts along x, y, z and the distances.

    z runs fastest. Distances are trilinear between nodes; beyond the grid those of its border hold. A NaN
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
    distance: float = (1.0 - fx) * _bilinear(d, at, nz, fy, fz) + fx * _bilinear(d, at + ny * nz, nz, fy, fz)
    return falloff_weight(distance, p[o + 6], p[o + 9])


@kernel(WEIGHT)
def mesh_weight(p: Floats, o: int, x: float, y: float, z: float) -> float:
    """Numbers: position of the surface's origin 0:3, scale 3, address 4 of the array of `closed_surface`.

    A NaN is outside.
    """
    if math.isnan(x) or math.isnan(y) or math.isnan(z):
        return 0.0
    shrink = 1.0 / p[o + 3]
    rim = shrink * p[o + 6]
    away = distance_outside(
        int(p[o + 4]), shrink * (x - p[o]), shrink * (y - p[o + 1]), shrink * (z - p[o + 2]), rim
    )
    return falloff_weight(away, rim, p[o + 9])


@kernel(WEIGHT)
def _weight(row: Floats, opcode: int, x: float, y: float, z: float) -> float:
    """Return the weight of a region by the opcode that closes it."""
    if opcode == op.CLOSE_BALL:
        return ball_weight(row, 0, x, y, z)
    if opcode == op.CLOSE_BOX:
        return box_weight(row, 0, x, y, z)
    if opcode == op.CLOSE_HALF_SPACE:
        return half_space_weight(row, 0, x, y, z)
    if opcode == op.CLOSE_MESH:
        return mesh_weight(row, 0, x, y, z)
    if opcode == op.CLOSE_CAPSULE:
        return capsule_weight(row, 0, x, y, z)
    if opcode == op.CLOSE_CYLINDER:
        return cylinder_weight(row, 0, x, y, z)
    return sampled_weight(row, 0, x, y, z)


@kernel("void(f8[:, ::1], i8, f8[::1], f8[::1])", parallel=True)
def weights(points: Points, opcode: int, row: Floats, out: Floats) -> None:
    """Compute weights (N,) at points (N, 3) into `out`, by a region's closing opcode and its numbers."""
    for i in prange(len(points)):
        inside = _weight(row, opcode, points[i, 0], points[i, 1], points[i, 2])
        out[i] = inside * row[7] + (1.0 - inside) * row[8]
