"""Points advected along the velocities of a program, block by block; parallel blocks share nothing.

Sub-steps are fixed, by the classical Runge-Kutta method of order 4, or each point halves them for itself (see
`adaptive`).
"""

from __future__ import annotations

import math

import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices, Points, Vectors
from pipeline.flow.kernels import adaptive
from pipeline.flow.kernels.adaptive import POSITION
from pipeline.flow.kernels.deformation_kernels import deform
from pipeline.flow.kernels.field_kernels import TRANSLATION
from pipeline.flow.kernels.instructions import (
    BLOCK,
    COLUMNS,
    DEFORMATIONS,
    LEVEL,
    U,
    X,
    Y,
    Z,
    clear_velocities,
    load,
    store,
)
from pipeline.flow.kernels.program import level_count, run_program
from pipeline.kernels import kernel

SLOPE = 3 * BLOCK  # three runs: the weighted sum of the stages' velocities
STAGE = 6 * BLOCK  # the level on which the program runs


@kernel("void(i4[::1], i8[:, ::1], f8[::1], i8, f8[:, ::1], i8, f8[::1])")
def _step(
    opcodes: Indices, steps: AnyArray, tables: Floats, step: int, spans: Floats, n: int, s: Floats
) -> None:
    """Advect n points by one classical Runge-Kutta sub-step; x becomes NaN beyond the maximum step."""
    first, last, start = steps[step, 0], steps[step, 1], steps[step, 2]
    size, h, max_step = (last - first) * COLUMNS, spans[step, 0], spans[step, 2]
    for i in range(3 * BLOCK):
        s[STAGE + i] = s[POSITION + i]
        s[SLOPE + i] = 0.0
    for stage in range(4):
        clear_velocities(s, STAGE)
        run_program(opcodes, first, last, tables, start + (stage + 1) // 2 * size, n, s, STAGE)
        weight = 1.0 if stage in (0, 3) else 2.0
        ahead = h if stage == 2 else 0.5 * h
        for i in range(3 * BLOCK):
            s[SLOPE + i] += weight * s[STAGE + U + i]
            s[STAGE + i] = s[POSITION + i] + ahead * s[STAGE + U + i]
    for i in range(3 * BLOCK):
        s[POSITION + i] += h / 6.0 * s[SLOPE + i]
    if max_step < math.inf:
        limit2 = (6.0 * max_step / h) ** 2 if h != 0.0 else math.inf
        slopes, positions = s[SLOPE:], s[POSITION:]
        for i in range(n):
            u, v, w = slopes[X + i], slopes[Y + i], slopes[Z + i]
            if u * u + v * v + w * w > limit2:
                positions[X + i] = math.nan


@kernel("UniTuple(f8, 3)(f8[::1], i8, i8)")
def _sum_of_rows(tables: Floats, first: int, last: int) -> tuple[float, float, float]:
    """Return the velocity of translations whose rows are tables[first:last]."""
    u, v, w = 0.0, 0.0, 0.0
    for o in range(first, last, COLUMNS):
        u += tables[o]
        v += tables[o + 1]
        w += tables[o + 2]
    return u, v, w


@kernel("void(f8[::1], i8[:, ::1], f8[:, ::1], f8[:, ::1])")
def _translation_steps(tables: Floats, steps: AnyArray, spans: Floats, shifts: Vectors) -> None:
    """Compute the shift (S, 3) of all points in each sub-step of translations, with the bits of `_step`."""
    for step in range(len(spans)):
        size, start = (steps[step, 1] - steps[step, 0]) * COLUMNS, steps[step, 2]
        a = _sum_of_rows(tables, start, start + size)
        b = _sum_of_rows(tables, start + size, start + 2 * size)
        c = _sum_of_rows(tables, start + 2 * size, start + 3 * size)
        h, max_step = spans[step, 0], spans[step, 2]
        for axis in range(3):
            shifts[step, axis] = h / 6.0 * (a[axis] + 2.0 * b[axis] + 2.0 * b[axis] + c[axis])
        if max_step < math.inf and not math.sqrt((shifts[step] ** 2).sum()) <= max_step:
            shifts[step, 0] = math.nan


@kernel("void(f8[:, ::1], i8, f8[:, ::1], f8[:, ::1])")
def _shift_block(points: Points, block: int, shifts: Vectors, out: Points) -> None:
    """Move one block of points by the same shifts."""
    first = block * BLOCK
    last = min(len(points), first + BLOCK)
    for i in range(first, last):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for step in range(len(shifts)):
            x += shifts[step, 0]
            y += shifts[step, 1]
            z += shifts[step, 2]
        out[i, 0], out[i, 1], out[i, 2] = x, y, z


@kernel("void(f8[:, ::1], i8, i4[::1], f8[::1], i8[:, ::1], f8[:, ::1], b1, f8[:, ::1])")
def _advect_block(
    points: Points,
    block: int,
    opcodes: Indices,
    tables: Floats,
    steps: AnyArray,
    spans: Floats,
    halved: bool,
    out: Points,
) -> None:
    """Advect one block of points."""
    first = block * BLOCK
    n = min(BLOCK, len(points) - first)
    s = np.zeros((adaptive.STAGE if halved else STAGE) + level_count(opcodes) * LEVEL)
    load(points, first, n, s, POSITION)
    if halved:
        marks = np.zeros((3, BLOCK), np.int64)
        for step in range(len(spans)):
            adaptive.advance_span(opcodes, tables, steps[step], spans[step], n, s, marks)
    else:
        for step in range(len(spans)):
            kind = opcodes[steps[step, 0]] if steps[step, 0] < steps[step, 1] else 0
            if kind >= DEFORMATIONS:
                deform(kind, tables, steps[step, 2], n, s, POSITION)
            else:
                _step(opcodes, steps, tables, step, spans, n, s)
    store(s, POSITION, first, n, out)


@kernel("f8[:, ::1](i4[::1], f8[::1], i8[:, ::1], f8[:, ::1], b1)")
def _uniform_shifts(
    opcodes: Indices, tables: Floats, steps: AnyArray, spans: Floats, halved: bool
) -> Vectors:
    """Return the shifts (S, 3) of all points in fixed sub-steps of translations, else an empty array."""
    for kind in opcodes:
        if kind != TRANSLATION:
            return np.empty((0, 3))
    shifts = np.empty((0 if halved else len(spans), 3))
    _translation_steps(tables, steps, spans[: len(shifts)], shifts)
    return shifts


STEP_PLAN = "void(f8[:, ::1], i4[::1], f8[::1], i8[:, ::1], f8[:, ::1], b1, f8[:, ::1])"
"""The signature of kernels that run a step plan: (points, opcodes, tables, steps, spans, halved, out)."""


@kernel(STEP_PLAN)
def advect(
    points: Points,
    opcodes: Indices,
    tables: Floats,
    steps: AnyArray,
    spans: Floats,
    halved: bool,
    out: Points,
) -> None:
    """Advect points (N, 3) into `out`, span after span.

    steps   (S, 6): the program of each span is opcodes[steps[s, 0] : steps[s, 1]]; its tables begin at
            tables[steps[s, 2]]: those of its start, middle and end, or where it is halved, at most
            steps[s, 3] times, those for the sub-steps of steps[s, 4] halvings, steps[s, 5] each and one more;
            finer sub-steps take the nearest. Of a deformation, which no span of a halved plan is, the row
    spans   (S, 3): seconds of each span; the largest error, of halved spans, and the maximum step, in scene
            units
    halved  True if each point halves the spans for itself; else each span is one fixed sub-step

    x becomes NaN where a fixed sub-step exceeds the maximum step, and where a point is not finite; it is
    infinite where a point would need finer sub-steps.
    """
    shifts = _uniform_shifts(opcodes, tables, steps, spans, halved)
    for block in range((len(points) + BLOCK - 1) // BLOCK):
        if len(shifts):
            _shift_block(points, block, shifts, out)
        else:
            _advect_block(points, block, opcodes, tables, steps, spans, halved, out)
