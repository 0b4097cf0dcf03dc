"""The motion of points of a subject by the flows before `contact`: where it would be without a floor."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from flowsculpt import Flow, FrameError
from flowsculpt.api.meshes import Floats

if TYPE_CHECKING:
    from flowsculpt.api.shots import Motion, Subject

STEP = 1.0 / 24.0
"""Seconds from one stored state of the points to the next."""

ROUNDING = 1e-9
"""Seconds by which sums of steps may differ from a multiple of STEP."""

SAMPLES = 512  # points on faces, and as many vertices at most

OF_COPIES = 8
"""Up to so many times SAMPLES vertices are kept of copies; each has so many edges along its longest side."""

MARGIN = 0.0005
"""How far below a floor points that lie between the samples may come, of the subject's height."""


class MovedPoints:
    """Points moved from rest by a flow.

    A state depends on its time alone: steps begin at time 0, and the last one ends at the time asked for, so
    that nothing after it matters.

    rest    the points (N, 3) at rest; None are those of `rest_points`
    states  the points at multiples of STEP seconds
    """

    def __init__(self, flow: Flow, rest: Floats | None = None) -> None:
        self.flow = flow
        self.states: dict[int, Floats] = {} if rest is None else {0: np.ascontiguousarray(rest)}

    def rest_points(self) -> Floats:
        """Return the points (N, 3) at rest, the same in every run."""
        raise NotImplementedError

    def points(self, time: float) -> Floats:
        """Return the points (N, 3) at a time in seconds."""
        nearest, whole = round(time / STEP), math.trunc(time / STEP)
        if abs(time - nearest * STEP) < ROUNDING:
            return self._state(nearest)
        return self.flow.displace(self._state(whole), whole * STEP, time - whole * STEP)

    def _state(self, index: int) -> Floats:
        """Return the points at index × STEP, by steps from the nearest state towards time 0."""
        if 0 not in self.states:
            self.states[0] = self.rest_points()
        sign, known = (1 if index > 0 else -1), index
        while known not in self.states:
            known -= sign
        while known != index:
            self.states[known + sign] = self.flow.displace(self.states[known], known * STEP, sign * STEP)
            known += sign
        return self.states[index]


class EarlierMotion(MovedPoints):
    """Vertices of a subject and points on its faces, of all its copies, moved by the flows before `contact`.

    name     of the subject in its shot
    motions  those of the shot's subjects, complete once the shot is read; none of a single subject
    """

    def __init__(
        self,
        subject: Subject,
        place: tuple[float, float, float],
        flow: Flow,
        name: str = "",
        motions: Mapping[str, Motion | None] | None = None,
    ) -> None:
        super().__init__(flow)
        self.subject, self.place, self.name, self.motions = subject, place, name, motions or {}

    @property
    def of_copies(self) -> Motion | None:
        """The motion of a subject that has copies; None of others."""
        motion = self.motions.get(self.name)
        return motion if motion is not None and motion.copies is not None else None

    @property
    def margin(self) -> float:
        """MARGIN in units."""
        return MARGIN * self.height

    @cached_property
    def height(self) -> float:
        """The subject's height at rest, units."""
        size = np.ptp(self.points(0.0), axis=0)
        return float(size[1] or size.max() or 1.0)

    def rest_points(self) -> Floats:
        """Return vertices, the lowest ones among them, and points on faces, the same in every run.

        Raises FrameError for rigid copies.
        """
        mesh, most = self.subject.body.build(), SAMPLES
        vertices, faces = mesh.vertices + np.array(self.place), mesh.faces
        if self.of_copies is not None:
            if self.of_copies.is_rigid:
                raise FrameError(f"contact squashes, and {self.name} has rigid copies. Leave rigid out.")
            copies = self.of_copies.mesh_at_rest(float(np.ptp(vertices, axis=0).max()) / OF_COPIES)
            vertices, faces, most = copies.vertices, copies.faces, OF_COPIES * SAMPLES
        order = np.argsort(vertices[:, 1], kind="stable")
        kept = np.ascontiguousarray(vertices[order[:: -(-len(order) // most)]])
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
