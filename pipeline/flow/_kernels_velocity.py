"""Points along the velocities of a program, block by block; blocks in parallel share nothing."""

from __future__ import annotations

import numpy as np
from numba import prange

from pipeline.arrays import AnyArray, Floats, Indices, Points, Vectors
from pipeline.flow._kernels_block import BLOCK, LEVEL, U, load, rest, store
from pipeline.flow._kernels_bracket import levels
from pipeline.flow._kernels_opcodes import COLUMNS
from pipeline.flow._kernels_program import run
from pipeline.kernels import kernel

HERE = 0  # three runs: where the points are
SLOPE = 3 * BLOCK  # three runs: the sum of the stages' velocities
STAGE = 6 * BLOCK  # the level on which the program runs


@kernel("void(f8[:, ::1], i8, i4[::1], f8[::1], f8[:, ::1])")
def _velocity_block(points: Points, block: int, kinds: Indices, table: Floats, out: Vectors) -> None:
    """The velocities of one block of points."""
    first = block * BLOCK
    n = min(BLOCK, len(points) - first)
    s = np.zeros(levels(kinds) * LEVEL)
    load(points, first, n, s, 0)
    run(kinds, 0, len(kinds), table, 0, n, s, 0)
    store(s, U, first, n, out)


@kernel("void(f8[:, ::1], i4[::1], f8[::1], f8[:, ::1])", parallel=True)
def velocities(points: Points, kinds: Indices, table: Floats, out: Vectors) -> None:
    """Velocities (N, 3) at points (N, 3) into `out`; the table is flat, K rows of COLUMNS."""
    for block in prange((len(points) + BLOCK - 1) // BLOCK):
        _velocity_block(points, block, kinds, table, out)


@kernel("void(i4[::1], i8[:, ::1], f8[::1], i8, f8, i8, f8[::1])")
def _step(kinds: Indices, steps: AnyArray, tables: Floats, step: int, h: float, n: int, s: Floats) -> None:
    """One sub-step of n points by the classical Runge-Kutta method."""
    first, last, start = steps[step, 0], steps[step, 1], steps[step, 2]
    size = (last - first) * COLUMNS
    for i in range(3 * BLOCK):
        s[STAGE + i] = s[HERE + i]
        s[SLOPE + i] = 0.0
    for stage in range(4):
        rest(s, STAGE)
        run(kinds, first, last, tables, start + (stage + 1) // 2 * size, n, s, STAGE)
        weight = 1.0 if stage in (0, 3) else 2.0
        ahead = h if stage == 2 else 0.5 * h
        for i in range(3 * BLOCK):
            s[SLOPE + i] += weight * s[STAGE + U + i]
            s[STAGE + i] = s[HERE + i] + ahead * s[STAGE + U + i]
    for i in range(3 * BLOCK):
        s[HERE + i] += h / 6.0 * s[SLOPE + i]


@kernel("void(f8[:, ::1], i8, i4[::1], f8[::1], i8[:, ::1], f8[::1], f8[:, ::1])")
def _advect_block(
    points: Points, block: int, kinds: Indices, tables: Floats, steps: AnyArray, lengths: Floats, out: Points
) -> None:
    """The way of one block of points."""
    first = block * BLOCK
    n = min(BLOCK, len(points) - first)
    s = np.zeros(STAGE + levels(kinds) * LEVEL)
    load(points, first, n, s, HERE)
    for step in range(len(lengths)):
        _step(kinds, steps, tables, step, lengths[step], n, s)
    store(s, HERE, first, n, out)


@kernel("void(f8[:, ::1], i4[::1], f8[::1], i8[:, ::1], f8[::1], f8[:, ::1])")
def advect(
    points: Points, kinds: Indices, tables: Floats, steps: AnyArray, lengths: Floats, out: Points
) -> None:
    """Classical Runge-Kutta of order 4 from points (N, 3) into `out`, sub-step after sub-step.

    steps    (S, 3): the program of each sub-step is kinds[steps[s, 0] : steps[s, 1]], and from
             tables[steps[s, 2]] on lie its tables at the start, middle and end of the sub-step
    lengths  (S,) seconds
    """
    for block in range((len(points) + BLOCK - 1) // BLOCK):
        _advect_block(points, block, kinds, tables, steps, lengths, out)


@kernel("void(f8[:, ::1], i4[::1], f8[::1], i8[:, ::1], f8[::1], f8[:, ::1])", parallel=True)
def advect_together(
    points: Points, kinds: Indices, tables: Floats, steps: AnyArray, lengths: Floats, out: Points
) -> None:
    """The same by several threads."""
    for block in prange((len(points) + BLOCK - 1) // BLOCK):
        _advect_block(points, block, kinds, tables, steps, lengths, out)
