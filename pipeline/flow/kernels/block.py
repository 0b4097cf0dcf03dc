"""A block of points as it runs through a velocity program.

Points are handled `BLOCK` at a time, coordinates apart, in one flat scratch array small enough for the
nearest cache. A *level* is six runs of BLOCK numbers: x, y, z of the points and u, v, w of their velocities
so far. A level begins at an offset `b`; the level of the next bracket follows at b + LEVEL.

All offsets within a level are constants, and a level is sliced before its loop, so that the compiler sees
that runs do not overlap and indices are not negative, and handles several points at once. A point's
arithmetic does not depend on its place in a block: results have the same bits for any number of points and
of threads.
"""

from __future__ import annotations

from typing import Any

from pipeline.arrays import Floats, Points
from pipeline.kernels import higher_kernel, kernel

BLOCK = 256
X, Y, Z, U, V, W = (BLOCK * run for run in range(6))
LEVEL = 6 * BLOCK

Velocity = tuple[float, float, float]

EQUATION = "UniTuple(f8, 3)(f8[::1], i8, f8, f8, f8)"
"""The signature of an equation: (numbers, start of its row among them, x, y, z) -> velocity."""

FIELD = "void(i4, f8[::1], i8, i8, f8[::1], i8)"
"""The signature of a family: (opcode, numbers, start of the row, n points, scratch, start of the level)."""


@higher_kernel
def add_each(equation: Any, p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Add the velocity of an equation, whose row begins at p[o], to n points of the level at s[b]."""
    row, level = p[o:], s[b:]
    for i in range(n):
        u, v, w = equation(row, 0, level[X + i], level[Y + i], level[Z + i])
        level[U + i] += u
        level[V + i] += v
        level[W + i] += w


@kernel("void(f8[::1], i8)")
def clear_velocities(s: Floats, b: int) -> None:
    """Set the velocities of the level at s[b] to zero."""
    s[b + U : b + LEVEL] = 0.0


@kernel("void(f8[:, ::1], i8, i8, f8[::1], i8)")
def load(points: Points, first: int, n: int, s: Floats, at: int) -> None:
    """Copy points[first : first + n], coordinates apart, into three runs at s[at]."""
    runs, block = s[at:], points[first:]
    for i in range(n):
        runs[X + i] = block[i, 0]
        runs[Y + i] = block[i, 1]
        runs[Z + i] = block[i, 2]


@kernel("void(f8[::1], i8, i8, i8, f8[:, ::1])")
def store(s: Floats, at: int, first: int, n: int, out: Points) -> None:
    """Copy three runs at s[at] into out[first : first + n]."""
    runs, block = s[at:], out[first:]
    for i in range(n):
        block[i, 0] = runs[X + i]
        block[i, 1] = runs[Y + i]
        block[i, 2] = runs[Z + i]
