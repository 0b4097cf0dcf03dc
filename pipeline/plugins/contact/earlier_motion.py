"""The motion of points of a subject by the flows before `contact`: where it would be without a floor."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flowsculpt import Flow
from flowsculpt.api.meshes import Floats

if TYPE_CHECKING:
    from flowsculpt.api.shots import Subject

STEP = 1.0 / 24.0
"""Seconds from one stored state of the points to the next."""

SAMPLES = 512  # points on faces, and as many vertices at most

MARGIN = 0.0005
"""How far below the floor points that lie between the samples may come, of the subject's height."""


class Extent(NamedTuple):
    """The lowest point of a subject, and the x and z of its middle, units."""

    lowest: float
    axis: tuple[float, float]


@dataclass
class EarlierMotion:
    """Points of a subject, moved from rest by flows alone.

    The points are vertices and points on faces. A state depends on its time alone: steps begin at time 0, and
    the last one ends at the time asked for, so that nothing after it matters.

    states  the points at multiples of STEP seconds
    """

    subject: Subject
    place: tuple[float, float, float]
    flow: Flow
    states: dict[int, Floats] = field(default_factory=dict)
    extents: dict[float, Extent] = field(default_factory=dict)
    heights: list[float] = field(default_factory=list)

    def extent(self, time: float) -> Extent:
        """Return the extent at a time in seconds."""
        if time not in self.extents:
            points = self._points(time)
            low, high = points.min(axis=0), points.max(axis=0)
            x, z = (0.5 * float(low[k] + high[k]) for k in (0, 2))
            self.extents[time] = Extent(float(low[1]), (x, z))
        return self.extents[time]

    @property
    def margin(self) -> float:
        """MARGIN in units."""
        return MARGIN * self.height

    @property
    def height(self) -> float:
        """The subject's height at rest, units."""
        if not self.heights:
            size = np.ptp(self._state(0), axis=0)
            self.heights.append(float(size[1] or size.max() or 1.0))
        return self.heights[0]

    def cache_data(self, time: float, dt: float) -> list[Any]:
        """Return what decides the motion from one time to another, JSON-able."""
        first, last = sorted((time, time + dt))
        cells = range(math.floor(first / STEP), math.ceil(last / STEP))
        return [self.flow.cache_data(i * STEP, min(STEP, last - i * STEP)) for i in cells]

    def _points(self, time: float) -> Floats:
        whole = math.trunc(time / STEP)
        points = self._state(whole)
        rest = time - whole * STEP
        return self.flow.displace(points, whole * STEP, rest) if rest else points

    def _state(self, index: int) -> Floats:
        """Return the points at index × STEP, by steps from the nearest state towards time 0."""
        if 0 not in self.states:
            self.states[0] = self._rest_points()
        sign, known = (1 if index > 0 else -1), index
        while known not in self.states:
            known -= sign
        while known != index:
            self.states[known + sign] = self.flow.displace(self.states[known], known * STEP, sign * STEP)
            known += sign
        return self.states[index]

    def _rest_points(self) -> Floats:
        """Return vertices, the lowest ones among them, and points on faces, the same in every run."""
        mesh = self.subject.body.build()
        vertices, faces = mesh.vertices + np.array(self.place), mesh.faces
        order = np.argsort(vertices[:, 1], kind="stable")
        kept = np.ascontiguousarray(vertices[order[:: -(-len(order) // SAMPLES)]])
        if not len(faces):
            return kept
        random = np.random.default_rng(1)
        corners = vertices[faces]
        sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.cumsum(np.sqrt((sides**2).sum(axis=1)))
        chosen = np.searchsorted(areas, areas[-1] * (np.arange(SAMPLES) + 0.5) / SAMPLES)
        weights = random.dirichlet((1.0, 1.0, 1.0), SAMPLES)
        inside = (weights[:, :, None] * corners[np.minimum(chosen, len(faces) - 1)]).sum(axis=1)
        return np.concatenate([kept, inside])
