"""What a picture shows a moment earlier or later: for shutters, and for layers of motion.

Moments are counted in frames from that of the picture. Within the shot points go with the very flow. Before
its first frame and after its last there is none: there they go straight on as fast as they are at that end.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.animation import MeshFrame, mesh_at_subframe
from pipeline.arrays import AnyArray, Points, Vectors
from pipeline.flow.flow_map import checked_cache_data
from pipeline.production.render_inputs.framing import Framing, turned
from pipeline.production.render_inputs.shading import Shading
from pipeline.shot import Motion

Shown = tuple[Points, Vectors | None]

STEP = 1.0 / 64.0
"""Frames to either side over which a velocity is measured: short beside every bend, long beside rounding."""


@dataclass(frozen=True, eq=False)
class Movement:
    """The vertices of a picture, and their normals, wherever they are: `at(0)` is the picture's own moment.

    fps            frames per second
    begins, ends   whether nothing is known before, or after
    """

    at: Callable[[float], Shown]
    fps: float
    begins: bool = False
    ends: bool = False

    def way(self, offset: float) -> Vectors:
        """(V, 3) scene units, from here to there."""
        return np.asarray(self.at(offset)[0] - self.at(0.0)[0])

    def velocity(self) -> Vectors:
        """(V, 3) scene units per second: the mean over STEP on both sides, at an end on that side alone."""
        if self.begins or self.ends:
            step = -STEP if self.begins else STEP
            return self.way(step) * (self.fps / step)
        return np.asarray((self.at(STEP)[0] - self.at(-STEP)[0]) * (0.5 * self.fps / STEP))


def flowing(motion: Motion, shading: Shading) -> Movement:
    """Of a picture of a shot: the vertices of its mesh, moved by the flow."""
    first, last, frame = motion.frames.first, motion.frames.last, shading.frame

    def points(offset: float) -> Points:
        inside = min(max(frame.number + offset, first), last)
        if inside != frame.number + offset:
            return frame.mesh.vertices + offset * _pace(motion, frame)
        return frame.mesh.vertices if offset == 0.0 else mesh_at_subframe(motion, frame, inside).vertices

    fps = float(motion.rate.fps)
    return Movement(lambda o: shading.at(points(o)), fps, frame.number == first, frame.number == last)


def speeds(motion: Motion, shading: Shading) -> AnyArray:
    """(V, 1) float32: how fast the flow takes the vertices of a picture, scene units per second."""
    velocity = flowing(motion, shading).velocity()
    return np.asarray(np.linalg.norm(velocity, axis=1, keepdims=True), dtype=np.float32)


def turning(vertices: Points, normals: Vectors | None, spin: float, turn: float, fps: float) -> Movement:
    """Of a picture of a turntable, at `spin` radians; each picture is `turn` further than the one before."""

    def at(offset: float) -> Shown:
        angle = spin + offset * turn
        turned_normals = None if normals is None else turned(normals, angle, about_origin=True)
        return np.asarray(turned(vertices, angle), np.float64), turned_normals

    return Movement(at, fps)


def _pace(motion: Motion, frame: MeshFrame) -> Vectors:
    """(V, 3) units per frame at the shot's first or last frame, from its inner side; of second order."""
    if motion.frames.first == motion.frames.last:
        return np.zeros_like(frame.mesh.vertices)
    step = STEP if frame.number == motion.frames.first else -STEP
    near, far = (mesh_at_subframe(motion, frame, frame.number + k * step).vertices for k in (1, 2))
    return np.asarray((4.0 * near - far - 3.0 * frame.mesh.vertices) / (2.0 * step))


def flow_cache_data(motion: Motion, number: int, offsets: tuple[float, ...]) -> list[Any]:
    """What acts on the points of a frame on the way to moments near it, as JSON-able data: equal data, equal
    ways. Of a moment beyond the shot's ends, what acts at that end."""
    first, last = motion.frames.first, motion.frames.last
    found = []
    for offset in offsets:
        if not first <= number + offset <= last:
            if first == last:
                continue
            offset = 2.0 * STEP if number == first else -2.0 * STEP
        flow = motion.limit_steps(motion.flow, number + (offset > 0.0))
        found.append(checked_cache_data(flow, *motion.clock.between(*sorted((number, number + offset)))))
    return found


def framing_at(framings: Mapping[int, Framing], number: int, offset: float) -> Framing:
    """Where camera and stage are a moment before or after a picture: on the straight way to the next one.

    Beyond the first and the last they go on as they came.
    """
    if offset == 0.0:
        return framings[number]
    ahead = 1 if offset > 0.0 else -1
    share = abs(offset)
    if number + ahead not in framings:
        ahead, share = -ahead, -share
    if number + ahead not in framings:
        return framings[number]
    here, there = framings[number].as_data(), framings[number + ahead].as_data()
    return Framing.from_data(_mixed(here, there, share))


def _mixed(here: Any, there: Any, share: float) -> Any:
    """Plain data between two of the same form; what is no number stays as it is here."""
    if isinstance(here, dict):
        return {name: _mixed(value, there[name], share) for name, value in here.items()}
    if isinstance(here, list | tuple):
        return [_mixed(a, b, share) for a, b in zip(here, there, strict=True)]
    is_number = isinstance(here, float) and isinstance(there, float)
    return here + share * (there - here) if is_number else here
