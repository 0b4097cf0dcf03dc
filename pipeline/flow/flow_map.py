"""Where points of the rest surface are now: a flow over all the frames since."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Points
from pipeline.errors import FlowsculptError, FrameError
from pipeline.flow.checked_displacement import checked_displacement, flow_error
from pipeline.flow.flow import Flow
from pipeline.flow.streamlines import StepPlan, Streamlines

LARGEST_STEP_PLAN = 1 << 20
"""Numbers in the tables of one kernel call: 8 MB."""


@dataclass(frozen=True)
class Step:
    """What acts on the way into `frame`: a flow from `time` on, for `dt` seconds."""

    flow: Flow
    time: float
    dt: float
    frame: int

    def apply(self, points: Points) -> Points:
        """Points (N, 3) moved, and looked at. Raises FrameError."""
        return checked_displacement(self.flow, points, self.time, self.dt, self.frame)


@dataclass(frozen=True)
class Leg:
    """Steps along streamlines, followed by one compiled call; points that need finer ones go step by step."""

    plan: StepPlan
    steps: tuple[Step, ...]

    def apply(self, points: Points) -> Points:
        """Points (N, 3) through all of it. Raises FrameError."""
        moved = self.plan.follow(points)
        finite = np.isfinite(moved)
        if not finite.all():
            lost = ~finite.all(axis=1)
            alone = points[lost]
            for step in self.steps:
                try:
                    alone = step.flow.displace(alone, step.time, step.dt)
                except FrameError as error:
                    raise error.of(step.frame) from None
            moved[lost] = alone
        return moved

    def fits(self, more: Leg) -> bool:
        """Whether one call can follow both."""
        size = len(self.plan.tables) + len(more.plan.tables)
        return size <= LARGEST_STEP_PLAN and self.plan.halved == more.plan.halved

    def joined(self, more: Leg) -> Leg:
        return Leg(StepPlan.joined([self.plan, more.plan]), self.steps + more.steps)


class History:
    """The steps of a shot since its rest frame, to carry rest points through all of them at once.

    A point carried arrives at the very bits where a vertex that started there was moved to, frame by frame:
    the same sub-steps are taken in the same order. Streamlines are followed by one compiled call for as
    many frames as LARGEST_STEP_PLAN allows, and their tables are worked out once; other flows act frame by
    frame. The flow must move each point regardless of the others, as a mapping of points into points
    does (P1).
    """

    def __init__(self) -> None:
        self._steps: list[Step] = []
        self._legs: list[Leg | Step] = []

    def __len__(self) -> int:
        """How many frames it spans."""
        return len(self._steps)

    def add(self, step: Step) -> None:
        """The next frame. Raises FrameError where a velocity field is too steep to follow."""
        try:
            parts = [Step(*part, step.frame) for part in step.flow.parts(step.time, step.dt)]
        except FrameError as error:
            raise error.of(step.frame) from None
        legs = [_leg(part) for part in parts]
        self._steps.append(step)
        for leg in legs:
            last = self._legs[-1] if self._legs else None
            if isinstance(leg, Leg) and isinstance(last, Leg) and last.fits(leg):
                self._legs[-1] = last.joined(leg)
            else:
                self._legs.append(leg)

    def carry(self, rest_points: Points) -> Points:
        """Where points (N, 3) of the rest frame are at the last frame added: a new array, all finite.

        Raises FrameError, of the last frame, where the flow fails or takes a point out of the numbers.
        """
        points = np.array(rest_points, dtype=np.float64)
        try:
            with np.errstate(all="ignore"):  # what has left the numbers is told below, by frame
                for leg in self._legs:
                    points = leg.apply(points)
            if not np.isfinite(points).all():
                self._walk(rest_points)
        except FrameError as error:
            raise FrameError(f"on the way from the rest surface: {error}", self._steps[-1].frame) from error
        return points

    def _walk(self, points: Points) -> None:
        """Frame by frame, to find where it went wrong."""
        for step in self._steps:
            points = step.apply(points)


def _leg(step: Step) -> Leg | Step:
    if not isinstance(step.flow, Streamlines):
        return step
    try:
        return Leg(step.flow.step_plan(step.time, step.dt), (step,))
    except (FlowsculptError, ArithmeticError) as error:
        raise flow_error(error, step.flow, step.frame) from error
