"""Points along the velocities of a program by sub-steps that each point halves for itself.

The pair is Zonneveld's 4(3): the classical Runge-Kutta method, and a fifth stage at three quarters of the
step that makes a companion of order 3 of the same stages. The two differ by the estimate of the error,

    h · (2/3) · (−k₁ + 3 k₂ + 3 k₃ + 3 k₄ − 8 k₅)    k₅ at 3/4, x + h/32 · (5 k₁ + 7 k₂ + 13 k₃ − k₄)

Source: Zonneveld, *Automatic Numerical Integration*, Mathematical Centre Tracts 8 (1964); Hairer, Nørsett &
Wanner, *Solving Ordinary Differential Equations I*, §II.4.

Sub-steps are dyadic: a span of time, or a half of one, or a half of that. A point tries one, and where the
error or the way is too large it tries a smaller one from the same place; where there was much to spare, the
next may be twice as long if it begins where such a one can. All that decides is the point's own way, so its
bits depend neither on its block nor on its neighbours. Of a block the points that are furthest behind and
want the same sub-step take it together.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pipeline.arrays import AnyArray, Floats, Indices, Points
from pipeline.flow._kernels_block import BLOCK, LEVEL, U, X, Y, Z, load, rest, store
from pipeline.flow._kernels_bracket import levels
from pipeline.flow._kernels_opcodes import COLUMNS
from pipeline.flow._kernels_program import run
from pipeline.flow._kernels_velocity import COURSE
from pipeline.kernels import kernel

HOME = 0  # three runs: where the points of the block are
HERE = 3 * BLOCK  # three runs: those of them that take this sub-step
WAY = 6 * BLOCK  # three runs: what it adds to them
NEXT = 9 * BLOCK  # three runs: towards the fifth stage
GAP = 12 * BLOCK  # three runs: how far the companion lies from it
STAGE = 15 * BLOCK  # the level on which the program runs

AT, SIZE, WHO = range(3)
"""Marks of points: the moment each is at, how often its next span is halved; and who takes this sub-step."""

PARTS, EMBEDDED = 5, 4
"""The column of `steps` with how many tables there are for a span: EMBEDDED, if errors are estimated."""

GROWS = 16.0
"""By how much the estimate grows with a sub-step of twice the length."""


@kernel("i8(i8[::1], i8)")
def _table(program: AnyArray, quarters: int) -> int:
    """Where the table nearest in time lies; `quarters` of the finest sub-step from the span's start."""
    deepest, resolved, parts = program[3], program[4], program[PARTS]
    apart = (4 << deepest) // (parts << resolved)
    node = (2 * quarters + apart) // (2 * apart)
    table: int = program[2] + node * (program[1] - program[0]) * COLUMNS
    return table


@kernel("void(i4[::1], f8[::1], i8[::1], i8, i8, f8, i8, f8[::1])")
def _try(
    kinds: Indices, tables: Floats, program: AnyArray, begin: int, width: int, h: float, n: int, s: Floats
) -> None:
    """WAY and GAP of a sub-step of the n points HERE, from `begin` on, `width` finest sub-steps long."""
    first, last = program[0], program[1]
    for i in range(3 * BLOCK):
        s[STAGE + i] = s[HERE + i]
        s[WAY + i] = 0.0
        s[NEXT + i] = 0.0
        s[GAP + i] = 0.0
    for stage in range(4):
        rest(s, STAGE)
        table = _table(program, 4 * begin + (stage + 1) // 2 * 2 * width)
        run(kinds, first, last, tables, table, n, s, STAGE)
        weight = 1.0 if stage in (0, 3) else 2.0
        onwards = 5.0 if stage == 0 else 7.0 if stage == 1 else 13.0 if stage == 2 else -1.0
        beside = -1.0 if stage == 0 else 3.0
        ahead = h if stage == 2 else 0.5 * h
        for i in range(3 * BLOCK):
            s[WAY + i] += weight * s[STAGE + U + i]
            s[NEXT + i] += onwards * s[STAGE + U + i]
            s[GAP + i] += beside * s[STAGE + U + i]
            s[STAGE + i] = s[HERE + i] + ahead * s[STAGE + U + i]
    if program[PARTS] == EMBEDDED:
        for i in range(3 * BLOCK):
            s[STAGE + i] = s[HERE + i] + h / 32.0 * s[NEXT + i]
        rest(s, STAGE)
        run(kinds, first, last, tables, _table(program, 4 * begin + 3 * width), n, s, STAGE)
        for i in range(3 * BLOCK):
            s[GAP + i] = h / 1.5 * (s[GAP + i] - 8.0 * s[STAGE + U + i])
    else:
        for i in range(3 * BLOCK):
            s[GAP + i] = 0.0
    for i in range(3 * BLOCK):
        s[WAY + i] *= h / 6.0


@kernel("UniTuple(i8, 3)(i8, i8, f8[::1], i8[:, ::1])")
def _together(n: int, deepest: int, s: Floats, marks: AnyArray) -> tuple[int, int, int]:
    """Those furthest behind that want the same sub-step, put HERE: how many, when, and how often halved."""
    end = 1 << deepest
    begin = end
    for i in range(n):
        begin = min(begin, marks[AT, i])
    if begin == end:
        return 0, end, 0
    longest, moment = (0 if begin == 0 else deepest), begin
    while moment > 0 and moment & 1 == 0:
        moment >>= 1
        longest -= 1
    size = deepest
    for i in range(n):
        if marks[AT, i] == begin:
            size = min(size, max(longest, marks[SIZE, i]))
    many = 0
    for i in range(n):
        if marks[AT, i] == begin and max(longest, marks[SIZE, i]) == size:
            marks[WHO, many] = i
            for run_of in (X, Y, Z):
                s[HERE + run_of + many] = s[HOME + run_of + i]
            many += 1
    return many, begin, size


@kernel("f8(f8[::1], i8, i8)")
def _length(s: Floats, runs: int, j: int) -> float:
    """Of the vector of three runs."""
    x, y, z = s[runs + X + j], s[runs + Y + j], s[runs + Z + j]
    return math.sqrt(x * x + y * y + z * z)


@kernel("i8(f8, f8, f8, f8)")
def _halvings(way: float, gap: float, tolerance: float, stride: float) -> int:
    """How often to halve a sub-step until its error and its way are small enough; 0: it is."""
    if not (way < math.inf and gap < math.inf):
        return 1
    for_way, for_gap = 0, 0
    while way > stride:
        way *= 0.5
        for_way += 1
    while gap > tolerance:
        gap /= GROWS
        for_gap += 1
    return max(for_way, for_gap)


@kernel("void(i4[::1], f8[::1], i8[::1], f8[::1], i8, f8[::1], i8[:, ::1])")
def _through(
    kinds: Indices, tables: Floats, program: AnyArray, span: Floats, n: int, s: Floats, marks: AnyArray
) -> None:
    """All points of a block through one span."""
    deepest, tolerance, stride = program[3], span[1], span[2]
    end = 1 << deepest
    for i in range(n):
        marks[AT, i] = 0 if math.isfinite(s[HOME + X + i]) else end
        marks[SIZE, i] = 0
    while True:
        many, begin, size = _together(n, deepest, s, marks)
        if many == 0:
            return
        width = end >> size
        _try(kinds, tables, program, begin, width, span[0] / (1 << size), many, s)
        for j in range(many):
            i = marks[WHO, j]
            way, gap = _length(s, WAY, j), _length(s, GAP, j)
            more = _halvings(way, gap, tolerance, stride)
            if more == 0:
                for run_of in (X, Y, Z):
                    s[HOME + run_of + i] += s[WAY + run_of + j]
                marks[AT, i] = begin + width
                spare = 2.0 * way <= stride and 2.0 * GROWS * gap <= tolerance
                marks[SIZE, i] = max(size - 1, 0) if spare else size
            elif size < deepest:
                marks[SIZE, i] = min(size + more, deepest)
            else:
                s[HOME + X + i] = math.inf if way < math.inf and gap < math.inf else math.nan
                marks[AT, i] = end


@kernel("void(f8[:, ::1], i8, i4[::1], f8[::1], i8[:, ::1], f8[:, ::1], f8[:, ::1])")
def _follow_block(
    points: Points, block: int, kinds: Indices, tables: Floats, steps: AnyArray, spans: Floats, out: Points
) -> None:
    """The way of one block of points."""
    first = block * BLOCK
    n = min(BLOCK, len(points) - first)
    s = np.zeros(STAGE + levels(kinds) * LEVEL)
    marks = np.zeros((3, BLOCK), np.int64)
    load(points, first, n, s, HOME)
    for step in range(len(spans)):
        _through(kinds, tables, steps[step], spans[step], n, s, marks)
    store(s, HOME, first, n, out)


@kernel(COURSE)
def follow(
    points: Points, kinds: Indices, tables: Floats, steps: AnyArray, spans: Floats, out: Points
) -> None:
    """Points (N, 3) into `out`, span after span, each halved as often as a point wants.

    steps  (S, 6): the program of each span is kinds[steps[s, 0] : steps[s, 1]]; from tables[steps[s, 2]] on
           lie its tables; it is halved at most steps[s, 3] times; the tables are those of steps[s, 4]
           halvings, finer sub-steps take the nearest; for each there are steps[s, 5] more than the first
    spans  (S, 3): seconds of each span; the error, and the way, in scene units, of a sub-step at most

    x is infinite where a point's sub-steps would have to be finer, and NaN where it left the numbers.
    """
    for block in range((len(points) + BLOCK - 1) // BLOCK):
        _follow_block(points, block, kinds, tables, steps, spans, out)


@kernel(COURSE, parallel=True)
def follow_together(
    points: Points, kinds: Indices, tables: Floats, steps: AnyArray, spans: Floats, out: Points
) -> None:
    """The same by several threads."""
    for block in prange((len(points) + BLOCK - 1) // BLOCK):
        _follow_block(points, block, kinds, tables, steps, spans, out)
