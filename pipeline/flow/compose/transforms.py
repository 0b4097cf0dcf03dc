"""Transformed flows: moved, rotated and scaled, or mirrored."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from pipeline.arrays import Floats, Points
from pipeline.errors import FrameError
from pipeline.flow.flow import Flow
from pipeline.flow.keyframes import Number, VectorParameter, number_at, vector_at
from pipeline.flow.vectors import ORIGIN, Vector, X, transform, unit


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
