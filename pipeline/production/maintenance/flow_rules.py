"""Rules for the flows of a shot: where they act, how they stretch, and how long a frame takes."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from contextlib import suppress
from time import perf_counter
from typing import Any

import numba
import numpy as np

from pipeline.animation.fit_remedy import fit_remedy, is_usual_size
from pipeline.animation.flow_cost import FlowCost, along_velocities, costliest_flow, flow_costs
from pipeline.animation.growth import flows_of, growth_warning
from pipeline.arrays import Points
from pipeline.errors import FrameError
from pipeline.flow import Flow, Placed, VelocityField
from pipeline.flow.catalogue.deformations import Deformation, Stretch
from pipeline.flow.flow_map import checked_displacement
from pipeline.flow.kernels.instructions import BLOCK
from pipeline.flow.parameters import parameters_of, shot_name, unit, vector_at
from pipeline.flow.streamlines import MAX_SUBSTEPS
from pipeline.production.maintenance.finding import Finding, Where, sampled_frames
from pipeline.production.maintenance.first_frame import FirstFrame
from pipeline.shot import Motion, Shot

FAR_OFF = 5.0
"""Extents from a flow's centre to the middle of the subject: farther off it moves the subject as a whole."""

SLOW_SECONDS = 60.0
"""Seconds of a frame from which on its flow is named."""

STRETCH, STRETCHED = 2.0, 0.1
"""Length of edges over that of the frame before from which on a flow tears the surface apart, and the share
of the edges that are so long."""

MOST_MEASURED = 500
"""Sub-steps up to which edges are followed to measure their stretch."""

LONG, SAMPLE = 1e8, BLOCK
"""Vertices × sub-steps from which on a frame may be slow, and vertices that are moved to find out."""


def acts_elsewhere(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check that flows act where the subject is."""
    if not shot.motion.subject.is_surface:
        return
    time = shot.motion.clock.time(shot.frames.first)
    for k, flow in enumerate(flows_of(shot.motion.flow)):
        far = [item for item in _offsets(flow, first.middle, time) if _norm(item[1]) > FAR_OFF * first.extent]
        if far:
            name, offset = far[0]
            middle = ", ".join(f"{x:.4g}" for x in first.middle)
            fit = fit_remedy(shot.motion, first.extent)
            fits = f"{fit}, which moves the model to the origin, or " if fit else ""
            yield Finding(
                ("flows", k),
                f"{name} acts about a place {_norm(offset) / first.extent:.3g} times the size of the subject "
                f"away from it. Write {fits}"
                f"centre: [{middle}] under {name}.",
            )


def _norm(vector: Points) -> float:
    return float(np.linalg.norm(vector))


def deforms_nothing(shot: Shot, _: FirstFrame | None = None) -> Iterator[Finding]:
    """Check that the amount of a deformation changes: each frame applies what it differs by."""
    last = shot.frames.last
    for k, flow in enumerate(flows_of(shot.motion.flow)):
        for part in _deformations(flow):
            if isinstance(part.amount, int | float):
                at_rest = 1 if isinstance(part, Stretch) else 0
                amount = next(each for each in parameters_of(type(part)) if each.name == "amount")
                value = part.amount / amount.doc.factor
                keys = f"{{keys: {{{shot.frames.first}: {at_rest}, {last}: {value:g}}}}}"
                name = shot_name(type(part))
                yield Finding(
                    ("flows", k),
                    f"{name} moves nothing, for its amount is the same in every frame. Write amount: {keys}.",
                )


def _deformations(flow: Any) -> Iterator[Deformation]:
    """Yield the deformations in a flow."""
    if isinstance(flow, Deformation):
        yield flow
    elif isinstance(flow, tuple):
        for part in flow:
            yield from _deformations(part)
    elif dataclasses.is_dataclass(flow) and not isinstance(flow, type):
        for field in dataclasses.fields(flow):
            yield from _deformations(getattr(flow, field.name))


def takes_long(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check that flows take few enough sub-steps, and say where a frame takes long."""
    motion = shot.motion
    costs: list[tuple[int, FlowCost]] = []
    cost: FlowCost | None = None
    for number in _moved_frames(shot):
        try:
            cost = costliest_flow(motion, number, first.points)
            for _, flow, time, dt in along_velocities(motion, number):
                if flow.gradient_substeps(time, dt) > MAX_SUBSTEPS:
                    flow.step_plan(time, dt)  # raises what the frame will
        except FrameError as error:
            place = "" if cost is None else cost.place
            yield Finding(_where(place), str(error.of(number)), is_error=True)
            return
        if cost is not None:
            costs.append((number, cost))
    if not costs:
        return
    number, cost = max(costs, key=lambda item: item[1].substeps)
    where = _where(cost.place)
    if costs[0][1].length > MAX_SUBSTEPS:
        number, cost = costs[0]
        yield Finding(where, f"frame {number} fails, for {MAX_SUBSTEPS} sub-steps are the most: {cost}", True)
        return
    seconds = _seconds(shot, number, first, cost)
    if seconds > SLOW_SECONDS:
        yield Finding(where, f"frame {number} takes about {seconds:.0f} s: {cost}")


def stretches(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check that no flow multiplies the length of edges in one frame: vertices grow in number alike."""
    motion = shot.motion
    if motion.resampling is None or not len(first.faces) or any(acts_elsewhere(shot, first)):
        return  # far from the subject a flow may well stretch it, which the other finding mends
    corners = first.points[first.faces[:: max(1, len(first.faces) // SAMPLE)][:SAMPLE]].reshape(-1, 3)
    for number in _moved_frames(shot):
        for k, flow in enumerate(flows_of(motion.limit_steps(motion.flow, number))):
            try:
                if _substeps(motion, number, first, k) > MOST_MEASURED:
                    continue
                moved = checked_displacement(flow, corners, *motion.step(number), number)
            except FrameError:
                continue  # `takes_long` tells what fails for certain
            ratio = float(np.quantile(_lengths(moved) / _lengths(corners), 1.0 - STRETCHED))
            if ratio > STRETCH:
                fit = "" if is_usual_size(first.extent) else fit_remedy(motion, first.extent)
                remedy = f"Write {fit}, lower" if fit else "Lower"
                yield Finding(
                    ("flows", k),
                    f"{flow.name} makes edges {ratio:.3g} times as long in the one frame {number}, so that "
                    f"vertices multiply and frames take long. {remedy} its amount or strength, or "
                    "spread its keys over more frames.",
                )
                return


def grows(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check that the surface does not multiply in the course of the shot."""
    if first.exceeds:
        return
    warning = growth_warning(shot.motion, first.points, first.faces, first.vertices)
    if warning is not None:
        yield Finding(_where(warning.growth.place), str(warning))


def _lengths(corners: Points) -> Points:
    """Return the lengths of the edges of triangles, whose corners stand one after another."""
    triangles = corners.reshape(-1, 3, 3)
    lengths: Points = np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2) + 1e-300
    return lengths


def _substeps(motion: Motion, number: int, first: FirstFrame, k: int) -> float:
    """Return the most sub-steps of the flow with index k on the way into a frame; 0 of a map."""
    costs = flow_costs(motion, number, first.points)
    return max((cost.substeps for cost in costs if cost.place == motion.place_of_flow(k)), default=0.0)


def _moved_frames(shot: Shot) -> list[int]:
    """Return the first frame that a flow moves, and the sampled ones after it."""
    return list(dict.fromkeys([*list(shot.frames)[1:2], *sampled_frames(shot)[1:]]))


def _where(place: str) -> Where:
    """Return the path of `flows.0`; of all flows for an empty place."""
    return tuple(int(step) if step.isdigit() else step for step in place.split(".")) if place else ("flows",)


def _seconds(shot: Shot, number: int, first: FirstFrame, cost: FlowCost) -> float:
    """Return about how long the flow into a frame takes: a few vertices are moved for it."""
    resampling = shot.motion.resampling
    carries = resampling is not None and resampling.placement == "exact" and resampling.normals == "carried"
    moved = first.vertices * (3 if carries else 1)
    if moved * cost.substeps < LONG:
        return 0.0
    sample = first.points[:: max(1, len(first.points) // SAMPLE)][:SAMPLE]
    flow = shot.motion.limit_steps(shot.motion.flow, number)
    started = perf_counter()
    with suppress(FrameError):  # frame by frame it may fail for other reasons
        checked_displacement(flow, sample, *shot.motion.step(number), number)
    return (perf_counter() - started) * moved / len(sample) / numba.get_num_threads()


def _offsets(flow: Any, point: Points, time: float) -> Iterator[tuple[str, Points]]:
    """Yield the name of each flow with a centre, and the vector from it to a point; fields: across the axis.

    Flows in a coordinate frame of their own are left out.
    """
    if isinstance(flow, tuple):
        for part in flow:
            yield from _offsets(part, point, time)
    if isinstance(flow, Placed) or not dataclasses.is_dataclass(flow) or isinstance(flow, type):
        return
    if isinstance(flow, Flow | VelocityField) and hasattr(flow, "centre"):
        offset = point - np.array(vector_at(flow.centre, time))
        if isinstance(flow, VelocityField) and hasattr(flow, "axis"):
            axis = np.array(unit(flow.axis))
            offset = offset - (offset @ axis) * axis
        yield shot_name(type(flow)), offset
        return
    for field in dataclasses.fields(flow):
        yield from _offsets(getattr(flow, field.name), point, time)
