"""Points advected along the velocities of a program, block by block; parallel blocks share nothing.

Sub-steps are fixed, by the classical Runge-Kutta method of order 4, or each point halves them for itself.
Then the pair is Zonneveld's 4(3): the classical method, and a fifth stage at three quarters of the step for
an embedded method of order 3. Their difference is the estimate of the error,

    h · (2/3) · (−k₁ + 3 k₂ + 3 k₃ + 3 k₄ − 8 k₅)    k₅ at 3/4, x + h/32 · (5 k₁ + 7 k₂ + 13 k₃ − k₄)

Source: Zonneveld, *Automatic Numerical Integration*, Mathematical Centre Tracts 8 (1964); Hairer, Nørsett &
Wanner, *Solving Ordinary Differential Equations I*, §II.4.

Halved sub-steps are dyadic: a span of time halved n times. A point tries one; where its error or its length
is too large, it tries a smaller one from the same position. Where both are far below their limits, the next
sub-step may be twice as long, if it begins at a multiple of its length. Only the point's own path decides, so
that its bits depend neither on its block nor on its neighbours. The points of a block that are furthest
behind in time and want the same sub-step take it together.
"""

from __future__ import annotations

import math

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Floats, Indices, Points, Vectors
from flowsculpt.pipeline.flow.kernels.deformation_kernels import deform
from flowsculpt.pipeline.flow.kernels.field_kernels import TRANSLATION, level_count, run_program
from flowsculpt.pipeline.flow.kernels.instructions import (
    BLOCK,
    COLUMNS,
    DEFORMATIONS,
    LEVEL,
    MAP,
    U,
    X,
    Y,
    Z,
    call_external,
    clear_velocities,
    load,
    store,
)
from flowsculpt.pipeline.kernels import kernel

POSITION = 0  # three runs: all points of the block
START = 3 * BLOCK  # three runs: the points that take this sub-step
STEP = 6 * BLOCK  # three runs: the displacement of the sub-step
FIFTH = 9 * BLOCK  # three runs: the sum that gives the position of the fifth stage
ERROR = 12 * BLOCK  # three runs: the estimate of the error
HALVED_STAGE = 15 * BLOCK  # the level on which the program runs

TIME, HALVINGS, CHOSEN = range(3)
"""Rows of `marks`: each point's time, the halvings of its next sub-step; the points that take this one."""

PARTS, EMBEDDED = 5, 4
"""The column of `steps` with the number of tables of a span; it is EMBEDDED where errors are estimated."""

ERROR_GROWTH = 16.0
"""The factor on the estimate of a sub-step of twice the length."""


@kernel("i8(i8[::1], i8)")
def _table(program: AnyArray, quarters: int) -> int:
    """Return the start of the table nearest in time to `quarters` finest quarter sub-steps into the span."""
    deepest, resolved, parts = program[3], program[4], program[PARTS]
    apart = (4 << deepest) // (parts << resolved)
    node = (2 * quarters + apart) // (2 * apart)
    table: int = program[2] + node * (program[1] - program[0]) * COLUMNS
    return table


@kernel("void(i4[::1], f8[::1], i8[::1], i8, i8, f8, i8, f8[::1])")
def _try_substep(
    opcodes: Indices, tables: Floats, program: AnyArray, begin: int, width: int, h: float, n: int, s: Floats
) -> None:
    """Compute STEP and ERROR of a sub-step of the n points at START, `width` finest sub-steps long."""
    first, last = program[0], program[1]
    for i in range(3 * BLOCK):
        s[HALVED_STAGE + i] = s[START + i]
        s[STEP + i] = 0.0
        s[FIFTH + i] = 0.0
        s[ERROR + i] = 0.0
    for stage in range(4):
        clear_velocities(s, HALVED_STAGE)
        table = _table(program, 4 * begin + (stage + 1) // 2 * 2 * width)
        run_program(opcodes, first, last, tables, table, n, s, HALVED_STAGE)
        weight = 1.0 if stage in (0, 3) else 2.0
        to_fifth = 5.0 if stage == 0 else 7.0 if stage == 1 else 13.0 if stage == 2 else -1.0
        in_error = -1.0 if stage == 0 else 3.0
        ahead = h if stage == 2 else 0.5 * h
        for i in range(3 * BLOCK):
            s[STEP + i] += weight * s[HALVED_STAGE + U + i]
            s[FIFTH + i] += to_fifth * s[HALVED_STAGE + U + i]
            s[ERROR + i] += in_error * s[HALVED_STAGE + U + i]
            s[HALVED_STAGE + i] = s[START + i] + ahead * s[HALVED_STAGE + U + i]
    if program[PARTS] == EMBEDDED:
        for i in range(3 * BLOCK):
            s[HALVED_STAGE + i] = s[START + i] + h / 32.0 * s[FIFTH + i]
        clear_velocities(s, HALVED_STAGE)
        run_program(opcodes, first, last, tables, _table(program, 4 * begin + 3 * width), n, s, HALVED_STAGE)
        for i in range(3 * BLOCK):
            s[ERROR + i] = h / 1.5 * (s[ERROR + i] - 8.0 * s[HALVED_STAGE + U + i])
    else:
        for i in range(3 * BLOCK):
            s[ERROR + i] = 0.0
    for i in range(3 * BLOCK):
        s[STEP + i] *= h / 6.0


@kernel("UniTuple(i8, 3)(i8, i8, f8[::1], i8[:, ::1])")
def _choose_points(n: int, deepest: int, s: Floats, marks: AnyArray) -> tuple[int, int, int]:
    """Copy the points to START that take the next sub-step; return their count, its time and its halvings."""
    end = 1 << deepest
    begin = end
    for i in range(n):
        begin = min(begin, marks[TIME, i])
    if begin == end:
        return 0, end, 0
    longest, time = (0 if begin == 0 else deepest), begin
    while time > 0 and time & 1 == 0:
        time >>= 1
        longest -= 1
    size = deepest
    for i in range(n):
        if marks[TIME, i] == begin:
            size = min(size, max(longest, marks[HALVINGS, i]))
    count = 0
    for i in range(n):
        if marks[TIME, i] == begin and max(longest, marks[HALVINGS, i]) == size:
            marks[CHOSEN, count] = i
            for axis in (X, Y, Z):
                s[START + axis + count] = s[POSITION + axis + i]
            count += 1
    return count, begin, size


@kernel("f8(f8[::1], i8, i8)")
def _length(s: Floats, runs: int, j: int) -> float:
    """Return the length of vector j of three runs."""
    x, y, z = s[runs + X + j], s[runs + Y + j], s[runs + Z + j]
    return math.sqrt(x * x + y * y + z * z)


@kernel("i8(f8, f8, f8, f8)")
def _halvings(length: float, error: float, tolerance: float, max_step: float) -> int:
    """Return how often to halve a sub-step until its error and its length are within their limits."""
    if not (length < math.inf and error < math.inf):
        return 1
    for_length, for_error = 0, 0
    while length > max_step:
        length *= 0.5
        for_length += 1
    while error > tolerance:
        error /= ERROR_GROWTH
        for_error += 1
    return max(for_length, for_error)


@kernel("void(i4[::1], f8[::1], i8[::1], f8[::1], i8, f8[::1], i8[:, ::1])")
def advance_span(
    opcodes: Indices, tables: Floats, program: AnyArray, span: Floats, n: int, s: Floats, marks: AnyArray
) -> None:
    """Advect all points of a block through one span."""
    deepest, tolerance, max_step = program[3], span[1], span[2]
    end = 1 << deepest
    for i in range(n):
        marks[TIME, i] = 0 if math.isfinite(s[POSITION + X + i]) else end
        marks[HALVINGS, i] = 0
    while True:
        count, begin, size = _choose_points(n, deepest, s, marks)
        if count == 0:
            return
        width = end >> size
        _try_substep(opcodes, tables, program, begin, width, span[0] / (1 << size), count, s)
        for j in range(count):
            i = marks[CHOSEN, j]
            length, error = _length(s, STEP, j), _length(s, ERROR, j)
            more = _halvings(length, error, tolerance, max_step)
            if more == 0:
                for axis in (X, Y, Z):
                    s[POSITION + axis + i] += s[STEP + axis + j]
                marks[TIME, i] = begin + width
                spare = 2.0 * length <= max_step and 2.0 * ERROR_GROWTH * error <= tolerance
                marks[HALVINGS, i] = max(size - 1, 0) if spare else size
            elif size < deepest:
                marks[HALVINGS, i] = min(size + more, deepest)
            else:
                s[POSITION + X + i] = math.inf if length < math.inf and error < math.inf else math.nan
                marks[TIME, i] = end


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
    s = np.zeros((HALVED_STAGE if halved else STAGE) + level_count(opcodes) * LEVEL)
    load(points, first, n, s, POSITION)
    if halved:
        marks = np.zeros((3, BLOCK), np.int64)
        for step in range(len(spans)):
            advance_span(opcodes, tables, steps[step], spans[step], n, s, marks)
    else:
        for step in range(len(spans)):
            kind = opcodes[steps[step, 0]] if steps[step, 0] < steps[step, 1] else 0
            if kind == MAP:
                s[SLOPE:STAGE] = 0.0
                call_external(tables, steps[step, 2], n, s, POSITION)
                for i in range(3 * BLOCK):
                    s[POSITION + i] += s[SLOPE + i]
            elif kind >= DEFORMATIONS:
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
