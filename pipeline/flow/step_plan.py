"""Sub-steps of a flow as the kernels take them, and the compiled calls that move points along them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from time import perf_counter
from typing import Any, NamedTuple

import numba
import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices, Points
from pipeline.flow.kernels import streamline_kernels as kernels
from pipeline.flow.kernels.instructions import BLOCK, COLUMNS, EXTERNAL, PARALLEL_FROM
from pipeline.flow.parameters import kernel_points
from pipeline.kernels import in_threads
from pipeline.long_computations import report_progress
from pipeline.mesh.point_order import morton_order

CALL_SECONDS = 0.25
"""The time of one compiled call, about: between two of them progress is reported and Ctrl-C is obeyed."""

FIRST_CALL = 1 << 19
"""Points × sub-steps of the first compiled call, where points do not halve them."""

LARGEST_GROWTH = 8.0
"""The most that a call may have more points than the one before."""


class StepPlan(NamedTuple):
    """Sub-steps along velocity fields, and deformations, one after another, as a kernel takes them.

    opcodes  int32 (K,), the opcodes of all programs
    tables   float64, their tables, flat
    steps    int64 (S, 6): each sub-step's first opcode, the one after its last, the start of its tables, how
             often a point may halve it, and its tables (see `kernels.streamlines.advect`)
    spans    float64 (S, 3): seconds, tolerance and maximum step of each sub-step
    owners   keep the memory at the addresses in the tables
    halved   True if points may halve the sub-steps
    """

    opcodes: Indices
    tables: Floats
    steps: AnyArray
    spans: Floats
    owners: tuple[Any, ...] = ()
    halved: bool = False

    @classmethod
    def joined(cls, plans: Sequence[StepPlan]) -> StepPlan:
        """Return all plans in order as one. They are all `halved` or all not."""
        shift, steps = np.zeros(6, np.int64), []
        for plan in plans:
            steps.append(plan.steps + shift)
            shift[:3] += (len(plan.opcodes), len(plan.opcodes), len(plan.tables))
        return cls(
            np.concatenate([plan.opcodes for plan in plans]),
            np.concatenate([plan.tables for plan in plans]),
            np.concatenate(steps),
            np.concatenate([plan.spans for plan in plans]),
            tuple({id(owner): owner for plan in plans for owner in plan.owners}.values()),
            plans[0].halved,
        )

    @classmethod
    def of_deformation(
        cls, seconds: float, opcode: int | None = None, numbers: tuple[float, ...] = ()
    ) -> StepPlan:
        """Return one row that moves points itself, or without an opcode a plan that moves none."""
        rows = 0 if opcode is None else 1
        tables, steps = np.zeros(rows * COLUMNS), np.zeros((rows, 6), np.int64)
        tables[: len(numbers)] = numbers
        steps[:, 1] = rows
        spans = np.tile([seconds, math.inf, math.inf], (rows, 1))
        return cls(np.array([] if opcode is None else [opcode], np.int32), tables, steps, spans)

    def follow(self, points: Points, activity: str = "flow") -> Points:
        """Return the positions of points (N, 3) at its end; not finite where it is too coarse for a point.

        One compiled call moves as many points as it can in about CALL_SECONDS, so that progress is reported
        under the name of the `activity`, and that Ctrl-C ends a long frame.
        """
        points = kernel_points(points)
        if not self.halved and len(points) <= BLOCK and len(points) * len(self.spans) <= PARALLEL_FROM:
            out = np.empty_like(points)  # as below, without what takes longer than so few points
            kernels.advect(points, *self[:4], self.halved, out)
            return out
        # Neighbours halve sub-steps alike, and share what turbulence computes once for a place.
        gains_from_order = len(points) > BLOCK and (self.halved or EXTERNAL in self.opcodes)
        order = morton_order(points) if gains_from_order else None
        if order is not None:
            points = points[order]
        out = np.empty_like(points)
        parallel = len(points) * len(self.spans) > PARALLEL_FROM
        advect = partial(in_threads, kernels.advect, BLOCK) if parallel else kernels.advect
        for part in self._calls(len(points), activity):
            advect(points[part], *self[:4], self.halved, out[part])
        if order is not None:
            out[order] = out.copy()
        return out

    def _calls(self, count: int, activity: str) -> Iterator[slice]:
        """Yield the points of each compiled call. The first call is small; its time decides the next size.

        Calls hold whole blocks, at least one for each thread, and move points as a single call would.
        """
        first, fewest = 0, numba.get_num_threads()
        blocks = fewest if self.halved else max(fewest, FIRST_CALL // (BLOCK * max(1, len(self.spans))))
        while first < count:
            last = min(count, first + blocks * BLOCK)
            started = perf_counter()
            yield slice(first, last)
            seconds = perf_counter() - started
            growth = min(LARGEST_GROWTH, CALL_SECONDS / max(seconds, 1e-9))
            blocks = max(fewest, int(blocks * growth))
            first = last
            if seconds > 0.1 * CALL_SECONDS:
                report_progress(activity, last, count)
