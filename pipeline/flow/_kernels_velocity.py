"""Velocity fields as rows of a table, and their integration.

A field is a kind and up to `COLUMNS` numbers; a sum of fields is a table of such rows. The kernels
read the table, so a new parameter, keyframe or composition compiles nothing. Every point is
integrated on its own, without a shared sum: any number of threads gives the same bits.
"""

from __future__ import annotations

import math

from numba import prange

from pipeline.arrays import AnyArray, Floats, Indices, Points, Vectors
from pipeline.kernels import kernel

Velocity = tuple[float, float, float]

COLUMNS = 10

TRANSLATION = 0  # velocity 0:3
LAMB_OSEEN = 1  # centre 0:3, axis 3:6, 1 / radius² 6, angular speed on the axis 7
GAUSSIAN = 2  # the same
ROTATION = 3  # centre 0:3, axis 3:6, angular speed 6
STRAIN = 4  # centre 0:3, axis 3:6, rate 6
BALL = 5  # centre 0:3, -, 1 / radius² 6, rate 7
DISC = 6  # centre 0:3, axis 3:6, 1 / radius² 6, rate 7
LORENZ = 7  # centre 0:3, sigma 3, rho 4, beta 5, scale 6, time scale 7
ENRIGHT = 8  # centre 0:3, side 3, factor 4


@kernel("UniTuple(f8, 3)(i4, f8[::1], i8, f8, f8, f8)", forceinline=True)
def one_velocity(kind: int, p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """The velocity of one field at one point; its row begins at p[o]. The catalogue has the equations."""
    if kind == TRANSLATION:
        return p[o], p[o + 1], p[o + 2]
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    if kind == LORENZ:
        # attractor coordinates: its z is our y (up), its y our -z
        scale, speed = p[o + 6], p[o + 7] / p[o + 6]
        lx, ly, lz = scale * rx, -scale * rz, scale * ry + p[o + 4] - 1.0
        return (
            speed * p[o + 3] * (ly - lx),
            speed * (lx * ly - p[o + 5] * lz),
            -speed * (lx * (p[o + 4] - lz) - ly),
        )
    if kind == ENRIGHT:
        side, speed = p[o + 3], p[o + 3] * p[o + 4]
        half = math.pi / side
        ax, ay, az = half * rx + 0.5 * math.pi, half * ry + 0.5 * math.pi, half * rz + 0.5 * math.pi
        fx, fy, fz = math.sin(2.0 * ax), math.sin(2.0 * ay), math.sin(2.0 * az)
        sx, sy, sz = math.sin(ax) ** 2, math.sin(ay) ** 2, math.sin(az) ** 2
        return 2.0 * speed * sx * fy * fz, -speed * fx * sy * fz, -speed * fx * fy * sz
    along = p[o + 3] * rx + p[o + 4] * ry + p[o + 5] * rz
    if kind == BALL:
        along = 0.0
    # the part perpendicular to the axis
    qx, qy, qz = rx - along * p[o + 3], ry - along * p[o + 4], rz - along * p[o + 5]
    if kind == STRAIN:
        rate, half = p[o + 6], -0.5 * p[o + 6]
        return (
            rate * along * p[o + 3] + half * qx,
            rate * along * p[o + 4] + half * qy,
            rate * along * p[o + 5] + half * qz,
        )
    distance2 = qx * qx + qy * qy + qz * qz
    if kind in (BALL, DISC):
        inside = max(0.0, 1.0 - distance2 * p[o + 6])
        rate = p[o + 7] * inside * inside
        return rate * qx, rate * qy, rate * qz
    if kind == ROTATION:
        spin = p[o + 6]
    else:
        ratio = distance2 * p[o + 6]
        spin = p[o + 7]
        if kind == GAUSSIAN:
            spin *= math.exp(-ratio)
        elif ratio > 0.02:
            spin *= (1.0 - math.exp(-ratio)) / ratio
        else:  # the same as a series, where the difference would lose digits
            spin *= 1.0 - ratio / 2.0 * (1.0 - ratio / 3.0 * (1.0 - ratio / 4.0 * (1.0 - ratio / 5.0)))
    return (
        spin * (p[o + 4] * qz - p[o + 5] * qy),
        spin * (p[o + 5] * qx - p[o + 3] * qz),
        spin * (p[o + 3] * qy - p[o + 4] * qx),
    )


@kernel("UniTuple(f8, 3)(i4[::1], i8, i8, f8[::1], i8, f8, f8, f8)", forceinline=True)
def summed_velocity(
    kinds: Indices, first: int, last: int, p: Floats, o: int, x: float, y: float, z: float
) -> Velocity:
    """The sum of the fields kinds[first:last] at one point; their rows begin at p[o].

    Arrays are handed on whole and tables flat: slicing them here would count references for every point.
    """
    u, v, w = 0.0, 0.0, 0.0
    for k in range(first, last):
        du, dv, dw = one_velocity(kinds[k], p, o + (k - first) * COLUMNS, x, y, z)
        u += du
        v += dv
        w += dw
    return u, v, w


@kernel("void(f8[:, ::1], i4[::1], f8[::1], f8[:, ::1])", parallel=True)
def velocities(points: Points, kinds: Indices, table: Floats, out: Vectors) -> None:
    """Velocities (N, 3) at points (N, 3) into `out`; the table is flat, K rows of COLUMNS."""
    for i in prange(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        out[i, 0], out[i, 1], out[i, 2] = summed_velocity(kinds, 0, len(kinds), table, 0, x, y, z)


@kernel("void(f8[:, ::1], i8, i4[::1], f8[::1], i8[:, ::1], f8[::1], f8[:, ::1])", forceinline=True)
def _advect_one(
    points: Points, i: int, kinds: Indices, tables: Floats, steps: AnyArray, lengths: Floats, out: Points
) -> None:
    """The way of one point."""
    x, y, z = points[i, 0], points[i, 1], points[i, 2]
    for step in range(len(lengths)):
        first, last, start, h = steps[step, 0], steps[step, 1], steps[step, 2], lengths[step]
        size = (last - first) * COLUMNS
        middle, end = start + size, start + 2 * size
        ax, ay, az = summed_velocity(kinds, first, last, tables, start, x, y, z)
        bx, by, bz = summed_velocity(
            kinds, first, last, tables, middle, x + 0.5 * h * ax, y + 0.5 * h * ay, z + 0.5 * h * az
        )
        cx, cy, cz = summed_velocity(
            kinds, first, last, tables, middle, x + 0.5 * h * bx, y + 0.5 * h * by, z + 0.5 * h * bz
        )
        dx, dy, dz = summed_velocity(kinds, first, last, tables, end, x + h * cx, y + h * cy, z + h * cz)
        x += h / 6.0 * (ax + 2.0 * (bx + cx) + dx)
        y += h / 6.0 * (ay + 2.0 * (by + cy) + dy)
        z += h / 6.0 * (az + 2.0 * (bz + cz) + dz)
    out[i, 0], out[i, 1], out[i, 2] = x, y, z


@kernel("void(f8[:, ::1], i4[::1], f8[::1], i8[:, ::1], f8[::1], f8[:, ::1])")
def advect(
    points: Points, kinds: Indices, tables: Floats, steps: AnyArray, lengths: Floats, out: Points
) -> None:
    """Classical Runge-Kutta of order 4 from points (N, 3) into `out`, sub-step after sub-step.

    steps    (S, 3): the fields of each sub-step are kinds[steps[s, 0] : steps[s, 1]], and from
             tables[steps[s, 2]] on lie their tables at its start, middle and end
    lengths  (S,) seconds
    """
    for i in range(len(points)):
        _advect_one(points, i, kinds, tables, steps, lengths, out)


@kernel("void(f8[:, ::1], i4[::1], f8[::1], i8[:, ::1], f8[::1], f8[:, ::1])", parallel=True)
def advect_together(
    points: Points, kinds: Indices, tables: Floats, steps: AnyArray, lengths: Floats, out: Points
) -> None:
    """The same by several threads."""
    for i in prange(len(points)):
        _advect_one(points, i, kinds, tables, steps, lengths, out)
