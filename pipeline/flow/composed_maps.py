"""Maps made of flows: one after another, backwards, repeated, transformed and mirrored."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from pipeline.arrays import Floats, Points
from pipeline.errors import FrameError, UsageError
from pipeline.flow.flow import Flow, FlowStep
from pipeline.flow.parameters import (
    ORIGIN,
    Number,
    Vector,
    VectorParameter,
    X,
    number_at,
    transform,
    unit,
    vector_at,
)

MAX_ROUNDS = 1000
"""Rounds of a repeated flow within one step."""

ROUND_TOLERANCE = 1e-9
"""The share of a period by which a sum of steps may miss its end."""


class _Ordered(Flow):
    """A flow that consists of the steps of other flows."""

    def displace(self, points: Points, time: float, dt: float) -> Points:
        for step in self.steps(time, dt):
            points = step.flow.displace(points, step.time, step.dt)
        return points

    def cache_data(self, time: float, dt: float) -> Any:
        return [step.flow.cache_data(step.time, step.dt) for step in self.steps(time, dt)]


@dataclass(frozen=True)
class Sequence(_Ordered):
    """Flows one after another within each step, the first first; with none, nothing moves.

    Backwards they act in the opposite order, so that each undoes its own motion.
    """

    flows: tuple[Flow, ...]

    def steps(self, time: float, dt: float) -> Iterator[FlowStep]:
        for flow in self.flows if dt >= 0 else reversed(self.flows):
            yield from flow.steps(time, dt)

    def with_max_step(self, max_step: float) -> Sequence:
        return Sequence(tuple(flow.with_max_step(max_step) for flow in self.flows))

    @property
    def name(self) -> str:
        return ", ".join(flow.name for flow in self.flows)


@dataclass(frozen=True)
class Reversed(_Ordered):
    """A flow run backwards in time: it undoes within `duration` seconds its motion from 0 to `duration`."""

    flow: Flow
    duration: float

    def steps(self, time: float, dt: float) -> Iterator[FlowStep]:
        yield from self.flow.steps(self.duration - time, -dt)

    def with_max_step(self, max_step: float) -> Reversed:
        return replace(self, flow=self.flow.with_max_step(max_step))

    @property
    def name(self) -> str:
        return f"reversed {self.flow.name}"


@dataclass(frozen=True)
class Repeated(_Ordered):
    """A flow from 0 to `period` seconds, repeated.

    A step across the end of a round is cut there, so that rounds do not depend on the frames. The motion of a
    round stays: a twist keyed from 0° to 60° adds 60° in each. Raises UsageError for an invalid period.
    """

    flow: Flow
    period: float

    def __post_init__(self) -> None:
        if not (self.period > 0 and math.isfinite(self.period)):
            raise UsageError(f"period is {self.period:g} s; it must be above 0, such as 1 s")

    def steps(self, time: float, dt: float) -> Iterator[FlowStep]:
        """Yield the steps of all rounds. Raises FrameError where they are more than MAX_ROUNDS."""
        if abs(dt) > MAX_ROUNDS * self.period:
            raise FrameError(
                f"flow {self.name} at {time:g} s goes through {abs(dt) / self.period:.3g} rounds in a frame; "
                f"{MAX_ROUNDS} are the most. Lengthen its period."
            )
        for start, length in _rounds(time / self.period, dt / self.period):
            yield from self.flow.steps(start * self.period, length * self.period)

    def with_max_step(self, max_step: float) -> Repeated:
        return replace(self, flow=self.flow.with_max_step(max_step))

    @property
    def name(self) -> str:
        return f"repeated {self.flow.name}"


def _rounds(time: float, dt: float) -> Iterator[tuple[float, float]]:
    """Cut a step, in periods, where rounds end: yield each piece's start within its round, and its length."""
    if dt < 0:  # the same rounds, seen from their ends
        yield from ((1.0 - start, -length) for start, length in _rounds(-time, -dt))
        return
    left = dt
    while True:
        turn = math.floor(time + ROUND_TOLERANCE)
        start = max(0.0, time - turn)
        if start + left <= 1.0 + ROUND_TOLERANCE:
            yield start, left
            return
        yield start, 1.0 - start
        left -= 1.0 - start
        time = turn + 1.0


@dataclass(frozen=True)
class Transform:
    """Scale, then rotation, then translation; all may be keyed.

    translate  position of the origin
    rotate     radians about x, then y, then z (Blender's *XYZ Euler*), about the origin
    scale      a factor above 0
    """

    translate: VectorParameter = ORIGIN
    rotate: VectorParameter = ORIGIN
    scale: Number = 1.0
    name: ClassVar = "placed"

    def at(self, time: float) -> tuple[Floats, Floats]:
        """Return the origin (3,) and the axes, the columns of a matrix (3, 3).

        Raises FrameError where the scale is not above 0, or not finite.
        """
        scale = float(number_at(self.scale, time))
        if not 0 < scale < math.inf:
            raise FrameError(
                f"a frame has the scale {scale:g} at {time:g} s; it must be above 0, and finite. "
                "Correct its keys."
            )
        (cx, cy, cz), (sx, sy, sz) = (
            [function(angle) for angle in vector_at(self.rotate, time)] for function in (math.cos, math.sin)
        )
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
        about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
        about_z = np.array([[cz, -sz, 0.0], [sz, cz, 0.0], [0.0, 0.0, 1.0]])
        return np.array(vector_at(self.translate, time)), scale * (about_z @ about_y @ about_x)


@dataclass(frozen=True)
class Mirror:
    """A reflection across the plane through `centre` with the normal `normal`."""

    normal: Vector = X
    centre: Vector = ORIGIN
    name: ClassVar = "mirrored"

    def at(self, time: float) -> tuple[Floats, Floats]:
        """Return the images of the origin (3,) and of the axes, the columns of a matrix (3, 3)."""
        normal, centre = np.array(unit(self.normal)), np.array(self.centre)
        axes: Floats = np.eye(3) - 2.0 * np.outer(normal, normal)
        return centre - axes @ centre, axes


@dataclass(frozen=True)
class Placed(Flow):
    """A flow transformed like an object, distances and speeds alike; or mirrored.

    A moving transform moves the flow, not the points. It is taken at the middle of each step.

    max_step  the longest sub-step along velocities, if any
    """

    flow: Flow
    transform: Transform | Mirror
    max_step: float | None = None

    def displace(self, points: Points, time: float, dt: float) -> Points:
        origin, axes = self.transform.at(time + dt / 2)
        back: Floats = np.linalg.inv(axes).astype(np.float64)
        inside = transform(back, points - origin)
        return transform(axes, self._inside(axes).displace(inside, time, dt)) + origin

    def cache_data(self, time: float, dt: float) -> Any:
        origin, axes = self.transform.at(time + dt / 2)
        flow = self._inside(axes).cache_data(time, dt)
        return {"placed": [origin.tolist(), axes.tolist()], "flow": flow}

    def with_max_step(self, max_step: float) -> Placed:
        return replace(self, max_step=max_step)

    def _inside(self, axes: Floats) -> Flow:
        """Return the flow with the maximum step in its own units."""
        scale = float(np.linalg.norm(axes[:, 0]))
        return self.flow if self.max_step is None else self.flow.with_max_step(self.max_step / scale)

    @property
    def name(self) -> str:
        return f"{self.transform.name} {self.flow.name}"
