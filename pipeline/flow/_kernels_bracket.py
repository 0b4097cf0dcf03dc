"""Brackets of a velocity program: each opening one begins a level, each closing one adds it to the last."""

from __future__ import annotations

from typing import Any

from pipeline.arrays import Floats, Indices
from pipeline.flow._kernels_block import BLOCK, LEVEL, U, V, W, X, Y, Z
from pipeline.flow._kernels_opcodes import CLOSE, OPEN, PLACE, UNPLACE
from pipeline.kernels import higher_kernel, kernel

BRACKET = "void(f8[::1], i8, i8, f8[::1], i8)"
"""(numbers, where the row begins, n points, scratch, where the outer level begins); the inner one follows."""


@kernel("i8(i4[::1])")
def levels(kinds: Indices) -> int:
    """How many levels a program needs at once."""
    depth, most = 1, 1
    for kind in kinds:
        if OPEN <= kind <= PLACE:
            depth += 1
        elif CLOSE <= kind <= UNPLACE:
            depth -= 1
        most = max(most, depth)
    return most


@kernel(BRACKET)
def open_group(p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """The same points, at rest."""
    level = s[b:]
    for i in range(3 * BLOCK):
        level[LEVEL + i] = level[i]
        level[LEVEL + U + i] = 0.0


@kernel(BRACKET)
def close_group(p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Velocities times a factor."""
    row, level = p[o:], s[b:]
    for i in range(3 * BLOCK):
        level[U + i] += row[0] * level[LEVEL + U + i]


@higher_kernel
def close_region(weight: Any, p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Velocities times a factor inside 7 and a factor outside 8."""
    row, level = p[o:], s[b:]
    for i in range(n):
        inside = weight(row, 0, level[X + i], level[Y + i], level[Z + i])
        factor = inside * row[7] + (1.0 - inside) * row[8]
        level[U + i] += factor * level[LEVEL + U + i]
        level[V + i] += factor * level[LEVEL + V + i]
        level[W + i] += factor * level[LEVEL + W + i]


@kernel(BRACKET)
def place(p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Points in a frame: centre 0:3, matrix 3:12."""
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
    """Velocities out of a frame: matrix 3:12."""
    row, level = p[o:], s[b:]
    for i in range(n):
        u, v, w = level[LEVEL + U + i], level[LEVEL + V + i], level[LEVEL + W + i]
        level[U + i] += row[3] * u + row[4] * v + row[5] * w
        level[V + i] += row[6] * u + row[7] * v + row[8] * w
        level[W + i] += row[9] * u + row[10] * v + row[11] * w
