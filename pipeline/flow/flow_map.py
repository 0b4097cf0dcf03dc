"""The flow map: the positions of rest points after all frames so far."""

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
class FrameStep:
    """The flow into `frame`, from `time` on, for `dt` seconds."""

    flow: Flow
    time: float
    dt: float
    frame: int

    def apply(self, points: Points) -> Points:
        """Return moved points (N, 3), checked. Raises FrameError."""
        return checked_displacement(self.flow, points, self.time, self.dt, self.frame)


@dataclass(frozen=True)
class PlannedSteps:
    """Steps along streamlines, followed by one compiled call; points that need finer ones go step by step."""

    plan: StepPlan
    steps: tuple[FrameStep, ...]

    def apply(self, points: Points) -> Points:
        """Return points (N, 3) moved by all steps. Raises FrameError."""
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

    def fits(self, more: PlannedSteps) -> bool:
        """Tell whether one call can follow both."""
        size = len(self.plan.tables) + len(more.plan.tables)
        return size <= LARGEST_STEP_PLAN and self.plan.halved == more.plan.halved

    def joined(self, more: PlannedSteps) -> PlannedSteps:
        return PlannedSteps(StepPlan.joined([self.plan, more.plan]), self.steps + more.steps)


class FlowMap:
    """The steps of a shot since its rest frame, which move rest points through all of them at once.

    A rest point arrives at exactly the bits of a vertex that started there and moved frame by frame: the same
    sub-steps are taken in the same order. One compiled call follows streamlines for as many frames as
    LARGEST_STEP_PLAN allows, and their tables are computed once; other flows act frame by frame. The flow
    must move each point independently of the others, as a mapping of points into points does (P1).
    """

    def __init__(self) -> None:
        self._steps: list[FrameStep] = []
        self._parts: list[PlannedSteps | FrameStep] = []

    def __len__(self) -> int:
        """The number of frames."""
        return len(self._steps)

    def add(self, step: FrameStep) -> None:
        """Add the next frame. Raises FrameError where a velocity field needs too many sub-steps."""
        try:
            steps = [FrameStep(*part, step.frame) for part in step.flow.steps(step.time, step.dt)]
        except FrameError as error:
            raise error.of(step.frame) from None
        parts = [_planned(part) for part in steps]
        self._steps.append(step)
        for part in parts:
            last = self._parts[-1] if self._parts else None
            if isinstance(part, PlannedSteps) and isinstance(last, PlannedSteps) and last.fits(part):
                self._parts[-1] = last.joined(part)
            else:
                self._parts.append(part)

    def carry(self, rest_points: Points) -> Points:
        """Return points (N, 3) of the rest frame at the last frame: a new array, all finite.

        Raises FrameError, of the last frame, where the flow fails or the result is not finite.
        """
        points = np.array(rest_points, dtype=np.float64)
        try:
            with np.errstate(all="ignore"):  # results that are not finite are reported below, by frame
                for part in self._parts:
                    points = part.apply(points)
            if not np.isfinite(points).all():
                self._apply_by_frame(rest_points)
        except FrameError as error:
            raise FrameError(f"on the way from the rest surface: {error}", self._steps[-1].frame) from error
        return points

    def _apply_by_frame(self, points: Points) -> None:
        """Move points frame by frame, so that the failing frame raises."""
        for step in self._steps:
            points = step.apply(points)


def _planned(step: FrameStep) -> PlannedSteps | FrameStep:
    """Return a step along streamlines as planned sub-steps, and any other unchanged."""
    if not isinstance(step.flow, Streamlines):
        return step
    try:
        return PlannedSteps(step.flow.step_plan(step.time, step.dt), (step,))
    except (FlowsculptError, ArithmeticError) as error:
        raise flow_error(error, step.flow, step.frame) from error
