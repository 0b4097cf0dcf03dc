"""The flow along the streamlines of a velocity field, by sub-steps that compiled calls move points along."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import groupby, pairwise
from time import perf_counter
from typing import Any, NamedTuple

import numba
import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Floats, Indices, Points
from flowsculpt.pipeline.errors import FrameError
from flowsculpt.pipeline.flow.flow import Flow, FlowStep
from flowsculpt.pipeline.flow.kernels import streamline_kernels as kernels
from flowsculpt.pipeline.flow.kernels.instructions import BLOCK, COLUMNS, MAP, PARALLEL_FROM
from flowsculpt.pipeline.flow.parameters import kernel_points, vector_at
from flowsculpt.pipeline.flow.velocity import Program, VelocityField, opcodes_of, sensitivity, table_of
from flowsculpt.pipeline.kernels import in_threads
from flowsculpt.pipeline.long_computations import Progress
from flowsculpt.pipeline.mesh.meshes import morton_order

CALL_SECONDS = 0.25
"""The time of one compiled call, about: between two of them progress is reported and Ctrl-C is obeyed."""

FIRST_CALL = 1 << 19  # points × sub-steps of the first compiled call, where points do not halve them
LARGEST_GROWTH = 8.0  # the most that a call may have more points than the one before


class StepPlan(NamedTuple):
    """Sub-steps along velocity fields, and deformations, one after another, as a kernel takes them.

    opcodes  int32 (K,), the opcodes of all programs
    tables   float64, their tables, flat
    steps    int64 (S, 6): each sub-step's first opcode, the one after its last, the start of its tables, how
             often a point may halve it, and its tables (see `streamline_kernels.advect`)
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

    @classmethod
    def of_kernel_row(cls, flow: Flow, time: float, dt: float) -> StepPlan | None:
        """Return the step of a flow that has a compiled function; None for others."""
        row = flow.kernel_row(time, dt)
        if row is None:
            return None
        kernel, numbers = row
        plan = cls.of_deformation(dt, MAP, (float(kernel.address), time, *numbers))
        return plan._replace(owners=(kernel,))

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
        gains_from_order = self.halved or any(getattr(o, "gains_from_order", False) for o in self.owners)
        order = morton_order(points) if gains_from_order and len(points) > BLOCK else None
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
                Progress(activity, last, count).report()


STEP_LIMIT = 0.1
"""The largest sub-step × gradient bound.

The classical Runge-Kutta step leaves out the terms of the exponential from (h L)^5 / 120 on, so that at a
tenth the error of a sub-step is about 1e-7 of the distance over which the field varies.
"""

LENGTH_SHARE = 0.5  # the longest move of a point in a sub-step, in length scales of the field

ADAPTIVE_LIMIT = 0.5
"""The largest sub-step × gradient bound where the error is estimated: within it the estimate is reliable."""

DEFAULT_TOLERANCE = 1e-5
"""The error of a sub-step in scene units: a hundredth of a pixel where a picture is some units wide."""

MAX_SUBSTEPS = 10_000  # sub-steps of one frame
FIRST_HALVINGS = 2  # halvings of a sub-step before a finer plan is computed

RESOLVED, RESOLVED_MAX_STEP = 5, 2
"""Halvings for whose sub-steps there are tables, with a tolerance and with a maximum step alone; finer
sub-steps take the table nearest in time."""


class Halving(NamedTuple):
    """The limits of how points halve sub-steps.

    deepest   halvings at most
    resolved  halvings for whose sub-steps there are tables
    parts     tables per sub-step after the first: at its middle and end, or its quarters
    """

    deepest: int = 0
    resolved: int = 0
    parts: int = 2

    @property
    def tables(self) -> int:
        """Tables for each sub-step before halving, after the first."""
        return self.parts << self.resolved


@dataclass(frozen=True)
class _Moment:
    """A velocity field at one time, each value found when it is first asked for.

    places  the fields it is composed of, each with the origin's place from its centre, in its coordinates
    """

    field: VelocityField
    time: float

    @cached_property
    def gradient_bound(self) -> float:
        return self.field.gradient_bound(self.time)

    @cached_property
    def length_scale(self) -> float:
        return self.field.length_scale(self.time)

    @cached_property
    def places(self) -> list[tuple[VelocityField, list[float]]]:
        places = []
        for leaf, point in self.field.leaves(np.zeros(3), self.time):
            place = point - vector_at(leaf.centre, self.time) if hasattr(leaf, "centre") else point
            places.append((leaf, place.tolist()))
        return places


@dataclass(frozen=True)
class Streamlines(Flow):
    """Points carried along a velocity field by the classical Runge-Kutta method of order 4.

    substeps   the number of sub-steps of a frame; None chooses the fewest whose length × gradient bound is
               below STEP_LIMIT, or with a tolerance ADAPTIVE_LIMIT
    tolerance  the largest error of a sub-step, scene units, by the estimate of an embedded method of order 3
    max_step   the longest displacement of a point in a sub-step, scene units; None is LENGTH_SHARE of the
               field's length scale, or any where `substeps` is given

    Each point halves its sub-steps until they meet the tolerance and the maximum step, up to MAX_SUBSTEPS a
    frame: see `streamline_kernels`. The gradient bound alone would not do: where one field carries a point
    fast and evenly, the point could pass by a narrow vortex of another.
    """

    field: VelocityField
    substeps: int | None = None
    tolerance: float | None = None
    max_step: float | None = None

    def steps(self, time: float, dt: float) -> Iterator[FlowStep]:
        """Yield the step in parts, which end where the velocities bend in time."""
        begin, left = time, dt
        for kink in sorted(self.field.kinks(time, dt), reverse=dt < 0):
            yield FlowStep(self, begin, kink - begin)
            begin, left = kink, time + dt - kink
        yield FlowStep(self, begin, left)

    def displace(self, points: Points, time: float, dt: float) -> Points:
        """Advect points. Raises FrameError where a point would need more than MAX_SUBSTEPS."""
        for _, begin, length in self.steps(time, dt):
            points = self._displace(points, begin, length)
        return points

    def _displace(self, points: Points, time: float, dt: float) -> Points:
        moved = self.step_plan(time, dt).follow(points, self.name)
        lost = ~np.isfinite(moved).all(axis=1)
        if lost.any() and (self.tolerance is not None or self.longest_step(time, dt) < math.inf):
            moved[lost] = self._displace_finely(points[lost], time, dt)
        return moved

    def with_max_step(self, max_step: float) -> Streamlines:
        return replace(self, max_step=max_step)

    def longest_step(self, time: float, dt: float) -> float:
        """Return the longest displacement of a point in a sub-step, scene units; infinite where none is."""
        if self.max_step is not None:
            return self.max_step
        if self.substeps:
            return math.inf
        return LENGTH_SHARE * min(moment.length_scale for moment in self._moments(time, dt))

    def step_plan(self, time: float, dt: float, finest: bool = False) -> StepPlan:
        """Return the sub-steps of a step; `finest`: as fine as a point may need them.

        Raises FrameError where they are more than MAX_SUBSTEPS.
        """
        wanted = self.gradient_substeps(time, dt)
        if not wanted <= MAX_SUBSTEPS:
            raise FrameError(
                f"flow {self.name} at {time:g} s needs {wanted:.3g} sub-steps a frame; {MAX_SUBSTEPS} are "
                f"the most. {self._remedy(time)}"
            )
        count = int(wanted)
        halving = self._halving(count, finest)
        programs = self._programs(time, dt, count * halving.tables)
        opcodes = opcodes_of(programs[0])
        tables = np.concatenate([table_of(program) for program in programs])
        steps = np.zeros((count, 6), np.int64)
        steps[:, 1], steps[:, 3:] = len(opcodes), halving
        steps[:, 2] = halving.tables * len(opcodes) * COLUMNS * np.arange(count)
        limits = [math.inf if self.tolerance is None else self.tolerance, self.longest_step(time, dt)]
        spans = np.tile([dt / count, *limits], (count, 1))
        owners = {id(owner): owner for rows in programs for row in rows if (owner := row.owner) is not None}
        is_halved = finest or self.tolerance is not None
        return StepPlan(opcodes, tables.ravel(), steps, spans, tuple(owners.values()), is_halved)

    def cache_data(self, time: float, dt: float) -> Any:
        """Return data for too many sub-steps too, with no step: only their frame fails, when it is made."""
        parts = [self._part_data(*part[1:]) for part in self.steps(time, dt)]
        return parts if len(parts) > 1 else parts[0]

    def _part_data(self, time: float, dt: float) -> Any:
        wanted = self.gradient_substeps(time, dt)
        feasible = wanted <= MAX_SUBSTEPS
        count = int(wanted) if feasible else 1
        longest = self.longest_step(time, dt)
        is_halved = self.tolerance is not None or longest < math.inf
        halving = self._halving(count, finest=is_halved)
        programs = [
            [row.as_data() for row in program] for program in self._programs(time, dt, count * halving.tables)
        ]
        step = dt / count if feasible else None
        if not is_halved:
            return {"streamlines": programs, "step": step}
        limits = {"tolerance": self.tolerance, "max_step": longest if longest < math.inf else None}
        runs = [[len(list(group)), program] for program, group in groupby(programs)]
        return {"streamlines": runs, "step": step, **limits}

    @property
    def name(self) -> str:
        return self.field.name

    def holds_much(self, time: float) -> bool:
        """Tell whether the plan of a step holds so much memory that it may not outlive the step."""
        return any(leaf.holds_much for leaf, _ in self.field.leaves(np.zeros(3), time))

    def gradient_substeps(self, time: float, dt: float) -> float:
        """Return the sub-steps of a step before any is halved: as given, or by the gradient bound.

        The bound is the largest of start, middle and end; infinite where it is not finite. A field that moves
        itself, as a vortex with a keyed centre does, passes no point between two stages either.
        """
        if self.substeps:
            return self.substeps
        bound = max(moment.gradient_bound for moment in self._moments(time, dt))
        wanted = bound * abs(dt) / (STEP_LIMIT if self.tolerance is None else ADAPTIVE_LIMIT)
        if self.max_step is None:
            wanted = max(wanted, self._drift(time, dt) / LENGTH_SHARE)
        return max(1, math.ceil(wanted)) if math.isfinite(wanted) else math.inf

    def _drift(self, time: float, dt: float) -> float:
        """Return how far the fields move themselves in a step, at most, in their length scales."""
        drift, middle = 0.0, time + dt / 2
        for seen in zip(*(moment.places for moment in self._moments(time, dt)), strict=True):
            moved = sum(math.dist(one, other) for (_, one), (_, other) in pairwise(seen))
            leaf = seen[1][0]
            if moved and leaf.gradient_bound(middle) > 0:
                drift = max(drift, moved / leaf.length_scale(middle))
        return drift

    def _remedy(self, time: float) -> str:
        """Return what lowers the number of sub-steps, as a sentence."""
        if self.substeps:
            return "Lower substeps."
        leaves = [leaf for leaf, _ in self.field.leaves(np.zeros(3), time)]
        strongest = max(leaves, key=lambda leaf: leaf.gradient_bound(time))
        changes = sensitivity(strongest, lambda field: field.gradient_bound(time), time)
        text = ", ".join(changes.remedies) + " or write substeps: 100, which is less exact"
        return f"{text[0].upper()}{text[1:]}." if changes else "Lower its speed."

    def _halving(self, count: int, finest: bool) -> Halving:
        """Return how points may halve each of `count` sub-steps."""
        estimated = self.tolerance is not None
        if not (finest or estimated):
            return Halving()
        most = (MAX_SUBSTEPS // count).bit_length() - 1
        deepest = most if finest else min(most, FIRST_HALVINGS)
        resolved = min(deepest, RESOLVED if estimated else RESOLVED_MAX_STEP)
        return Halving(deepest, resolved, kernels.EMBEDDED if estimated else 2)

    def _programs(self, time: float, dt: float, count: int) -> list[Program]:
        """Return the programs at the ends of `count` equal parts of the step."""
        return [self.field.program(float(t)) for t in time + dt * np.arange(count + 1) / count]

    def _moments(self, time: float, dt: float) -> list[_Moment]:
        """Return the field at the start, the middle and the end of a step, which is the start of the next."""
        times = (time, time + dt / 2, time + dt)
        moments = [self._latest.get(t) or _Moment(self.field, t) for t in times]
        vars(self)["_latest"] = dict(zip(times, moments, strict=True))
        return moments

    @cached_property
    def _latest(self) -> dict[float, _Moment]:
        """The field at the times of the latest step."""
        return {}

    def _displace_finely(self, points: Points, time: float, dt: float) -> Points:
        """Advect points (N, 3) by sub-steps as fine as they need."""
        moved = self.step_plan(time, dt, finest=True).follow(points, self.name)
        failed = np.flatnonzero(np.isinf(moved[:, 0]))
        if not failed.size:
            return moved
        where = ", ".join(f"{x:.4g}" for x in points[failed[0]])
        bounds = [
            f"{what} {limit:.3g} units"
            for what, limit in (("an error of", self.tolerance), ("a step of", self.longest_step(time, dt)))
            if limit is not None and limit < math.inf
        ]
        raise FrameError(
            f"flow {self.name} at {time:g} s needs more than {MAX_SUBSTEPS} sub-steps a frame to move the "
            f"point at ({where}) with at most {' and '.join(bounds)}. Lower its strength, raise "
            f"{'max_step' if self.tolerance is None else 'tolerance'}, or give its region a falloff."
        )
