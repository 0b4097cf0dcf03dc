"""Causes of slow frames, and remedies in the shot.

The cost of a frame's flow: sub-steps for each vertex, which setting causes them, and what lowers them. The
size that flows and looks are made for, and how a shot gives it to a model of another size.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, ClassVar

import numpy as np

from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.flow import Streamlines, VelocityField
from flowsculpt.pipeline.flow.catalogue.deformations import Deformation, Stretch
from flowsculpt.pipeline.flow.parameters import parameters_of, shot_name
from flowsculpt.pipeline.flow.streamlines import MAX_SUBSTEPS
from flowsculpt.pipeline.flow.velocity import Sensitivity, sensitivity
from flowsculpt.pipeline.shot import Motion
from flowsculpt.pipeline.shot.subjects import Model

SMALL, LARGE = 0.1, 10.0  # extents over MotionForecast.TYPICAL between which flows and looks work as they are


@dataclass(frozen=True)
class MotionForecast:
    """What the frames of a motion will cost, and what lowers it.

    TYPICAL  extent of the solids, for which flows have their defaults: the longest side of the bounding box,
             units
    COARSE   edges along the extent: with fewer the subject loses its shape. FINE are suggested, and with more
             than FINEST a frame takes long
    """

    motion: Motion

    TYPICAL: ClassVar[float] = 2.0
    COARSE: ClassVar[int] = 12
    FINE: ClassVar[int] = 24
    FINEST: ClassVar[int] = 150

    @classmethod
    def is_usual(cls, extent: float) -> bool:
        """Tell whether flows and looks work as they are for a subject of an extent, units."""
        return SMALL * cls.TYPICAL <= extent <= LARGE * cls.TYPICAL

    def size_remedy(self, extent: float) -> str:
        """Return the settings that fit a model to the typical extent; an empty text for other subjects.

        `subject.fit: 2 in place of scale, and max_edge_length: 0.04`. A maximum edge length that suits the
        typical extent stays; another is scaled with the model.
        """
        motion = self.motion
        if not isinstance(motion.subject, Model):
            return ""
        fit = f"subject.fit: {self.TYPICAL:g}" + " in place of scale" * (motion.subject.scale != 1.0)
        resampling = motion.resampling_at(motion.frames.first)
        longest = None if resampling is None else resampling.thresholds.max_edge_length
        if not isinstance(longest, float) or self.COARSE <= self.TYPICAL / longest <= self.FINEST:
            return fit
        edges = extent / longest
        suited = edges if self.FINE <= edges <= self.FINEST else self.FINE
        return f"{fit}{',' * ('scale' in fit)} and max_edge_length: {self.TYPICAL / suited:.2g}"

    def costs(self, frame: int, points: Points, count: int | None = None) -> list[FlowCost]:
        """Return the costs of all flows along velocities on the way into a frame, the largest first.

        points  (V, 3) the vertices before it, or some of them
        count   the number of all; V by default

        Raises FrameError where a parameter of a flow cannot be computed.
        """
        motion, count = self.motion, len(points) if count is None else count
        edge = motion.longest_edge(frame)
        steps = (
            (motion.place_of_flow(k), step.flow, step.time, step.dt)
            for k, flow in enumerate(motion.limit_steps(motion.flow, frame).members)
            for step in flow.steps(*motion.step(frame))
            if isinstance(step.flow, Streamlines)
        )
        costs = [_cost(motion, points, count, edge, *step) for step in steps]
        return sorted(costs, key=lambda cost: -cost.substeps)

    def constant_deformations(self) -> Iterator[tuple[int, str]]:
        """Yield the place among the flows, and a message, of deformations whose amount never changes.

        They move nothing, for each frame applies what the amount differs by.
        """
        first, last = self.motion.frames.first, self.motion.frames.last
        for k, flow in enumerate(self.motion.flow.members):
            for part in _deformations(flow):
                if isinstance(part.amount, int | float):
                    at_rest = 1 if isinstance(part, Stretch) else 0
                    amount = next(each for each in parameters_of(type(part)) if each.name == "amount")
                    keys = f"{{keys: {{{first}: {at_rest}, {last}: {part.amount / amount.doc.factor:g}}}}}"
                    name = shot_name(type(part))
                    fact = f"{name} moves nothing, for its amount is the same in every frame."
                    yield k, f"{fact} Write amount: {keys}."


SAMPLE = 1000  # vertices whose speeds are measured
MANY_VERTICES = 200_000  # with so many vertices or more, fewer are advised
COMPARABLE = 4.0  # one cause of sub-steps outweighs another by this factor
FEW, ENOUGH = 4, 50  # sub-steps that cost little, and a number that the coarser settings lead to


@dataclass(frozen=True)
class FlowCost:
    """Sub-steps that one flow takes in one frame.

    place     its place in the shot file, such as `flows.0`
    vertices  their number
    gradient  sub-steps of every vertex, since velocities differ from place to place
    distance  units that a vertex moves in the frame, on average
    max_step  units that a sub-step may move a vertex; infinite where velocities are linear in the position
    settings  the parameters that the number of sub-steps follows from
    coarser   the setting `max_step` with which ENOUGH sub-steps remain, in edges; None without edges
    fit       how to fit the model, where that lowers the sub-steps; else empty
    step      time and duration of the flow's step, seconds
    """

    MOST_SUBSTEPS: ClassVar[int] = MAX_SUBSTEPS

    place: str
    flow: Streamlines
    vertices: int
    gradient: float
    distance: float
    max_step: float
    settings: Sensitivity
    coarser: float | None
    fit: list[str]
    step: tuple[float, float]

    @property
    def length(self) -> float:
        """Sub-steps of a vertex on average, since one may move it by `max_step` only."""
        return self.distance / self.max_step

    @property
    def substeps(self) -> float:
        """Sub-steps of a vertex, about."""
        return max(self.gradient, self.length)

    @property
    def fact(self) -> str:
        """`flows.0 curl_noise takes 420 sub-steps a frame for each of 10,241 vertices`"""
        count = f"{self.substeps:,.0f} sub-step{'s' * (self.substeps >= 1.5)}"
        return f"{self.place} {self.flow.name} takes {count} a frame for each of {self.vertices:,} vertices"

    @property
    def cause(self) -> str:
        """The setting or the property of the subject that the sub-steps follow from."""
        if self.substeps <= FEW:
            return "there are many vertices"
        if self.length > self.gradient:
            reason = (
                "max_step × max_edge_length"
                if self.flow.max_step is not None
                else "half the size of its smallest detail"
            )
            return (
                f"it moves a vertex by {self.distance:.3g} units a frame, and by {self.max_step:.3g} at most "
                f"in one sub-step ({reason})"
            )
        if self.flow.substeps is not None:
            return "the shot sets substeps"
        given = f" ({self.settings})" if self.settings else ""
        return f"its velocity changes much within a short distance{given}"

    @property
    def remedies(self) -> list[str]:
        """Changes of the shot file that make the frame faster, each by itself."""
        parameters = self.settings.remedies or ["lower its speed"]
        fewer = ["raise resample.max_edge_length"] if self.vertices > MANY_VERTICES else []
        if self.flow.substeps is not None and self.gradient >= self.length:
            return ["lower substeps", *fewer]
        if self.substeps <= FEW:
            return ["raise resample.max_edge_length"]
        if self.length > COMPARABLE * self.gradient:  # else the gradient keeps the number
            edges = ["raise resample.max_edge_length"] if self.flow.max_step is not None else []
            less = f"write max_step: {self.coarser:.2g}, which is less exact" if self.coarser else ""
            return [*self.fit, *parameters, *edges, *([less] if less else [])]
        if self.gradient > COMPARABLE * self.length:
            substeps = max(FEW, math.ceil(self.gradient / 20))
            return [*parameters, *fewer, f"write substeps: {substeps}, which is less exact"]
        return [*parameters, *fewer]

    def __str__(self) -> str:
        """Return fact, cause and remedies."""
        *others, last = self.remedies
        remedy = f"{', '.join(others)} or {last}" if others else last
        return f"{self.fact}: {self.cause}. {remedy[0].upper()}{remedy[1:]}."


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
    fit: list[str] = []
    if isinstance(motion.subject, Model) and extent > 10.0 * MotionForecast.TYPICAL and edge is not None:
        factor = MotionForecast.TYPICAL / extent
        longest = max_step if flow.max_step is None else factor * max_step
        fitted = _distance(flow, factor * (sample - sample.mean(axis=0)), time, dt) / longest
        if COMPARABLE * fitted < length:
            suited = f"resample.max_edge_length: {factor * edge:.2g}"
            fit = [f"write subject.fit: {MotionForecast.TYPICAL:g} and {suited}"]
    gradient = flow.gradient_substeps(time, dt)

    def substeps_of(field: VelocityField) -> float:
        """Return what decides the sub-steps if the flow had only this field."""
        alone = replace(flow, field=field, substeps=None)
        if length > gradient:
            return _distance(alone, sample, time, dt) / alone.longest_step(time, dt)
        return field.gradient_bound(time)

    leaves = [leaf for leaf, _ in flow.field.leaves(sample[0], time)]
    settings = sensitivity(max(leaves, key=substeps_of), substeps_of, time)
    coarser = None if edge is None else distance / ENOUGH / edge
    return FlowCost(place, flow, count, gradient, distance, max_step, settings, coarser, fit, (time, dt))


def _distance(flow: Streamlines, points: Points, time: float, dt: float) -> float:
    """Return how far points move on average in a step, units, by their velocities at its start."""
    speeds = np.linalg.norm(flow.field.velocity(points, time), axis=1)
    return float(speeds[np.isfinite(speeds)].mean() * abs(dt)) if np.isfinite(speeds).any() else 0.0


def _deformations(flow: Any) -> Iterator[Deformation]:
    """Yield the deformations in a flow."""
    if isinstance(flow, Deformation):
        yield flow
    elif isinstance(flow, tuple):
        for part in flow:
            yield from _deformations(part)
    elif is_dataclass(flow) and not isinstance(flow, type):
        for field in fields(flow):
            yield from _deformations(getattr(flow, field.name))
