"""Motion within the shutter: where vertices, camera and stage are a moment before or after a frame.

Times are offsets in frames. Within the shot the flow moves the points. Before its first frame and after its
last they move on in a straight line, at the velocity of that end.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.animation import MeshFrame, mesh_at_subframe
from pipeline.arrays import AnyArray, Points, Vectors
from pipeline.flow.flow_map import checked_cache_data
from pipeline.production.render_inputs.framing import Framing, rotate_y
from pipeline.production.render_inputs.shading import Shading
from pipeline.shot import Motion
from render.base.serialise import from_plain, to_plain

Shown = tuple[Points, Vectors | None]

STEP = 1.0 / 64.0
"""Frames to either side for a velocity by differences: short against bends, long against rounding."""


@dataclass(frozen=True, eq=False)
class SurfaceMotion:
    """The vertices and normals of a picture as a function of the offset in frames; `at(0)` is the picture.

    fps            frames per second
    begins, ends   True at the first frame, and at the last
    """

    at: Callable[[float], Shown]
    fps: float
    begins: bool = False
    ends: bool = False

    def displacement(self, offset: float) -> Vectors:
        """Return the displacement from offset 0, (V, 3) scene units."""
        return np.asarray(self.at(offset)[0] - self.at(0.0)[0])

    def velocity(self) -> Vectors:
        """Return velocities, (V, 3) scene units per second: central differences, one-sided at the ends."""
        if self.begins or self.ends:
            step = -STEP if self.begins else STEP
            return self.displacement(step) * (self.fps / step)
        return np.asarray((self.at(STEP)[0] - self.at(-STEP)[0]) * (0.5 * self.fps / STEP))


def flow_motion(motion: Motion, shading: Shading) -> SurfaceMotion:
    """Return the movement of a shot's frame: its mesh, moved by the flow."""
    first, last, frame = motion.frames.first, motion.frames.last, shading.frame

    def points(offset: float) -> Points:
        inside = min(max(frame.number + offset, first), last)
        if inside != frame.number + offset:
            return frame.mesh.vertices + offset * _end_velocity(motion, frame)
        return frame.mesh.vertices if offset == 0.0 else mesh_at_subframe(motion, frame, inside).vertices

    fps = float(motion.rate.fps)
    return SurfaceMotion(lambda o: shading.at(points(o)), fps, frame.number == first, frame.number == last)


def speeds(motion: Motion, shading: Shading) -> AnyArray:
    """Return the speed of the vertices, (V, 1) float32, scene units per second."""
    velocity = flow_motion(motion, shading).velocity()
    return np.asarray(np.linalg.norm(velocity, axis=1, keepdims=True), dtype=np.float32)


def turntable_motion(
    vertices: Points, normals: Vectors | None, spin: float, turn: float, fps: float
) -> SurfaceMotion:
    """Return the movement of a turntable at `spin` radians, which turns by `turn` radians a picture."""

    def at(offset: float) -> Shown:
        angle = spin + offset * turn
        turned_normals = None if normals is None else rotate_y(normals, angle, about_origin=True)
        return np.asarray(rotate_y(vertices, angle), np.float64), turned_normals

    return SurfaceMotion(at, fps)


def _end_velocity(motion: Motion, frame: MeshFrame) -> Vectors:
    """Return (V, 3) scene units per frame at the first or last frame: a one-sided second-order difference."""
    if motion.frames.first == motion.frames.last:
        return np.zeros_like(frame.mesh.vertices)
    step = STEP if frame.number == motion.frames.first else -STEP
    near, far = (mesh_at_subframe(motion, frame, frame.number + k * step).vertices for k in (1, 2))
    return np.asarray((4.0 * near - far - 3.0 * frame.mesh.vertices) / (2.0 * step))


def flow_cache_data(motion: Motion, number: int, offsets: tuple[float, ...]) -> list[Any]:
    """Return the cache data of the flow between a frame and offsets near it: equal data, equal paths.

    Beyond the ends of the shot, the flow at that end counts.
    """
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
    """Interpolate camera and stage linearly to the next frame; extrapolate beyond the first and the last."""
    if offset == 0.0:
        return framings[number]
    ahead = 1 if offset > 0.0 else -1
    share = abs(offset)
    if number + ahead not in framings:
        ahead, share = -ahead, -share
    if number + ahead not in framings:
        return framings[number]
    here, there = to_plain(framings[number]), to_plain(framings[number + ahead])
    return from_plain(Framing, _mixed(here, there, share))


def _mixed(here: Any, there: Any, share: float) -> Any:
    """Interpolate the numbers in two pieces of plain data of one form; the rest stays that of the first."""
    if isinstance(here, dict):
        return {name: _mixed(value, there[name], share) for name, value in here.items()}
    if isinstance(here, list | tuple):
        return [_mixed(a, b, share) for a, b in zip(here, there, strict=True)]
    is_number = isinstance(here, float) and isinstance(there, float)
    return here + share * (there - here) if is_number else here
