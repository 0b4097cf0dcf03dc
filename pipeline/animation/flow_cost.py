"""The cost of a frame's flow: sub-steps for each vertex, which setting causes them, and what lowers them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pipeline.animation.fit_remedy import TYPICAL_EXTENT
from pipeline.arrays import Points
from pipeline.flow import Sequence, Streamlines, VelocityField
from pipeline.flow.velocity import Sensitivity, sensitivity
from pipeline.shot import Motion
from pipeline.shot.model_subjects import Model

SAMPLE = 1000
"""Vertices whose speeds are measured."""


MANY_VERTICES = 200_000
"""Vertices from which on fewer of them are advised."""

COMPARABLE = 4.0
"""One cause of sub-steps outweighs another by this factor."""

FEW, ENOUGH = 4, 50
"""Sub-steps that cost little, and a number that the coarser settings lead to."""


@dataclass(frozen=True)
class FlowCost:
    """Sub-steps that one flow takes in one frame.

    place       its place in the shot file, such as `flows.0`
    name        the flow's name
    vertices    number of vertices
    extent      the largest extent of the subject, units
    gradient    sub-steps of every vertex, since velocities differ from place to place
    length      sub-steps of a vertex on average, since one may move it by `max_step` only
    distance    units that a vertex moves in the frame, on average
    max_step    units; infinite where the velocities are linear in the position
    is_given    tells whether the shot sets `max_step`
    is_fixed    tells whether the shot sets `substeps`
    settings    the parameters that the number of sub-steps follows from
    coarser     the setting `max_step` with which ENOUGH sub-steps remain, in edges; None without edges
    fit         how to fit the model, where that lowers the sub-steps; else empty
    """

    place: str
    name: str
    vertices: int
    extent: float
    gradient: float
    length: float
    distance: float
    max_step: float
    is_given: bool
    is_fixed: bool
    settings: Sensitivity
    coarser: float | None
    fit: tuple[str, ...]

    @property
    def substeps(self) -> float:
        """Sub-steps of a vertex, about."""
        return max(self.gradient, self.length)

    @property
    def fact(self) -> str:
        """`flows.0 curl_noise takes 420 sub-steps a frame for each of 10,241 vertices`"""
        count = f"{self.substeps:,.0f} sub-step{'s' * (self.substeps >= 1.5)}"
        return f"{self.place} {self.name} takes {count} a frame for each of {self.vertices:,} vertices"

    @property
    def cause(self) -> str:
        """The setting or the property of the subject that the sub-steps follow from."""
        if self.substeps <= FEW:
            return "there are many vertices"
        if self.length > self.gradient:
            reason = "max_step × max_edge_length" if self.is_given else "half the size of its smallest detail"
            return (
                f"it moves a vertex by {self.distance:.3g} units a frame, and by {self.max_step:.3g} at most "
                f"in one sub-step ({reason})"
            )
        if self.is_fixed:
            return "the shot sets substeps"
        given = f" ({self.settings})" if self.settings else ""
        return f"its velocity changes much within a short distance{given}"

    @property
    def remedies(self) -> list[str]:
        """Changes of the shot file that make the frame faster, each by itself."""
        parameters = self.settings.remedies or ["lower its speed"]
        fewer = ["raise resample.max_edge_length"] if self.vertices > MANY_VERTICES else []
        if self.is_fixed and self.gradient >= self.length:
            return ["lower substeps", *fewer]
        if self.substeps <= FEW:
            return ["raise resample.max_edge_length"]
        if self.length > COMPARABLE * self.gradient:  # else the gradient keeps the number
            edges = ["raise resample.max_edge_length"] if self.is_given else []
            less = (
                [] if self.coarser is None else [f"write max_step: {self.coarser:.2g}, which is less exact"]
            )
            return [*self.fit, *parameters, *edges, *less]
        if self.gradient > COMPARABLE * self.length:
            substeps = max(FEW, math.ceil(self.gradient / 20))
            return [*parameters, *fewer, f"write substeps: {substeps}, which is less exact"]
        return [*parameters, *fewer]

    def __str__(self) -> str:
        """Return fact, cause and remedies."""
        *others, last = self.remedies
        remedy = f"{', '.join(others)} or {last}" if others else last
        return f"{self.fact}: {self.cause}. {remedy[0].upper()}{remedy[1:]}."


def costliest_flow(motion: Motion, frame: int, points: Points, count: int | None = None) -> FlowCost | None:
    """Return the cost of the flow with the most sub-steps on the way into a frame.

    points  (V, 3) the vertices before it, or some of them
    count   the number of all; V by default

    None where no flow follows velocities. Raises FrameError where a parameter of the flow cannot be computed.
    """
    return max(flow_costs(motion, frame, points, count), key=lambda cost: cost.substeps, default=None)


def flow_costs(motion: Motion, frame: int, points: Points, count: int | None = None) -> list[FlowCost]:
    """Return the costs of all flows along velocities; arguments and errors are those of `costliest_flow`."""
    edge, count = motion.longest_edge(frame), len(points) if count is None else count
    return [_cost(motion, points, count, edge, *step) for step in along_velocities(motion, frame)]


def along_velocities(motion: Motion, frame: int) -> Iterator[tuple[str, Streamlines, float, float]]:
    """Yield place in the shot file, flow, time and duration of each step along streamlines into a frame."""
    whole = motion.limit_steps(motion.flow, frame)
    flows = whole.flows if isinstance(whole, Sequence) else (whole,)
    for k, flow in enumerate(flows):
        for step in flow.steps(*motion.step(frame)):
            if isinstance(step.flow, Streamlines):
                yield motion.place_of_flow(k), step.flow, step.time, step.dt


def _cost(
    motion: Motion,
    points: Points,
    count: int,
    edge: float | None,
    place: str,
    flow: Streamlines,
    time: float,
    dt: float,
) -> FlowCost:
    sample = points[:: max(1, len(points) // SAMPLE)]
    extent = float(np.ptp(points, axis=0).max())
    max_step = flow.longest_step(time, dt)
    distance = _distance(flow, sample, time, dt)
    length = distance / max_step
    fit: tuple[str, ...] = ()
    if isinstance(motion.subject, Model) and extent > 10.0 * TYPICAL_EXTENT and edge is not None:
        factor = TYPICAL_EXTENT / extent
        longest = max_step if flow.max_step is None else factor * max_step
        fitted = _distance(flow, factor * (sample - sample.mean(axis=0)), time, dt) / longest
        if COMPARABLE * fitted < length:
            fit = (
                f"write subject.fit: {TYPICAL_EXTENT:g} and resample.max_edge_length: {factor * edge:.2g}",
            )
    gradient = flow.gradient_substeps(time, dt)

    def substeps_of(field: VelocityField) -> float:
        """Return what decides the sub-steps if the flow had only this field."""
        alone = replace(flow, field=field, substeps=None)
        if length > gradient:
            return _distance(alone, sample, time, dt) / alone.longest_step(time, dt)
        return field.gradient_bound(time)

    leaves = [leaf for leaf, _ in flow.field.leaves(sample[0], time)]
    settings = sensitivity(max(leaves, key=substeps_of), substeps_of, time)
    return FlowCost(
        place=place,
        name=flow.name,
        vertices=count,
        extent=extent,
        gradient=gradient,
        length=length,
        distance=distance,
        max_step=max_step,
        is_given=flow.max_step is not None,
        is_fixed=flow.substeps is not None,
        settings=settings,
        coarser=None if edge is None else distance / ENOUGH / edge,
        fit=fit,
    )


def _distance(flow: Streamlines, points: Points, time: float, dt: float) -> float:
    """Return how far points move on average in a step, units, by their velocities at its start."""
    speeds = np.linalg.norm(flow.field.velocity(points, time), axis=1)
    return float(speeds[np.isfinite(speeds)].mean() * abs(dt)) if np.isfinite(speeds).any() else 0.0
