"""The forecast of a surface's growth: how many vertices frames take, by triangles that the flow carries.

A small triangle in each of some faces of the first frame is carried through the whole shot. The flow
stretches it by a factor along each of two principal directions. Splits follow: a face becomes as many as the
product of both factors. Compression is not counted, for little collapses where a surface becomes thin. For
the largest frames of the gallery's shots, forecasts were 0.7 to 1.7 times the vertices; where little is
stretched and much compressed, they may be three times as many.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flowsculpt import FrameError, TriangleMesh
from flowsculpt.api.flows import MotionForecast
from flowsculpt.api.meshes import Floats, Indices
from flowsculpt.api.shots import Motion

EDGE = 0.66
"""Mean edge length of a resampled surface over the maximum, about."""

MANY_VERTICES = 200_000  # with so many vertices or more, fewer are advised
FEWEST, SAMPLE = 100, 1000  # triangles that are carried where flows take many sub-steps, and otherwise
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


@dataclass(frozen=True)
class GrowthForecast:
    """How many vertices the frames of a motion take.

    motion    whose flows carry the triangles
    points    (V, 3), with `faces` (F, 3): the first frame, or the subject at rest
    vertices  number of vertices of the first frame
    last      the last frame of interest; by default the shot's
    """

    motion: Motion
    points: Floats
    faces: Indices
    vertices: int
    last: int | None = None

    @classmethod
    def at_rest(cls, motion: Motion, last: int) -> GrowthForecast | None:
        """Return the forecast of a subject that is not resampled yet; None where nothing is resampled."""
        longest = motion.longest_edge(motion.frames.first)
        if motion.resampling is None or longest is None:
            return None
        mesh = motion.mesh_at_rest()
        return cls(motion, mesh.vertices, mesh.faces, estimated_vertices(mesh, longest), last)

    def frames(self) -> Iterator[Growth]:
        """Yield the growth of each frame after the first, until the flow fails.

        Nothing is yielded where nothing is resampled.
        """
        motion, faces, last = self.motion, self.faces, self.last
        first, *others = (number for number in motion.frames if last is None or number <= last)
        if motion.resampling is None or not (len(faces) and others and motion.flow.members):
            return
        corners, areas = _small_triangles(self.points, faces, self._sample_size(others[0], len(others)))
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
            yield Growth(number, round(self.vertices * times), times, motion.place_of_flow(k), names[k])

    def warning(self) -> tuple[str, str] | None:
        """Return the flow's place and a warning: where `max_vertices` is passed, else of the largest frame.

        `frame 40 takes about 900,000 vertices, 60 times those of the first; …`. None for usual growth.
        """
        if self.motion.resampling is None:
            return None
        most: Growth | None = None
        for growth in self.frames():
            if most is None or growth.vertices > most.vertices:
                most = growth
            if growth.vertices > self.motion.resampling.thresholds.max_vertices:
                break
        if most is None or most.times < RUNAWAY or most.vertices < MANY_VERTICES:
            return None
        return most.place, (
            f"frame {most.frame} takes about {_rounded(most.vertices):,} vertices, {_rounded(most.times):,} "
            f"times those of the first; {most.place} {most.flow} stretches most. {self._remedy(most)}"
        )

    def _remedy(self, growth: Growth) -> str:
        """Return what makes a surface grow less."""
        try:
            costs = [
                c
                for c in MotionForecast(self.motion).costs(growth.frame, self.points)
                if c.place == growth.place
            ]
        except FrameError:
            costs = []
        remedies = costs[0].settings.remedies if costs else []
        first = ", ".join(remedies or ["lower its amount or strength"])
        more = "raise resample.max_edge_length; resample.max_growth stops a run at the growth that you set."
        return f"{first[0].upper()}{first[1:]}, or {more}"

    def _sample_size(self, frame: int, frames: int) -> int:
        """Return how many triangles can be carried through all frames in seconds."""
        try:
            costs = MotionForecast(self.motion).costs(frame, self.points)
        except FrameError:
            return FEWEST
        substeps = max(1.0, costs[0].substeps) if costs else 1.0
        return int(min(SAMPLE, max(FEWEST, MOST_MOVES / (3 * substeps * frames))))


def estimated_vertices(mesh: TriangleMesh, max_edge_length: float) -> int:
    """Return about how many vertices a surface has when it is resampled: by the area of its triangles."""
    area = float(mesh.areas.sum())
    return math.ceil(0.5 * area / (math.sqrt(3.0) / 4.0 * (EDGE * max_edge_length) ** 2))


def _rounded(number: float) -> int:
    """Return a number with two digits that count."""
    return int(round(number, 1 - math.floor(math.log10(number)))) if number >= 10 else round(number)


def _small_triangles(points: Floats, faces: Indices, count: int) -> tuple[Floats, Floats]:
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
    def of(cls, corners: Floats, weights: Floats) -> _Rest:
        return cls(np.linalg.pinv(np.linalg.qr(_sides(corners)).R), weights)

    def splits(self, corners: Floats) -> float:
        """Return how many faces one has become on average: the product of the factors that are over 1."""
        factors = np.linalg.svd(_sides(corners) @ self.inverse, compute_uv=False)
        return float(np.average(np.maximum(factors, 1.0).prod(axis=1), weights=self.weights))


def _sides(corners: Floats) -> Floats:
    """Return the two sides (N, 3, 2) that leave the first corner of triangles (3 N, 3)."""
    a, b, c = corners.reshape(-1, 3, 3).swapaxes(0, 1)
    return np.stack([b - a, c - a], axis=2)
