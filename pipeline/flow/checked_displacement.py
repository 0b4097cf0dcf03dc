"""Flows are not trusted: what they return is looked at before a surface takes it."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np

from pipeline.arrays import Points
from pipeline.errors import FlowsculptError, FrameError
from pipeline.flow.catalogue.formula import Formula
from pipeline.flow.flow import Flow, Part
from pipeline.flow.streamlines import Streamlines


def checked_displacement(flow: Flow, points: Points, time: float, dt: float, frame: int) -> Points:
    """`flow.displace`: a new float64 array (N, 3) of finite numbers, or a FrameError.

    The error names the flow (of several in order the guilty one), the first bad vertex and where that vertex
    was; its `frame` is `frame`.
    """
    try:
        for part in flow.parts(time, dt):
            points = _moved(part, points, frame)
    except FrameError as error:
        raise error.of(frame) from None
    return points


def flow_error(error: Exception, flow: Flow, frame: int) -> FrameError:
    """What went wrong as the error of that frame, which names the flow."""
    if isinstance(error, FrameError):
        return error.of(frame)
    told = str(error) if isinstance(error, FlowsculptError) else f"{type(error).__name__}: {error}"
    return FrameError(f"flow {flow.name}: {told}", frame)


def checked_cache_data(flow: Flow, time: float, dt: float) -> Any:
    """Return `flow.cache_data`, or why it fails: every frame then has a key, and fails when it is made."""
    try:
        data = flow.cache_data(time, dt)
    except (FlowsculptError, ArithmeticError) as error:
        return {"fails": f"{type(error).__name__}: {error}"}
    try:
        json.dumps(data, allow_nan=False)
    except ValueError:  # numbers that are none
        return {"fails": repr(data)}
    return data


def _moved(part: Part, points: Points, frame: int) -> Points:
    flow, time, dt = part
    place = f"flow {flow.name}"
    try:
        moved = np.array(flow.displace(points.copy(), time, dt), dtype=np.float64)
    except FlowsculptError as error:
        raise flow_error(error, flow, frame) from error
    except Exception as error:
        raise FrameError(
            f"{place} raised {type(error).__name__}: {error}; a flow takes points (N, 3), time and dt "
            f"and returns points (N, 3). Call it alone with {len(points)} points at time {time:g} s.",
            frame,
        ) from error
    if moved.shape != points.shape:
        raise FrameError(
            f"{place} returned an array of shape {moved.shape} for points of shape {points.shape}; "
            "a flow returns one point for each it is given. Return all points, moved or not.",
            frame,
        )
    finite = np.isfinite(moved)
    if not finite.all():
        vertex = int(np.argmin(finite.all(axis=1)))
        where = ", ".join(f"{x:.4g}" for x in points[vertex])
        if told := trouble(flow, points[vertex], time, dt):
            raise FrameError(f"{place}: {told}", frame)
        raise FrameError(
            f"{place} moved vertex {vertex} from ({where}) to {moved[vertex].tolist()}; points must stay "
            "finite. Lower the flow's strength, or raise substeps if it grows from frame to frame.",
            frame,
        )
    return moved


def trouble(flow: Flow, place: Points, time: float, dt: float) -> str | None:
    """What to tell of a flow that takes the point at `place` (3,) out of the numbers; None where unknown.

    The point is followed once more, slowly, by the same sub-steps.
    """
    if not isinstance(flow, Streamlines):
        return None
    here = np.array(place)
    formulas = any(isinstance(leaf, Formula) for leaf, _ in flow.field.leaves(here, time))
    plain = replace(flow, tolerance=None, max_step=None)
    for h in plain.step_plan(time, dt).spans[:, 0] if formulas else ():
        slopes: list[Points] = [np.zeros(3)]
        for share in (0.0, 0.5, 0.5, 1.0):
            at, moment = here + share * h * slopes[-1], time + share * h
            leaves = flow.field.leaves(at, moment)
            told = (leaf.trouble(seen, moment) for leaf, seen in leaves if isinstance(leaf, Formula))
            if found := next(filter(None, told), None):
                return found
            slopes.append(flow.field.velocity(at[None], moment)[0])
        here = here + h / 6.0 * (slopes[1] + 2.0 * (slopes[2] + slopes[3]) + slopes[4])
        time += h
    return None
