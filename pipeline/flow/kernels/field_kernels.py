"""The equations of velocity fields, and the interpreter that runs velocity programs on blocks of points.

To add a field
    1. its equation: a kernel of the signature EQUATION that returns the velocity at one point from its row of
       numbers (at most COLUMNS, listed in its docstring); beside it its opcode, and a line in `add_field`.
       Opcodes stand in stored keys: a family's numbers never change;
    2. its class in the catalogue: a `BasicField` with `opcode`, `row(time)` and `gradient_bound(time)`, named
       in the catalogue's FLOWS.

A field that needs more numbers than a row holds gets the address of an array in its row, and reads it by
`carray(doubles_at(int(p[o])), n)`; a function compiled at run time is an EXTERNAL. Both say in
`Instruction.cache_data` what stands for them in keys.

To add a bracket: opcodes in the ranges OPEN…PLACE and CLOSE…UNPLACE, a kernel of the signature BRACKET
(or a weight, for a region), and its lines in `run_program`.

Numbers decide nothing about the code: other parameters, or another composition, compile nothing.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from flowsculpt.pipeline.arrays import Floats, Indices, Points, Vectors
from flowsculpt.pipeline.flow.kernels import instructions as op
from flowsculpt.pipeline.flow.kernels.instructions import (
    ATTRACTORS,
    BLOCK,
    CELLULAR,
    EQUATION,
    EXPANSION,
    FIELD,
    LEVEL,
    LINEAR,
    VORTICES,
    U,
    V,
    Velocity,
    W,
    X,
    Y,
    Z,
    add_each,
    call_external,
    load,
    store,
)
from flowsculpt.pipeline.flow.kernels.region_kernels import (
    ball_weight,
    box_weight,
    capsule_weight,
    cylinder_weight,
    half_space_weight,
    mesh_weight,
)
from flowsculpt.pipeline.kernels import higher_kernel, kernel

LAMB_OSEEN, GAUSSIAN, RANKINE, RING = range(VORTICES, VORTICES + 4)


@kernel("UniTuple(f8, 4)(f8[::1], i8, f8, f8, f8)", forceinline=True)
def about_axis(p: Floats, o: int, x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Return axis × r and the squared distance from the axis. Numbers: centre 0:3, unit axis 3:6."""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    ax, ay, az = p[o + 3], p[o + 4], p[o + 5]
    cx, cy, cz = ay * rz - az * ry, az * rx - ax * rz, ax * ry - ay * rx
    return cx, cy, cz, cx * cx + cy * cy + cz * cz


@kernel(EQUATION, forceinline=True)
def lamb_oseen(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, unit axis 3:6, 1 / radius² 6, angular speed on the axis 7."""
    cx, cy, cz, distance2 = about_axis(p, o, x, y, z)
    ratio, spin = distance2 * p[o + 6], p[o + 7]
    if ratio > 0.02:
        spin *= (1.0 - math.exp(-ratio)) / ratio
    else:  # its series, where the difference would lose digits
        spin *= 1.0 - ratio / 2.0 * (1.0 - ratio / 3.0 * (1.0 - ratio / 4.0 * (1.0 - ratio / 5.0)))
    return spin * cx, spin * cy, spin * cz


@kernel(EQUATION, forceinline=True)
def gaussian(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, unit axis 3:6, 1 / radius² 6, angular speed on the axis 7."""
    cx, cy, cz, distance2 = about_axis(p, o, x, y, z)
    spin = p[o + 7] * math.exp(-distance2 * p[o + 6])
    return spin * cx, spin * cy, spin * cz


@kernel(EQUATION, forceinline=True)
def rankine(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, unit axis 3:6, 1 / radius² 6, angular speed on the axis 7."""
    cx, cy, cz, distance2 = about_axis(p, o, x, y, z)
    spin = p[o + 7] / max(1.0, distance2 * p[o + 6])
    return spin * cx, spin * cy, spin * cz


ROUNDS = 7
"""Rounds of the arithmetic-geometric mean: full precision down to a core of 1e-6 of the ring's radius."""


@kernel("UniTuple(f8, 3)(f8, f8)", forceinline=True)
def elliptic(m: float, root: float) -> tuple[float, float, float]:
    """Return K(m), 1 − E(m)/K(m) and (1 − E/K − m/2) / m²; root is √(1 − m).

    K and E are the complete elliptic integrals. All sums are of one sign, so that no digits are lost.

    Source: Abramowitz & Stegun (1964), 17.6.3 and 17.6.4.
    """
    mean, other, gap = 0.5 * (1.0 + root), math.sqrt(root), 0.5 / (1.0 + root)  # gap: of the means, by m
    tail, power = gap * gap, 1.0
    for _ in range(ROUNDS - 1):
        following = 0.5 * (mean + other)
        gap *= gap * m / (4.0 * following)
        other = math.sqrt(mean * other)
        mean = following
        power *= 2.0
        tail += power * gap * gap
    return 0.5 * math.pi / mean, 0.5 * m + m * m * tail, tail


@kernel(EQUATION, forceinline=True)
def ring(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, unit axis 3:6, radius 6, core² 7, circulation / 2π 8."""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    ax, ay, az, radius = p[o + 3], p[o + 4], p[o + 5], p[o + 6]
    height = ax * rx + ay * ry + az * rz
    qx, qy, qz = rx - height * ax, ry - height * ay, rz - height * az
    away2 = qx * qx + qy * qy + qz * qz
    away = math.sqrt(away2)
    deep2, radius2 = height * height + p[o + 7], radius * radius
    far2, near2 = (radius + away) ** 2 + deep2, (radius - away) ** 2 + deep2
    m = 4.0 * radius * away / far2
    first, lack, tail = elliptic(m, math.sqrt(near2 / far2))
    speed = p[o + 8] * first / math.sqrt(far2)
    along = speed * (1.0 + (radius2 - away2 - deep2) / near2 * (1.0 - lack))
    # away from the axis, by the distance from it: 16 R² / far⁴ stands for m² / distance²
    spread = speed * height * 16.0 * radius2 / (far2 * near2) * (0.25 - tail * (1.0 - 0.5 * m))
    return along * ax + spread * qx, along * ay + spread * qy, along * az + spread * qz


TRANSLATION, ROTATION, SCALING, STRAIN = range(LINEAR, LINEAR + 4)


@kernel(EQUATION, forceinline=True)
def translation(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: velocity 0:3."""
    return p[o], p[o + 1], p[o + 2]


@kernel(EQUATION, forceinline=True)
def rotation(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, unit axis 3:6, angular speed 6."""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    ax, ay, az, speed = p[o + 3], p[o + 4], p[o + 5], p[o + 6]
    return speed * (ay * rz - az * ry), speed * (az * rx - ax * rz), speed * (ax * ry - ay * rx)


@kernel(EQUATION, forceinline=True)
def strain(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, unit axis 3:6, rate along it 6, rate across it 7."""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    ax, ay, az, across = p[o + 3], p[o + 4], p[o + 5], p[o + 7]
    more = (p[o + 6] - across) * (ax * rx + ay * ry + az * rz)
    return across * rx + more * ax, across * ry + more * ay, across * rz + more * az


@kernel(EQUATION, forceinline=True)
def scaling(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, rates 3:6."""
    return p[o + 3] * (x - p[o]), p[o + 4] * (y - p[o + 1]), p[o + 5] * (z - p[o + 2])


BALL, DISC, SOURCE, SQUEEZE = range(EXPANSION, EXPANSION + 4)


@kernel(EQUATION, forceinline=True)
def ball(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, -, 1 / radius² 6, rate 7."""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    inside = max(0.0, 1.0 - (rx * rx + ry * ry + rz * rz) * p[o + 6])
    rate = p[o + 7] * inside * inside
    return rate * rx, rate * ry, rate * rz


@kernel(EQUATION, forceinline=True)
def disc(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, unit axis 3:6, 1 / radius² 6, rate 7."""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    along = p[o + 3] * rx + p[o + 4] * ry + p[o + 5] * rz
    qx, qy, qz = rx - along * p[o + 3], ry - along * p[o + 4], rz - along * p[o + 5]
    inside = max(0.0, 1.0 - (qx * qx + qy * qy + qz * qz) * p[o + 6])
    rate = p[o + 7] * inside * inside
    return rate * qx, rate * qy, rate * qz


@kernel(EQUATION, forceinline=True)
def source(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, core² 3, flux / 4π 4."""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    distance2 = rx * rx + ry * ry + rz * rz + p[o + 3]
    rate = p[o + 4] / (distance2 * math.sqrt(distance2))
    return rate * rx, rate * ry, rate * rz


@kernel(EQUATION, forceinline=True)
def squeeze(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, unit axis 3:6, 1 / length² 6, 1 / radius² 7, rate 8."""
    rx, ry, rz = x - p[o], y - p[o + 1], z - p[o + 2]
    ax, ay, az = p[o + 3], p[o + 4], p[o + 5]
    height = ax * rx + ay * ry + az * rz
    qx, qy, qz = rx - height * ax, ry - height * ay, rz - height * az
    high, wide = height * height * p[o + 6], (qx * qx + qy * qy + qz * qz) * p[o + 7]
    rate = p[o + 8] * math.exp(-high - wide)
    along, across = rate * height * (1.0 - wide), -0.5 * rate * (1.0 - 2.0 * high)
    return along * ax + across * qx, along * ay + across * qy, along * az + across * qz


LORENZ = ATTRACTORS


@kernel(EQUATION, forceinline=True)
def lorenz(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: origin of its own coordinates 0:3, scale 3, time scale / scale 4, sigma 5, rho 6, beta 7.

    It stands upright: in its own coordinates z is our y (up), and y our −z.
    """
    scale, speed = p[o + 3], p[o + 4]
    x, y, z = scale * (x - p[o]), -scale * (z - p[o + 2]), scale * (y - p[o + 1])
    u, v, w = p[o + 5] * (y - x), x * (p[o + 6] - z) - y, x * y - p[o + 7] * z
    return speed * u, speed * w, -speed * v


ENRIGHT, ABC, DOUBLE_GYRE = CELLULAR, CELLULAR + 1, CELLULAR + 3
"""Flows in cells that repeat: waves of velocity along one axis that vary along another."""


@kernel(EQUATION, forceinline=True)
def enright(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, side 3, factor 4."""
    speed, half = p[o + 3] * p[o + 4], math.pi / p[o + 3]
    ax = half * (x - p[o]) + 0.5 * math.pi
    ay = half * (y - p[o + 1]) + 0.5 * math.pi
    az = half * (z - p[o + 2]) + 0.5 * math.pi
    fx, fy, fz = math.sin(2.0 * ax), math.sin(2.0 * ay), math.sin(2.0 * az)
    sx, sy, sz = math.sin(ax) ** 2, math.sin(ay) ** 2, math.sin(az) ** 2
    return 2.0 * speed * sx * fy * fz, -speed * fx * sy * fz, -speed * fx * fy * sz


@kernel(EQUATION, forceinline=True)
def abc(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, wave number 3, a 4, b 5, c 6."""
    kx, ky, kz = p[o + 3] * (x - p[o]), p[o + 3] * (y - p[o + 1]), p[o + 3] * (z - p[o + 2])
    a, b, c = p[o + 4], p[o + 5], p[o + 6]
    return (
        a * math.sin(kz) + c * math.cos(ky),
        b * math.sin(kx) + a * math.cos(kz),
        c * math.sin(ky) + b * math.cos(kx),
    )


@kernel(EQUATION, forceinline=True)
def double_gyre(p: Floats, o: int, x: float, y: float, z: float) -> Velocity:
    """Numbers: centre 0:3, 1 / height 3, π · speed 4, swing 5."""
    across, py, swing = p[o + 3] * (x - p[o]) + 1.0, p[o + 3] * (y - p[o + 1]) + 0.5, p[o + 5]
    across -= 4.0 * np.floor(0.25 * across)
    mirrored = across > 2.0
    px = 3.0 - across if mirrored else across - 1.0
    bent, slope = px + swing * (px * px - 1.0) + 1.0, 1.0 + 2.0 * swing * px
    u = -p[o + 4] * math.sin(math.pi * bent) * math.cos(math.pi * py)
    v = p[o + 4] * math.cos(math.pi * bent) * math.sin(math.pi * py) * slope
    return (-u if mirrored else u), v, 0.0


@kernel(FIELD)
def add_field(opcode: int, p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Add the velocity of one field, whose row begins at p[o], to n points of the level at s[b]."""
    if opcode == TRANSLATION:
        add_each(translation, p, o, n, s, b)
    elif opcode == ROTATION:
        add_each(rotation, p, o, n, s, b)
    elif opcode == SCALING:
        add_each(scaling, p, o, n, s, b)
    elif opcode == STRAIN:
        add_each(strain, p, o, n, s, b)
    elif opcode == LAMB_OSEEN:
        add_each(lamb_oseen, p, o, n, s, b)
    elif opcode == GAUSSIAN:
        add_each(gaussian, p, o, n, s, b)
    elif opcode == RANKINE:
        add_each(rankine, p, o, n, s, b)
    elif opcode == RING:
        add_each(ring, p, o, n, s, b)
    elif opcode == BALL:
        add_each(ball, p, o, n, s, b)
    elif opcode == DISC:
        add_each(disc, p, o, n, s, b)
    elif opcode == SOURCE:
        add_each(source, p, o, n, s, b)
    elif opcode == SQUEEZE:
        add_each(squeeze, p, o, n, s, b)
    elif opcode == LORENZ:
        add_each(lorenz, p, o, n, s, b)
    elif opcode == ENRIGHT:
        add_each(enright, p, o, n, s, b)
    elif opcode == ABC:
        add_each(abc, p, o, n, s, b)
    elif opcode == DOUBLE_GYRE:
        add_each(double_gyre, p, o, n, s, b)


BRACKET = "void(f8[::1], i8, i8, f8[::1], i8)"
"""(numbers, start of the row, n points, scratch, start of the outer level); the inner level follows it."""


@kernel("i8(i4[::1])")
def level_count(opcodes: Indices) -> int:
    """Return how many levels a program needs at once."""
    depth, most = 1, 1
    for opcode in opcodes:
        if op.OPEN <= opcode <= op.PLACE:
            depth += 1
        elif op.CLOSE <= opcode <= op.UNPLACE:
            depth -= 1
        most = max(most, depth)
    return most


@kernel(BRACKET)
def open_group(p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Begin a level with the same points and no velocity."""
    level = s[b:]
    for i in range(3 * BLOCK):
        level[LEVEL + i] = level[i]
        level[LEVEL + U + i] = 0.0


@kernel(BRACKET)
def close_group(p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Add the inner velocities times a factor."""
    row, level = p[o:], s[b:]
    for i in range(3 * BLOCK):
        level[U + i] += row[0] * level[LEVEL + U + i]


@higher_kernel
def close_region(weight: Any, p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Add the inner velocities times a factor inside 7 and a factor outside 8."""
    row, level = p[o:], s[b:]
    for i in range(n):
        inside = weight(row, 0, level[X + i], level[Y + i], level[Z + i])
        factor = inside * row[7] + (1.0 - inside) * row[8]
        level[U + i] += factor * level[LEVEL + U + i]
        level[V + i] += factor * level[LEVEL + V + i]
        level[W + i] += factor * level[LEVEL + W + i]


@kernel(BRACKET)
def place(p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Begin a level with transformed points: centre 0:3, matrix 3:12."""
    row, level = p[o:], s[b:]
    for i in range(n):
        x, y, z = level[X + i] - row[0], level[Y + i] - row[1], level[Z + i] - row[2]
        level[LEVEL + X + i] = row[3] * x + row[4] * y + row[5] * z
        level[LEVEL + Y + i] = row[6] * x + row[7] * y + row[8] * z
        level[LEVEL + Z + i] = row[9] * x + row[10] * y + row[11] * z
    for i in range(3 * BLOCK):
        level[LEVEL + U + i] = 0.0


@kernel(BRACKET)
def unplace(p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Add the inner velocities, transformed back: matrix 3:12."""
    row, level = p[o:], s[b:]
    for i in range(n):
        u, v, w = level[LEVEL + U + i], level[LEVEL + V + i], level[LEVEL + W + i]
        level[U + i] += row[3] * u + row[4] * v + row[5] * w
        level[V + i] += row[6] * u + row[7] * v + row[8] * w
        level[W + i] += row[9] * u + row[10] * v + row[11] * w


@kernel("void(i4[::1], i8, i8, f8[::1], i8, i8, f8[::1], i8)")
def run_program(
    opcodes: Indices, first: int, last: int, p: Floats, o: int, n: int, s: Floats, b: int
) -> None:
    """Run opcodes[first:last], rows from p[o] on: add the velocities to n points of the level at s[b].

    Uses `level_count(opcodes)` levels from there on.
    """
    for k in range(first, last):
        opcode = opcodes[k]
        if opcode > op.EXTERNAL:
            add_field(opcode, p, o, n, s, b)
        elif opcode == op.EXTERNAL:
            call_external(p, o, n, s, b)
        elif opcode == op.OPEN:
            open_group(p, o, n, s, b)
            b += LEVEL
        elif opcode == op.PLACE:
            place(p, o, n, s, b)
            b += LEVEL
        else:
            b -= LEVEL
            if opcode == op.CLOSE:
                close_group(p, o, n, s, b)
            elif opcode == op.CLOSE_BALL:
                close_region(ball_weight, p, o, n, s, b)
            elif opcode == op.CLOSE_BOX:
                close_region(box_weight, p, o, n, s, b)
            elif opcode == op.CLOSE_HALF_SPACE:
                close_region(half_space_weight, p, o, n, s, b)
            elif opcode == op.CLOSE_CAPSULE:
                close_region(capsule_weight, p, o, n, s, b)
            elif opcode == op.CLOSE_CYLINDER:
                close_region(cylinder_weight, p, o, n, s, b)
            elif opcode == op.CLOSE_MESH:
                close_region(mesh_weight, p, o, n, s, b)
            else:
                unplace(p, o, n, s, b)
        o += op.COLUMNS


@kernel("void(f8[:, ::1], i8, i4[::1], f8[::1], f8[:, ::1])")
def _velocity_block(points: Points, block: int, opcodes: Indices, table: Floats, out: Vectors) -> None:
    """Compute the velocities of one block of points."""
    first = block * BLOCK
    n = min(BLOCK, len(points) - first)
    s = np.zeros(level_count(opcodes) * LEVEL)
    load(points, first, n, s, 0)
    run_program(opcodes, 0, len(opcodes), table, 0, n, s, 0)
    store(s, U, first, n, out)


@kernel("void(f8[:, ::1], i4[::1], f8[::1], f8[:, ::1])")
def velocities(points: Points, opcodes: Indices, table: Floats, out: Vectors) -> None:
    """Compute velocities (N, 3) at points (N, 3) into `out`; the table is flat, K rows of COLUMNS."""
    for block in range((len(points) + BLOCK - 1) // BLOCK):
        _velocity_block(points, block, opcodes, table, out)
