"""Points along the velocities of a program, block by block; blocks in parallel share nothing."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pipeline.arrays import AnyArray, Floats, Indices, Points, Vectors
from pipeline.flow._kernels_block import BLOCK, LEVEL, U, X, Y, Z, load, rest, store
from pipeline.flow._kernels_bracket import levels
from pipeline.flow._kernels_opcodes import COLUMNS, TRANSLATION
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


COURSE = "void(f8[:, ::1], i4[::1], f8[::1], i8[:, ::1], f8[:, ::1], f8[:, ::1])"
"""Of a kernel that follows a course: (points, kinds, tables, steps, spans, out)."""


@kernel("void(i4[::1], i8[:, ::1], f8[::1], i8, f8[:, ::1], i8, f8[::1])")
def _step(
    kinds: Indices, steps: AnyArray, tables: Floats, step: int, spans: Floats, n: int, s: Floats
) -> None:
    """One sub-step of n points by the classical Runge-Kutta method; those that go too far are lost."""
    first, last, start = steps[step, 0], steps[step, 1], steps[step, 2]
    size, h, stride = (last - first) * COLUMNS, spans[step, 0], spans[step, 2]
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
    if stride < math.inf:
        furthest = (6.0 * stride / h) ** 2 if h != 0.0 else math.inf
        slopes, here = s[SLOPE:], s[HERE:]
        for i in range(n):
            u, v, w = slopes[X + i], slopes[Y + i], slopes[Z + i]
            if u * u + v * v + w * w > furthest:
                here[X + i] = math.nan


@kernel("UniTuple(f8, 3)(f8[::1], i8, i8)")
def _sum_of_rows(tables: Floats, first: int, last: int) -> tuple[float, float, float]:
    """The velocity of translations whose rows are tables[first:last]."""
    u, v, w = 0.0, 0.0, 0.0
    for o in range(first, last, COLUMNS):
        u += tables[o]
        v += tables[o + 1]
        w += tables[o + 2]
    return u, v, w


@kernel("void(f8[::1], i8[:, ::1], f8[:, ::1], f8[:, ::1])")
def _ways(tables: Floats, steps: AnyArray, spans: Floats, ways: Vectors) -> None:
    """The way (S, 3) of every point in each sub-step of translations, with the bits of `_step`."""
    for step in range(len(spans)):
        size, start = (steps[step, 1] - steps[step, 0]) * COLUMNS, steps[step, 2]
        a = _sum_of_rows(tables, start, start + size)
        b = _sum_of_rows(tables, start + size, start + 2 * size)
        c = _sum_of_rows(tables, start + 2 * size, start + 3 * size)
        h, stride = spans[step, 0], spans[step, 2]
        for axis in range(3):
            ways[step, axis] = h / 6.0 * (a[axis] + 2.0 * b[axis] + 2.0 * b[axis] + c[axis])
        if stride < math.inf and not math.sqrt((ways[step] ** 2).sum()) <= stride:
            ways[step, 0] = math.nan


@kernel("void(f8[:, ::1], i8, f8[:, ::1], f8[:, ::1])")
def _shift_block(points: Points, block: int, ways: Vectors, out: Points) -> None:
    """The way of one block of points that all move alike."""
    first = block * BLOCK
    last = min(len(points), first + BLOCK)
    for i in range(first, last):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for step in range(len(ways)):
            x += ways[step, 0]
            y += ways[step, 1]
            z += ways[step, 2]
        out[i, 0], out[i, 1], out[i, 2] = x, y, z


@kernel("void(f8[:, ::1], i8, i4[::1], f8[::1], i8[:, ::1], f8[:, ::1], f8[:, ::1])")
def _advect_block(
    points: Points, block: int, kinds: Indices, tables: Floats, steps: AnyArray, spans: Floats, out: Points
) -> None:
    """The way of one block of points."""
    first = block * BLOCK
    n = min(BLOCK, len(points) - first)
    s = np.zeros(STAGE + levels(kinds) * LEVEL)
    load(points, first, n, s, HERE)
    for step in range(len(spans)):
        _step(kinds, steps, tables, step, spans, n, s)
    store(s, HERE, first, n, out)


@kernel("f8[:, ::1](i4[::1], f8[::1], i8[:, ::1], f8[:, ::1])")
def _same_everywhere(kinds: Indices, tables: Floats, steps: AnyArray, spans: Floats) -> Vectors:
    """The ways (S, 3) of all points where there are translations alone, else none (0, 3)."""
    for kind in kinds:
        if kind != TRANSLATION:
            return np.empty((0, 3))
    ways = np.empty((len(spans), 3))
    _ways(tables, steps, spans, ways)
    return ways


@kernel(COURSE)
def advect(
    points: Points, kinds: Indices, tables: Floats, steps: AnyArray, spans: Floats, out: Points
) -> None:
    """Classical Runge-Kutta of order 4 from points (N, 3) into `out`, sub-step after sub-step.

    steps  (S, 3 or more): the program of each sub-step is kinds[steps[s, 0] : steps[s, 1]], and from
           tables[steps[s, 2]] on lie its tables at the start, middle and end of the sub-step
    spans  (S, 3): seconds of each sub-step; what is not looked at here; and how far, in scene units, it may
           take a point, whose x is NaN if it would have gone further
    """
    ways = _same_everywhere(kinds, tables, steps, spans)
    for block in range((len(points) + BLOCK - 1) // BLOCK):
        if len(ways):
            _shift_block(points, block, ways, out)
        else:
            _advect_block(points, block, kinds, tables, steps, spans, out)


@kernel(COURSE, parallel=True)
def advect_together(
    points: Points, kinds: Indices, tables: Floats, steps: AnyArray, spans: Floats, out: Points
) -> None:
    """The same by several threads."""
    ways = _same_everywhere(kinds, tables, steps, spans)
    for block in prange((len(points) + BLOCK - 1) // BLOCK):
        if len(ways):
            _shift_block(points, block, ways, out)
        else:
            _advect_block(points, block, kinds, tables, steps, spans, out)
