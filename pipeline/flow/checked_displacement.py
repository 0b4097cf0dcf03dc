"""Checks of the results of flows, which may be a user's code, before a surface uses them."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np

from pipeline.arrays import Points
from pipeline.errors import FlowsculptError, FrameError
from pipeline.flow.catalogue.formula import FormulaField
from pipeline.flow.flow import Flow, FlowStep
from pipeline.flow.streamlines import Streamlines


def checked_displacement(flow: Flow, points: Points, time: float, dt: float, frame: int) -> Points:
    """Return `flow.displace` as a new float64 array (N, 3) of finite numbers, or raise FrameError.

    The error names the flow (of a sequence the failing one), the first bad vertex and its position; its
    `frame` is `frame`.
    """
    try:
        for step in flow.steps(time, dt):
            points = _displaced(step, points, frame)
    except FrameError as error:
        raise error.of(frame) from None
    return points


def flow_error(error: Exception, flow: Flow, frame: int) -> FrameError:
    """Return an error as the error of a frame, which names the flow."""
    if isinstance(error, FrameError):
        return error.of(frame)
    message = str(error) if isinstance(error, FlowsculptError) else f"{type(error).__name__}: {error}"
    return FrameError(f"flow {flow.name}: {message}", frame)


def checked_cache_data(flow: Flow, time: float, dt: float) -> Any:
    """Return `flow.cache_data`, or why it fails: every frame then has a key, and fails when it is made."""
    try:
        data = flow.cache_data(time, dt)
    except (FlowsculptError, ArithmeticError) as error:
        return {"fails": f"{type(error).__name__}: {error}"}
    try:
        json.dumps(data, allow_nan=False)
    except ValueError:  # NaN or infinity
        return {"fails": repr(data)}
    return data


def _displaced(step: FlowStep, points: Points, frame: int) -> Points:
    flow, time, dt = step
    name = f"flow {flow.name}"
    try:
        moved = np.array(flow.displace(points.copy(), time, dt), dtype=np.float64)
    except FlowsculptError as error:
        raise flow_error(error, flow, frame) from error
    except Exception as error:
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
            f"{name} moved vertex {vertex} from ({where}) to {moved[vertex].tolist()}; points must stay "
            "finite. Lower the flow's strength, or raise substeps if it grows from frame to frame.",
            frame,
        )
    return moved


def diagnose(flow: Flow, point: Points, time: float, dt: float) -> str | None:
    """Return the formula that is not finite on the path of a point (3,); None where there is none.

    The point follows the same sub-steps once more, one stage at a time.
    """
    if not isinstance(flow, Streamlines):
        return None
    position = np.array(point)
    formulas = any(isinstance(leaf, FormulaField) for leaf, _ in flow.field.leaves(position, time))
    fixed = replace(flow, tolerance=None, max_step=None)
    for h in fixed.step_plan(time, dt).spans[:, 0] if formulas else ():
        slopes: list[Points] = [np.zeros(3)]
        for share in (0.0, 0.5, 0.5, 1.0):
            stage, stage_time = position + share * h * slopes[-1], time + share * h
            for leaf, seen in flow.field.leaves(stage, stage_time):
                if isinstance(leaf, FormulaField) and (reason := leaf.diagnose(seen, stage_time)):
                    return reason
            slopes.append(flow.field.velocity(stage[None], stage_time)[0])
        position = position + h / 6.0 * (slopes[1] + 2.0 * (slopes[2] + slopes[3]) + slopes[4])
        time += h
    return None
