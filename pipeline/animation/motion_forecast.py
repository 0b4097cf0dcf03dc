"""Causes of slow frames and large surfaces, and remedies in the shot.

The cost of a frame's flow: sub-steps for each vertex, which setting causes them, and what lowers them. The
size that flows and looks are made for, and how a shot gives it to a model of another size.

The forecast of a surface's growth: how many vertices frames take, by triangles that the flow carries. A small
triangle in each of some faces of the first frame is carried through the whole shot. The flow stretches it by
a factor along each of two principal directions. Splits follow: a face becomes as many as the product of both
factors. Compression is not counted, for little collapses where a surface becomes thin. For the largest frames
of the gallery's shots, forecasts were 0.7 to 1.7 times the vertices; where little is stretched and much
compressed, they may be three times as many.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from flowsculpt.pipeline.arrays import Faces, Floats, Points
from flowsculpt.pipeline.errors import FrameError
from flowsculpt.pipeline.flow import Streamlines, VelocityField
from flowsculpt.pipeline.flow.catalogue.deformations import Deformation, Stretch
from flowsculpt.pipeline.flow.parameters import parameters_of, shot_name
from flowsculpt.pipeline.flow.streamlines import MAX_SUBSTEPS
from flowsculpt.pipeline.flow.velocity import Sensitivity, sensitivity
from flowsculpt.pipeline.mesh import TriangleMesh
from flowsculpt.pipeline.shot import Motion
from flowsculpt.pipeline.shot.subjects import Model

SMALL, LARGE = 0.1, 10.0  # extents over MotionForecast.TYPICAL between which flows and looks work as they are

EDGE = 0.66
"""Mean edge length of a resampled surface over the maximum, about."""


@dataclass(frozen=True)
class MotionForecast:
    """What the frames of a motion will cost, how its surface will grow, and what lowers both.

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

    @staticmethod
    def estimated_vertices(mesh: TriangleMesh, max_edge_length: float) -> int:
        """Return about how many vertices a surface has when it is resampled: by the area of its triangles."""
        a, b, c = (mesh.vertices[corner] for corner in mesh.faces.T)
        area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
        return math.ceil(0.5 * area / (math.sqrt(3.0) / 4.0 * (EDGE * max_edge_length) ** 2))

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

    def growth(
        self, points: Points, faces: Faces, vertices: int, last: int | None = None
    ) -> Iterator[Growth]:
        """Yield the growth of each frame after the first, until the flow fails.

        points, faces  (V, 3) and (F, 3): the first frame, or the subject at rest
        vertices       number of vertices of the first frame
        last           the last frame of interest; by default the shot's

        Nothing is yielded where nothing is resampled.
        """
        motion = self.motion
        first, *others = (number for number in motion.frames if last is None or number <= last)
        if motion.resampling is None or not (len(faces) and others and motion.flow.members):
            return
        corners, areas = _small_triangles(points, faces, self._sample_size(others[0], points, len(others)))
        if not len(areas):
            return
        at_rest, names = _Rest.of(corners, areas), [flow.name for flow in motion.flow.members]
        by_flow, splits, start_edge = np.ones(len(names)), 1.0, motion.longest_edge(first)
        for number in others:
            for k, flow in enumerate(motion.flow.members):
                try:
                    corners = motion.step_into(flow, number).apply(corners)
                except FrameError:
                    return
                before, splits = splits, at_rest.splits(corners)
                by_flow[k] *= splits / before
            edge = motion.longest_edge(number)
            times = splits if edge is None or start_edge is None else splits * (start_edge / edge) ** 2
            k = int(np.argmax(by_flow))
            yield Growth(number, round(vertices * times), times, motion.place_of_flow(k), names[k])

    def growth_warning(
        self, points: Points, faces: Faces, vertices: int, last: int | None = None
    ) -> GrowthWarning | None:
        """Return a warning of a shot's growth: where `max_vertices` is passed, else of the largest frame.

        Arguments are those of `growth`. None where the growth is usual.
        """
        if self.motion.resampling is None:
            return None
        most: Growth | None = None
        for growth in self.growth(points, faces, vertices, last):
            if most is None or growth.vertices > most.vertices:
                most = growth
            if growth.vertices > self.motion.resampling.thresholds.max_vertices:
                break
        if most is None or most.times < RUNAWAY or most.vertices < MANY_VERTICES:
            return None
        return GrowthWarning(most, self._growth_remedy(most, points))

    def _growth_remedy(self, growth: Growth, points: Points) -> str:
        """Return what makes a surface grow less."""
        try:
            costs = [c for c in self.costs(growth.frame, points) if c.place == growth.place]
        except FrameError:
            costs = []
        remedies = costs[0].settings.remedies if costs else []
        first = ", ".join(remedies or ["lower its amount or strength"])
        more = "raise resample.max_edge_length; resample.max_growth stops a run at the growth that you set."
        return f"{first[0].upper()}{first[1:]}, or {more}"

    def _sample_size(self, frame: int, points: Points, frames: int) -> int:
        """Return how many triangles can be carried through all frames in seconds."""
        try:
            costs = self.costs(frame, points)
        except FrameError:
            return FEWEST
        substeps = max(1.0, costs[0].substeps) if costs else 1.0
        return int(min(SAMPLE, max(FEWEST, MOST_MOVES / (3 * substeps * frames))))

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


FEWEST = 100  # triangles that are carried at least, where flows take many sub-steps; SAMPLE otherwise
MOST_MOVES = 4e7  # sub-steps of points that a forecast takes at most, about: seconds
SIDE = 0.02  # sides of the carried triangles over those of the faces

FLATTEST = 1e-6
"""Area over the square of the longest side below which a face is a line, whose stretch is only rounding."""

RUNAWAY = 10.0
"""Growth from which on a forecast warns of MANY_VERTICES, which take minutes where seconds were meant."""


class Growth(NamedTuple):
    """A forecast for one frame.

    times  its vertices over those of the first frame
    place  in the shot file, of the flow that stretches most: `flows.0`
    """

    frame: int
    vertices: int
    times: float
    place: str
    flow: str


class GrowthWarning(NamedTuple):
    """The growth of a shot that takes minutes where seconds were meant, and how to lower it."""

    growth: Growth
    remedy: str

    def __str__(self) -> str:
        """Return fact and remedy: `frame 40 takes about 900,000 vertices, 60 times those of the first; …`"""
        frame, vertices, times, place, flow = self.growth
        return (
            f"frame {frame} takes about {_rounded(vertices):,} vertices, {_rounded(times):,} times those of "
            f"the first; {place} {flow} stretches most. {self.remedy}"
        )


def _rounded(number: float) -> int:
    """Return a number with two digits that count."""
    return int(round(number, 1 - math.floor(math.log10(number)))) if number >= 10 else round(number)


def _small_triangles(points: Points, faces: Faces, count: int) -> tuple[Points, Floats]:
    """Return corners (3 N, 3) of small triangles amid some faces, and the areas (N,) that they stand for."""
    chosen = points[faces[:: max(1, len(faces) // count)]]
    areas = 0.5 * np.linalg.norm(np.cross(chosen[:, 1] - chosen[:, 0], chosen[:, 2] - chosen[:, 0]), axis=1)
    longest = np.linalg.norm(chosen - np.roll(chosen, -1, axis=1), axis=2).max(axis=1, initial=0.0)
    is_face = areas > FLATTEST * longest**2
    chosen, areas = chosen[is_face], areas[is_face]
    middles = chosen.mean(axis=1, keepdims=True)
    return (middles + SIDE * (chosen - middles)).reshape(-1, 3), areas


class _Rest(NamedTuple):
    """Triangles before a flow has moved them.

    inverse  (N, 2, 2) from the plane of each, in its own orthonormal axes, to its two sides
    weights  (N,) areas that the triangles stand for
    """

    inverse: Floats
    weights: Floats

    @classmethod
    def of(cls, corners: Points, weights: Floats) -> _Rest:
        return cls(np.linalg.pinv(np.linalg.qr(_sides(corners)).R), weights)

    def splits(self, corners: Points) -> float:
        """Return how many faces one has become on average: the product of the factors that are over 1."""
        factors = np.linalg.svd(_sides(corners) @ self.inverse, compute_uv=False)
        return float(np.average(np.maximum(factors, 1.0).prod(axis=1), weights=self.weights))


def _sides(corners: Points) -> Floats:
    """Return the two sides (N, 3, 2) that leave the first corner of triangles (3 N, 3)."""
    a, b, c = corners.reshape(-1, 3, 3).swapaxes(0, 1)
    return np.stack([b - a, c - a], axis=2)


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
