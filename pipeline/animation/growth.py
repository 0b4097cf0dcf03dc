"""The forecast of a surface's growth: how many vertices frames take, by triangles that the flow carries.

A small triangle in each of some faces of the first frame is carried through the whole shot. The flow
stretches it by a factor along each of two principal directions. Splits follow: a face becomes as many as the
product of both factors. Compression is not counted, for little collapses where a surface becomes thin.
For the largest frames of the gallery's shots, forecasts were 0.7 to 1.7 times the vertices; where little is
stretched and much compressed, they may be three times as many.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import astuple, dataclass
from typing import NamedTuple

import numpy as np

from pipeline.animation.flow_cost import costliest_flow, flow_costs
from pipeline.arrays import Faces, Floats, Points
from pipeline.errors import FrameError
from pipeline.flow import Flow, Sequence
from pipeline.flow.flow_map import checked_displacement
from pipeline.shot import Motion

SAMPLE, FEWEST = 1000, 100
"""Triangles that are carried, and how many at least where flows take many sub-steps."""

MOST_MOVES = 4e7
"""Sub-steps of points that a forecast takes at most, about: seconds."""

SIDE = 0.02
"""Sides of the carried triangles over those of the faces."""

FLATTEST = 1e-6
"""Area over the square of the longest side below which a face is a line, whose stretch is only rounding."""

RUNAWAY, MANY_VERTICES = 10.0, 200_000
"""Growth, and vertices, from which on a forecast warns: such shots take minutes where seconds were meant."""


@dataclass(frozen=True)
class Growth:
    """A forecast for one frame.

    vertices  about how many it takes
    times     over those of the first frame
    place     of the flow that stretches most, in the shot file: `flows.0`
    flow      its name
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
        frame, vertices, times, place, flow = astuple(self.growth)
        return (
            f"frame {frame} takes about {_rounded(vertices):,} vertices, {_rounded(times):,} times those of "
            f"the first; {place} {flow} stretches most. {self.remedy}"
        )


def growth_warning(
    motion: Motion, points: Points, faces: Faces, vertices: int, last: int | None = None
) -> GrowthWarning | None:
    """Return a warning of a shot's growth: where `max_vertices` is passed, else of the largest frame.

    Arguments are those of `forecast_growth`. None where the growth is usual.
    """
    if motion.resampling is None:
        return None
    most: Growth | None = None
    for growth in forecast_growth(motion, points, faces, vertices, last):
        if most is None or growth.vertices > most.vertices:
            most = growth
        if growth.vertices > motion.resampling.thresholds.max_vertices:
            break
    if most is None or most.times < RUNAWAY or most.vertices < MANY_VERTICES:
        return None
    return GrowthWarning(most, _remedy(motion, most, points))


def _remedy(motion: Motion, growth: Growth, points: Points) -> str:
    """Return what makes a surface grow less."""
    try:
        costs = [cost for cost in flow_costs(motion, growth.frame, points) if cost.place == growth.place]
    except FrameError:
        costs = []
    remedies = max(costs, key=lambda cost: cost.substeps).settings.remedies if costs else []
    first = ", ".join(remedies or ["lower its amount or strength"])
    return (
        f"{first[0].upper()}{first[1:]}, or raise resample.max_edge_length; resample.max_growth stops a run "
        "at the growth that you set."
    )


def _rounded(number: float) -> int:
    """Return a number with two digits that count."""
    return int(round(number, 1 - math.floor(math.log10(number)))) if number >= 10 else round(number)


def forecast_growth(
    motion: Motion, points: Points, faces: Faces, vertices: int, last: int | None = None
) -> Iterator[Growth]:
    """Yield the growth of each frame after the first, until the flow fails.

    points, faces  (V, 3) and (F, 3): the first frame, or the subject at rest
    vertices       number of vertices of the first frame
    last           the last frame of interest; by default the shot's

    Nothing is yielded where nothing is resampled.
    """
    first, *others = (number for number in motion.frames if last is None or number <= last)
    if motion.resampling is None or not (len(faces) and others and flows_of(motion.flow)):
        return
    corners, areas = _small_triangles(points, faces, _sample_size(motion, others[0], points, len(others)))
    if not len(areas):
        return
    at_rest, names = _Rest.of(corners, areas), [flow.name for flow in flows_of(motion.flow)]
    by_flow, splits, start_edge = np.ones(len(names)), 1.0, motion.longest_edge(first)
    for number in others:
        for k, flow in enumerate(flows_of(motion.limit_steps(motion.flow, number))):
            try:
                corners = checked_displacement(flow, corners, *motion.step(number), number)
            except FrameError:
                return
            before, splits = splits, at_rest.splits(corners)
            by_flow[k] *= splits / before
        edge = motion.longest_edge(number)
        times = splits if edge is None or start_edge is None else splits * (start_edge / edge) ** 2
        strongest = int(np.argmax(by_flow))
        yield Growth(
            number, round(vertices * times), times, motion.place_of_flow(strongest), names[strongest]
        )


def flows_of(flow: Flow) -> tuple[Flow, ...]:
    """Return the flows of a shot, which act one after another."""
    return flow.flows if isinstance(flow, Sequence) else (flow,)


def _sample_size(motion: Motion, frame: int, points: Points, frames: int) -> int:
    """Return how many triangles can be carried through all frames in seconds."""
    try:
        cost = costliest_flow(motion, frame, points)
    except FrameError:
        return FEWEST
    substeps = 1.0 if cost is None else max(1.0, cost.substeps)
    return int(min(SAMPLE, max(FEWEST, MOST_MOVES / (3 * substeps * frames))))


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
