"""Flows over frames: the checked displacement of one frame, and the map of rest points through all so far.

A flow may be a user's code: its results are checked before a surface uses them.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import numpy as np

from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.errors import FlowsculptError, FrameError
from flowsculpt.pipeline.flow.catalogue.deformations import Deformation
from flowsculpt.pipeline.flow.flow import Flow, FlowStep
from flowsculpt.pipeline.flow.streamlines import StepPlan, Streamlines
from flowsculpt.pipeline.plugin import fault_of_plugin


def checked_displacement(
    flow: Flow, points: Points, time: float, dt: float, frame: int, first: int = 0
) -> Points:
    """Return `flow.displace` as a new float64 array (N, 3) of finite numbers, or raise FrameError.

    The error names the flow (of a sequence the failing one), the first bad vertex and its position; its
    `frame` is `frame`. `first` is the number of the first vertex.
    """
    try:
        for part in _joined([_plan(step) for step in _steps_of(FrameStep(flow, time, dt, frame))]):
            if isinstance(part, PlannedSteps) and len(part.steps) > 1:
                moved = part.plan.follow(points, ", ".join(step.flow.name for step in part.steps))
                if np.isfinite(moved).all():
                    points = moved
                    continue
            for step in part.steps:
                points = _displace(FlowStep(step.flow, step.time, step.dt), points, frame, first)
    except FrameError as error:
        raise error.of(frame) from None
    return points


def flow_error(error: Exception, flow: Flow, frame: int) -> FrameError:
    """Return an error as the error of a frame, which names the flow."""
    if isinstance(error, FrameError):
        return error.of(frame)
    if not isinstance(error, FlowsculptError) and (fault := fault_of_plugin(error)):
        return FrameError(str(fault), frame)
    message = str(error) if isinstance(error, FlowsculptError) else f"{type(error).__name__}: {error}"
    return FrameError(f"flow {flow.name}: {message}", frame)


def cache_data_or_failure(flow: Flow, time: float, dt: float) -> Any:
    """Return `flow.cache_data`, or why it fails: every frame then has a key, and fails when it is made."""
    try:
        return flow.cache_data(time, dt)
    except (FlowsculptError, ArithmeticError) as error:
        return {"fails": f"{type(error).__name__}: {error}"}


def checked_cache_data(flow: Flow, time: float, dt: float) -> Any:
    """Return the same, and the text of data that JSON cannot hold: with NaN or infinity."""
    data = cache_data_or_failure(flow, time, dt)
    try:
        json.dumps(data, allow_nan=False)
    except ValueError:  # NaN or infinity
        return {"fails": repr(data)}
    return data


def _displace(step: FlowStep, points: Points, frame: int, first: int) -> Points:
    flow, time, dt = step
    name = f"flow {flow.name}"
    try:
        plan = StepPlan.of_kernel_row(flow, time, dt)
        moved = None if plan is None else plan.follow(points, flow.name)
        if moved is None or not np.isfinite(moved).all():  # the flow says why
            moved = np.array(flow.displace(points.copy(), time, dt), dtype=np.float64)
    except Exception as error:
        if isinstance(error, FlowsculptError) or fault_of_plugin(error):
            raise flow_error(error, flow, frame) from error
        raise FrameError(
            f"{name} raised {type(error).__name__}: {error}; a flow takes points (N, 3), time and dt "
            f"and returns points (N, 3). Call it alone with {len(points)} points at time {time:g} s.",
            frame,
        ) from error
    if moved.shape != points.shape:
        raise FrameError(
            f"{name} returned an array of shape {moved.shape} for points of shape {points.shape}; "
            "a flow returns one point for each it is given. Return all points, moved or not.",
            frame,
        )
    finite = np.isfinite(moved)
    if not finite.all():
        vertex = int(np.argmin(finite.all(axis=1)))
        where = ", ".join(f"{x:.4g}" for x in points[vertex])
        if reason := diagnose(flow, points[vertex], time, dt):
            raise FrameError(f"{name}: {reason}", frame)
        raise FrameError(
            f"{name} moved vertex {first + vertex} from ({where}) to {moved[vertex].tolist()}; points must "
            "stay finite. Lower the flow's strength, or raise substeps if it grows from frame to frame.",
            frame,
        )
    return moved


def diagnose(flow: Flow, point: Points, time: float, dt: float) -> str | None:
    """Return why a field is not finite on the path of a point (3,); None where no field says it.

    The point follows the same sub-steps once more, one stage at a time.
    """
    if not isinstance(flow, Streamlines):
        return None
    position = np.array(point)
    can_diagnose = any(leaf.can_diagnose for leaf, _ in flow.field.leaves(position, time))
    fixed = replace(flow, tolerance=None, max_step=None)
    for h in fixed.step_plan(time, dt).spans[:, 0] if can_diagnose else ():
        slopes: list[Points] = [np.zeros(3)]
        for share in (0.0, 0.5, 0.5, 1.0):
            stage, stage_time = position + share * h * slopes[-1], time + share * h
            for leaf, seen in flow.field.leaves(stage, stage_time):
                if reason := leaf.diagnose(seen, stage_time):
                    return reason
            slopes.append(flow.field.velocity(stage[None], stage_time)[0])
        position = position + h / 6.0 * (slopes[1] + 2.0 * (slopes[2] + slopes[3]) + slopes[4])
        time += h
    return None


CARRYING = "carrying new vertices"
"""The activity that moves new vertices from the surface at rest through all frames so far."""

MOVED_TOGETHER = 1 << 17
"""Vertices that the flow moves together: more take memory for copies, and fewer take more calls."""


def blocks_of(count: int) -> Iterator[slice]:
    """Yield slices of MOVED_TOGETHER that cover so many vertices; the last one is shorter."""
    for first in range(0, count, MOVED_TOGETHER):
        yield slice(first, min(first + MOVED_TOGETHER, count))


LARGEST_STEP_PLAN = 1 << 20  # numbers in the tables of one kernel call: 8 MB


@dataclass(frozen=True)
class FrameStep:
    """The flow into `frame`, from `time` on, for `dt` seconds."""

    flow: Flow
    time: float
    dt: float
    frame: int

    @property
    def steps(self) -> tuple[FrameStep]:
        """This step alone, as of PlannedSteps."""
        return (self,)

    def apply(self, points: Points, first: int = 0) -> Points:
        """Return moved points (N, 3), checked; `first` is the number of the first. Raises FrameError."""
        return checked_displacement(self.flow, points, self.time, self.dt, self.frame, first)

    def move(self, points: Points, first: int = 0) -> None:
        """Move points (N, 3) as `apply` does, in place and by blocks, which takes less memory."""
        for block in blocks_of(len(points)):
            points[block] = self.apply(points[block], first + block.start)


@dataclass(frozen=True)
class PlannedSteps:
    """Steps along streamlines and of deformations, done by one compiled call.

    Points that need finer steps go step by step.
    """

    plan: StepPlan
    steps: tuple[FrameStep, ...]

    def apply(self, points: Points) -> Points:
        """Return points (N, 3) moved by all steps. Raises FrameError."""
        moved = self.plan.follow(points, CARRYING)
        lost = ~np.isfinite(moved).all(axis=1)
        if lost.any():
            alone = points[lost]
            for step in self.steps:
                try:
                    alone = step.flow.displace(alone, step.time, step.dt)
                except FrameError as error:
                    raise error.of(step.frame) from None
            moved[lost] = alone
        return moved


class FlowMap:
    """The steps of a shot since its rest frame, which move rest points through all of them at once.

    A rest point arrives at exactly the bits of a vertex that started there and moved frame by frame: the same
    sub-steps are taken in the same order. A step that the next frame undoes is left out, as is the undoing.
    One compiled call follows streamlines and deformations for as many frames as LARGEST_STEP_PLAN allows, and
    their tables are computed once; other flows act frame by frame. The flow must move each point
    independently of the others, as a mapping of points into points does (P1).
    """

    def __init__(self) -> None:
        self._steps: list[FrameStep] = []
        self._parts: list[PlannedSteps | FrameStep] = []  # of all frames before the last
        self._last: list[PlannedSteps | FrameStep] = []

    def add(self, step: FrameStep) -> None:
        """Add the next frame. Raises FrameError where a velocity field needs too many sub-steps."""
        steps = _steps_of(step)
        while steps and self._last and steps[0].flow.undoes(steps[0].time, self._last[-1].steps[-1]):
            del steps[0], self._last[-1]
        self._parts, self._last = _joined([*self._parts, *self._last]), [_plan(each) for each in steps]
        self._steps.append(step)

    def carry(self, rest_points: Points) -> Points:
        """Return points (N, 3) of the rest frame at the last frame: a new array, all finite.

        Raises FrameError, of the last frame, where the flow fails or the result is not finite.
        """
        points = np.array(rest_points, dtype=np.float64)
        try:
            with np.errstate(all="ignore"):  # results that are not finite are reported below, by frame
                for part in _joined([*self._parts, *self._last]):
                    points = part.apply(points)
            if not np.isfinite(points).all():
                points = reduce(lambda moved, step: step.apply(moved), self._steps, rest_points)
        except FrameError as error:
            raise FrameError(f"on the way from the rest surface: {error}", self._steps[-1].frame) from error
        return points


def _steps_of(step: FrameStep) -> list[FrameStep]:
    """Return the steps of the flows of a frame. Raises FrameError, of the frame."""
    try:
        return [FrameStep(*part, step.frame) for part in step.flow.steps(step.time, step.dt)]
    except FrameError as error:
        raise error.of(step.frame) from None


def _joined(parts: list[PlannedSteps | FrameStep]) -> list[PlannedSteps | FrameStep]:
    """Return the parts, those as one that one compiled call can follow."""
    joined: list[PlannedSteps | FrameStep] = []
    for part in parts:
        if joined and isinstance(part, PlannedSteps) and isinstance(last := joined[-1], PlannedSteps):
            size = len(last.plan.tables) + len(part.plan.tables)
            if size <= LARGEST_STEP_PLAN and last.plan.halved == part.plan.halved:
                part = PlannedSteps(StepPlan.joined([last.plan, part.plan]), last.steps + part.steps)
                joined.pop()
        joined.append(part)
    return joined


def _plan(step: FrameStep) -> PlannedSteps | FrameStep:
    """Return a step that a compiled call can do as planned, and any other unchanged."""
    flow, time, dt, frame = step.flow, step.time, step.dt, step.frame
    try:
        if isinstance(flow, Streamlines) and flow.holds_much(time):
            return step
        if isinstance(flow, Streamlines | Deformation):
            return PlannedSteps(flow.step_plan(time, dt), (step,))
        plan = StepPlan.of_kernel_row(flow, time, dt)
    except (FlowsculptError, ArithmeticError) as error:
        raise flow_error(error, flow, frame) from error
    return step if plan is None else PlannedSteps(plan, (step,))
