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
    for i in range(3 * BLOCK):
        s[b + LEVEL + i] = s[b + i]
        s[b + LEVEL + U + i] = 0.0


@kernel(BRACKET)
def close_group(p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Velocities times a factor."""
    for i in range(3 * BLOCK):
        s[b + U + i] += p[o] * s[b + LEVEL + U + i]


@higher_kernel
def close_region(weight: Any, p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Velocities times a factor inside 7 and a factor outside 8."""
    for i in range(n):
        inside = weight(p, o, s[b + X + i], s[b + Y + i], s[b + Z + i])
        factor = inside * p[o + 7] + (1.0 - inside) * p[o + 8]
        s[b + U + i] += factor * s[b + LEVEL + U + i]
        s[b + V + i] += factor * s[b + LEVEL + V + i]
        s[b + W + i] += factor * s[b + LEVEL + W + i]


@kernel(BRACKET)
def place(p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Points in a frame: centre 0:3, matrix 3:12."""
    for i in range(n):
        x, y, z = s[b + X + i] - p[o], s[b + Y + i] - p[o + 1], s[b + Z + i] - p[o + 2]
        s[b + LEVEL + X + i] = p[o + 3] * x + p[o + 4] * y + p[o + 5] * z
        s[b + LEVEL + Y + i] = p[o + 6] * x + p[o + 7] * y + p[o + 8] * z
        s[b + LEVEL + Z + i] = p[o + 9] * x + p[o + 10] * y + p[o + 11] * z
    for i in range(3 * BLOCK):
        s[b + LEVEL + U + i] = 0.0


@kernel(BRACKET)
def unplace(p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Velocities out of a frame: matrix 3:12."""
    for i in range(n):
        u, v, w = s[b + LEVEL + U + i], s[b + LEVEL + V + i], s[b + LEVEL + W + i]
        s[b + U + i] += p[o + 3] * u + p[o + 4] * v + p[o + 5] * w
        s[b + V + i] += p[o + 6] * u + p[o + 7] * v + p[o + 8] * w
        s[b + W + i] += p[o + 9] * u + p[o + 10] * v + p[o + 11] * w
