"""The weight of a point in a region: 1 inside, 0 beyond the falloff, and a smooth transition between.

The default transition is 1 − 6t⁵ + 15t⁴ − 10t³ of the distance t in falloffs (Perlin, *Improving Noise*,
SIGGRAPH 2002), so that velocities have continuous second derivatives; its slope is at most 1.875 / falloff.
Without a falloff the weight drops at once.

A closed surface of triangles is one flat array. A header of HEADER numbers comes first: the starts of the
triangles 0, of the dipoles 1 and of the nodes 2, the position of the first node 3:6, the spacing of nodes 6,
and the node counts along x, y and z 7:10. The starts count from the end of the header, where follow

    the tree     boxes, then triangles, as in `external_kernels`
    dipoles      eight numbers a box that stand for its triangles from afar: centre 0:3, area vector 3:6, and
                 the squared distance from which on they do 6
    nodes        signed distances at the nodes of a grid around the surface, z running fastest

The distance changes at most by as much as a point moves. So the nearest node tells for most points that they
are inside, or beyond a limit, and for all others how far to search: the result is exact, whatever the grid.

A point is inside where the winding number of the surface is not 0 (Jacobson, Kavan, Sorkine-Hornung, *Robust
inside-outside segmentation using generalized winding numbers*, SIGGRAPH 2013), summed over boxes (Barill,
Dickson, Schmidt, Levin, Jacobson, *Fast winding numbers for soups and clouds*, SIGGRAPH 2018): overlapping
parts unite, shells within shells are hollows, and the orientation of the whole does not matter.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from flowsculpt.pipeline.arrays import AnyArray, Floats, Points
from flowsculpt.pipeline.flow.kernels import instructions as op
from flowsculpt.pipeline.flow.kernels.external_kernels import DEEPEST, nearest
from flowsculpt.pipeline.flow.kernels.instructions import doubles_at
from flowsculpt.pipeline.kernels import kernel

HEADER = 10

SLACK = 1.0 + 1e-9
"""Factor that widens the limits of a search, so that triangles at the limit are found."""

_FLOATS = "CPointer(f8)"


@kernel(f"f8({_FLOATS}, i8, f8, f8, f8)")
def solid_angle(m: Floats, at: int, x: float, y: float, z: float) -> float:
    """Return the solid angle of the triangle at m[at], seen from a point; above 0 where its back is seen.

    Source: van Oosterom, Strackee, *The solid angle of a plane triangle*, IEEE Trans. Biomed. Eng. 30 (1983).
    """
    ax, ay, az = m[at] - x, m[at + 1] - y, m[at + 2] - z
    bx, by, bz = m[at + 3] - x, m[at + 4] - y, m[at + 5] - z
    cx, cy, cz = m[at + 6] - x, m[at + 7] - y, m[at + 8] - z
    a = math.sqrt(ax * ax + ay * ay + az * az)
    b = math.sqrt(bx * bx + by * by + bz * bz)
    c = math.sqrt(cx * cx + cy * cy + cz * cz)
    volume = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    ab, bc, ca = ax * bx + ay * by + az * bz, bx * cx + by * cy + bz * cz, cx * ax + cy * ay + cz * az
    return 2.0 * math.atan2(volume, a * b * c + ab * c + bc * a + ca * b)


@kernel(f"f8({_FLOATS}, i8, i8, f8, f8, f8, i8[::1])")
def winding(
    m: Floats, triangles: int, dipoles: int, x: float, y: float, z: float, waiting: AnyArray
) -> float:
    """Return the winding number of the surface around a point: about 1 or −1 inside, 0 outside."""
    total, depth = 0.0, 1
    waiting[0] = 0
    while depth:
        depth -= 1
        box = waiting[depth]
        at, d = 8 * box, dipoles + 8 * box
        dx, dy, dz = m[d] - x, m[d + 1] - y, m[d + 2] - z
        d2 = dx * dx + dy * dy + dz * dz
        if d2 > m[d + 6]:
            total += (m[d + 3] * dx + m[d + 4] * dy + m[d + 5] * dz) / (d2 * math.sqrt(d2))
        elif m[at + 7] > 0.0:
            first = triangles + 9 * int(m[at + 6])
            for t in range(first, first + 9 * int(m[at + 7]), 9):
                total += solid_angle(m, t, x, y, z)
        else:
            waiting[depth], waiting[depth + 1] = int(m[at + 6]), box + 1
            depth += 2
    return total / (4.0 * math.pi)


@kernel("f8(i8, f8, f8, f8, f8)")
def distance_outside(address: int, x: float, y: float, z: float, limit: float) -> float:
    """Return the distance of a point outside the surface: 0 inside, and infinity from `limit` on."""
    h, m = doubles_at(address), doubles_at(address + 8 * HEADER)
    triangles, nx, ny, nz = int(h[0]), h[7], h[8], h[9]
    radius, unknown = limit, False
    gx, gy, gz = (x - h[3]) / h[6], (y - h[4]) / h[6], (z - h[5]) / h[6]
    if 0.0 <= gx <= nx - 1.0 and 0.0 <= gy <= ny - 1.0 and 0.0 <= gz <= nz - 1.0:
        i, j, k = math.floor(gx + 0.5), math.floor(gy + 0.5), math.floor(gz + 0.5)
        node = m[int(h[2] + (i * ny + j) * nz + k)]
        away = SLACK * h[6] * math.sqrt((gx - i) ** 2 + (gy - j) ** 2 + (gz - k) ** 2)
        if node < -away:
            return 0.0
        if node - away >= limit:
            return math.inf
        radius, unknown = min(limit, abs(node) + away), node <= away
    waiting = np.empty(DEEPEST, np.int64)
    if unknown and abs(winding(m, triangles, int(h[1]), x, y, z, waiting)) > 0.5:
        return 0.0
    d2, found, _, _ = nearest(m, triangles, x, y, z, SLACK * radius * radius, waiting)
    return math.sqrt(d2) if found >= 0 else math.inf


@kernel("void(i8, f8[:, :, ::1])", parallel=True)
def distances(address: int, out: Floats) -> None:
    """Compute signed distances at the nodes of the header's grid, negative inside, into out (nx, ny, nz).

    Along a row of nodes, a distance changes from one to the next by at most the spacing.
    """
    h, m = doubles_at(address), doubles_at(address + 8 * HEADER)
    triangles, dipoles, spacing = int(h[0]), int(h[1]), h[6]
    nx, ny, nz = out.shape
    for row in prange(nx * ny):
        i, j = row // ny, row % ny
        x, y = h[3] + i * spacing, h[4] + j * spacing
        waiting = np.empty(DEEPEST, np.int64)
        last, side = math.inf, 1.0
        for k in range(nz):
            z, limit = h[5] + k * spacing, SLACK * (last + spacing)
            d2, _, _, _ = nearest(m, triangles, x, y, z, limit * limit, waiting)
            if k == 0 or last <= SLACK * spacing:
                side = -1.0 if abs(winding(m, triangles, dipoles, x, y, z, waiting)) > 0.5 else 1.0
            last = math.sqrt(d2)
            out[i, j, k] = side * last


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


@kernel(WEIGHT)
def mesh_weight(p: Floats, o: int, x: float, y: float, z: float) -> float:
    """Numbers: position of the surface's origin 0:3, scale 3, address 4 of the surface's array.

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
    if opcode == op.CLOSE_CAPSULE:
        return capsule_weight(row, 0, x, y, z)
    if opcode == op.CLOSE_CYLINDER:
        return cylinder_weight(row, 0, x, y, z)
    return mesh_weight(row, 0, x, y, z)


@kernel("void(f8[:, ::1], i8, f8[::1], f8[::1])", parallel=True)
def weights(points: Points, opcode: int, row: Floats, out: Floats) -> None:
    """Compute weights (N,) at points (N, 3) into `out`, by a region's closing opcode and its numbers."""
    for i in prange(len(points)):
        inside = _weight(row, opcode, points[i, 0], points[i, 1], points[i, 2])
        out[i] = inside * row[7] + (1.0 - inside) * row[8]
