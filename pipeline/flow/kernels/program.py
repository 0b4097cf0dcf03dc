"""The interpreter of velocity programs: runs each row of a program on a block of points.

To add a field
    1. its equation in `fields`, or for a vortex in `vortices`: a kernel of the signature EQUATION that
       returns the velocity at one point from its row of numbers (at most COLUMNS, listed in its docstring);
       beside it its opcode, and a line in `add_field`;
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

from typing import Any

import numpy as np

from pipeline.arrays import Floats, Indices, Points, Vectors
from pipeline.flow.kernels import instructions as op
from pipeline.flow.kernels.field_kernels import add_field
from pipeline.flow.kernels.instructions import BLOCK, LEVEL, U, V, W, X, Y, Z, call_external, load, store
from pipeline.flow.kernels.region_kernels import (
    ball_weight,
    box_weight,
    capsule_weight,
    cylinder_weight,
    half_space_weight,
    mesh_weight,
)
from pipeline.kernels import higher_kernel, kernel

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
