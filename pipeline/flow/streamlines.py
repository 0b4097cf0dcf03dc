"""The flow that follows the streamlines of a velocity field, and its sub-steps as the kernels take them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any, ClassVar, NamedTuple

import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices, Points
from pipeline.errors import FrameError
from pipeline.flow import _kernels_halving as halving
from pipeline.flow import _kernels_velocity as kernels
from pipeline.flow._kernels_halving import EMBEDDED
from pipeline.flow._kernels_opcodes import COLUMNS
from pipeline.flow.flow import Flow, for_kernels
from pipeline.flow.program import Program, identity_of, kinds_of, owners_of, table_of
from pipeline.flow.velocity import VelocityField

STEP_LIMIT = 0.1
"""The longest sub-step times the steepest velocity gradient.

The classical Runge-Kutta step leaves out the terms of the exponential from (h L)^5 / 120 on, so at a
tenth one sub-step errs by about 1e-7 of the distance over which the field varies.
"""

MOST_SUBSTEPS = 10_000


WORTH_SHARING = 8000  # steps of points: fewer are done before a second thread has begun


class StepPlan(NamedTuple):
    """Sub-steps along velocity fields, one after another, as a kernel takes them.

    kinds    int32 (K,), the kinds of all the fields
    tables   float64, their tables, flat
    steps    int64 (S, 6): the first field of each sub-step, the one after its last, where its tables begin,
             how often a point may halve it, and what tables there are (see `_kernels_halving.follow`)
    spans    float64 (S, 3): seconds; and how large, in scene units, error and way of a sub-step may be
    owners   of the memory whose addresses stand in the tables
    halved   whether points may halve the sub-steps
    """

    kinds: Indices
    tables: Floats
    steps: AnyArray
    spans: Floats
    owners: tuple[Any, ...] = ()
    halved: bool = False

    @classmethod
    def joined(cls, plans: Sequence[StepPlan]) -> StepPlan:
        """All of them in order, as one. They are of one kind, `halved` or not."""
        shift, steps = np.zeros(6, np.int64), []
        for plan in plans:
            steps.append(plan.steps + shift)
            shift[:3] += (len(plan.kinds), len(plan.kinds), len(plan.tables))
        return cls(
            np.concatenate([plan.kinds for plan in plans]),
            np.concatenate([plan.tables for plan in plans]),
            np.concatenate(steps),
            np.concatenate([plan.spans for plan in plans]),
            tuple({id(owner): owner for plan in plans for owner in plan.owners}.values()),
            plans[0].halved,
        )

    def follow(self, points: Points) -> Points:
        """Where points (N, 3) are at its end; not finite where it is too coarse for the point's way."""
        points = for_kernels(points)
        out = np.empty_like(points)
        together = len(points) * len(self.spans) > WORTH_SHARING
        if self.halved:
            kernel = halving.follow_together if together else halving.follow
        else:
            kernel = kernels.advect_together if together else kernels.advect
        kernel(points, *self[:4], out)
        return out


ADAPTIVE_LIMIT = 0.5
"""The same for sub-steps whose error is estimated: within it the estimate can be trusted."""

DEFAULT_TOLERANCE = 1e-5
"""Scene units that a sub-step may err: a hundredth of a pixel, where a picture is some units wide."""

FIRST_HALVINGS = 2
"""So often a sub-step may be halved before a finer plan is worked out."""

RESOLVED, RESOLVED_BY_WAY = 5, 2
"""What changes in time is known at the sub-steps of so many halvings, and finer ones take the nearest: with a
tolerance, and with a maximum step alone."""


class Halving(NamedTuple):
    """How points may halve sub-steps.

    deepest   how often
    resolved  how often for the tables; those of finer sub-steps are the nearest
    parts     tables for each sub-step, beside the first: its middle and end, or its quarters
    """

    deepest: int = 0
    resolved: int = 0
    parts: int = 2

    @property
    def nodes(self) -> int:
        """Tables for each sub-step, beside the first."""
        return self.parts << self.resolved


@dataclass(frozen=True)
class Streamlines(Flow):
    """Points carried along a velocity field by the classical Runge-Kutta method of order 4.

    substeps   into how many steps a frame is divided; None chooses the least that keeps sub-step × steepness
               of the field below STEP_LIMIT, with a tolerance ADAPTIVE_LIMIT
    tolerance  scene units: how much a sub-step may err, by the estimate of an embedded method of order 3
    max_step   scene units: how far a sub-step may take a point

    With one of the last two each point halves its sub-steps until they are small enough, up to MOST_SUBSTEPS
    a frame: see `_kernels_halving`.
    """

    field: VelocityField
    substeps: int | None = None
    tolerance: float | None = None
    max_step: float | None = None

    order: ClassVar[int] = 4

    def displace(self, points: Points, time: float, dt: float) -> Points:
        """Raises FrameError where a point would need more sub-steps than there may be."""
        moved = self.step_plan(time, dt).follow(points)
        if self.limited:
            finite = np.isfinite(moved)
            if not finite.all():
                lost = ~finite.all(axis=1)
                moved[lost] = self._closely(points[lost], time, dt)
        return moved

    def with_max_step(self, max_step: float) -> Streamlines:
        return replace(self, max_step=max_step)

    @property
    def limited(self) -> bool:
        """Whether its points halve their sub-steps."""
        return self.tolerance is not None or self.max_step is not None

    def step_plan(self, time: float, dt: float, closely: bool = False) -> StepPlan:
        """The sub-steps of this step; `closely`, as fine as points may have them.

        Raises FrameError where they are more than MOST_SUBSTEPS.
        """
        wanted = self._substeps(time, dt)
        if not wanted <= MOST_SUBSTEPS:
            raise FrameError(
                f"flow {self.name} at {time:g} s is so steep or finely cut that a frame takes {wanted:.3g} "
                f"sub-steps; {MOST_SUBSTEPS} are the most. Lower its strength or widen its radius."
            )
        count = int(wanted)
        halving = self._halving(count, closely)
        programs = self._programs(time, dt, count * halving.nodes)
        kinds = kinds_of(programs[0])
        tables = np.concatenate([table_of(program) for program in programs])
        steps = np.zeros((count, 6), np.int64)
        steps[:, 1], steps[:, 3:] = len(kinds), halving
        steps[:, 2] = halving.nodes * len(kinds) * COLUMNS * np.arange(count)
        limits = [math.inf if limit is None else limit for limit in (self.tolerance, self.max_step)]
        spans = np.tile([dt / count, *limits], (count, 1))
        halved = closely or self.tolerance is not None
        return StepPlan(kinds, tables.ravel(), steps, spans, owners_of(programs[0]), halved)

    def cache_data(self, time: float, dt: float) -> Any:
        """A field too steep to follow has data too, without a step: its frame fails, and not before."""
        wanted = self._substeps(time, dt)
        feasible = wanted <= MOST_SUBSTEPS
        count = int(wanted) if feasible else 1
        halving = self._halving(count, closely=self.limited)
        programs = [identity_of(program) for program in self._programs(time, dt, count * halving.nodes)]
        step = dt / count if feasible else None
        if not self.limited:
            return {"streamlines": programs, "step": step}
        limits = {"tolerance": self.tolerance, "max_step": self.max_step}
        same = [[len(list(group)), program] for program, group in groupby(programs)]
        return {"streamlines": same, "step": step, **limits}

    @property
    def name(self) -> str:
        return self.field.name

    def _substeps(self, time: float, dt: float) -> float:
        """How many are given, or asked for by the limit at the start, middle and end of the step."""
        if self.substeps:
            return self.substeps
        steepest = max(self.field.gradient_bound(t) for t in (time, time + dt / 2, time + dt))
        wanted = steepest * abs(dt) / (STEP_LIMIT if self.tolerance is None else ADAPTIVE_LIMIT)
        return max(1, math.ceil(wanted)) if math.isfinite(wanted) else math.inf

    def _halving(self, count: int, closely: bool) -> Halving:
        """Of `count` sub-steps."""
        estimated = self.tolerance is not None
        if not (closely or estimated):
            return Halving()
        most = (MOST_SUBSTEPS // count).bit_length() - 1
        deepest = most if closely else min(most, FIRST_HALVINGS)
        resolved = min(deepest, RESOLVED if estimated else RESOLVED_BY_WAY)
        return Halving(deepest, resolved, EMBEDDED if estimated else 2)

    def _programs(self, time: float, dt: float, count: int) -> list[Program]:
        """At the ends of `count` equal parts of the step."""
        return [self.field.program(float(t)) for t in time + dt * np.arange(count + 1) / count]

    def _closely(self, points: Points, time: float, dt: float) -> Points:
        """Points (N, 3), by sub-steps as fine as they may be."""
        moved = self.step_plan(time, dt, closely=True).follow(points)
        failed = np.flatnonzero(np.isinf(moved[:, 0]))
        if not failed.size:
            return moved
        where = ", ".join(f"{x:.4g}" for x in points[failed[0]])
        bounds = [
            f"{what} {limit:.3g} units"
            for what, limit in (("err by at most", self.tolerance), ("go at most", self.max_step))
            if limit is not None
        ]
        raise FrameError(
            f"flow {self.name} at {time:g} s moves a point from ({where}) so that sub-steps which "
            f"{' and '.join(bounds)} would be more than {MOST_SUBSTEPS} a frame. Lower its strength, raise "
            f"{'max_step' if self.tolerance is None else 'tolerance'}, or let a region end with a falloff."
        )
