"""Flows seen elsewhere: in a frame that is moved, turned and scaled, or in a mirror."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from pipeline.arrays import Floats, Points
from pipeline.errors import FrameError
from pipeline.flow.flow import Flow, transformed
from pipeline.flow.keyframes import Number, Place, Vector, number_at, place_at
from pipeline.flow.vectors import ORIGIN, X, unit


@dataclass(frozen=True)
class Frame:
    """Where something is placed: scaled, then turned, then moved; all of it may be keyed.

    translate  where its origin lies
    rotate     radians about x, then y, then z (Blender's *XYZ Euler*), about its origin
    scale      a factor above 0
    """

    translate: Place = ORIGIN
    rotate: Place = ORIGIN
    scale: Number = 1.0
    name: ClassVar = "placed"

    def at(self, time: float) -> tuple[Floats, Floats]:
        """Its origin (3,) and its axes, the columns of a matrix (3, 3).

        Raises FrameError where the scale is not above 0, or not finite.
        """
        scale = float(number_at(self.scale, time))
        if not 0 < scale < math.inf:
            raise FrameError(
                f"a frame has the scale {scale:g} at {time:g} s, in which nothing has room; "
                "it must be above 0, and finite. Mend its keys."
            )
        (cx, cy, cz), (sx, sy, sz) = (
            [turn(angle) for angle in place_at(self.rotate, time)] for turn in (math.cos, math.sin)
        )
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
        about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
        about_z = np.array([[cz, -sz, 0.0], [sz, cz, 0.0], [0.0, 0.0, 1.0]])
        return np.array(place_at(self.translate, time)), scale * (about_z @ about_y @ about_x)


@dataclass(frozen=True)
class Mirror:
    """A plane through `centre` across `normal`: what turns left before it turns right in it."""

    normal: Vector = X
    centre: Vector = ORIGIN
    name: ClassVar = "mirrored"

    def at(self, time: float) -> tuple[Floats, Floats]:
        """The origin's image (3,) and the axes', the columns of a matrix (3, 3); the same at any time."""
        across, centre = np.array(unit(self.normal)), np.array(self.centre)
        axes: Floats = np.eye(3) - 2.0 * np.outer(across, across)
        return centre - axes @ centre, axes


@dataclass(frozen=True)
class Placed(Flow):
    """A flow in a frame: a copy of it, moved, turned and scaled, distances and speeds alike; or in a mirror.

    The frame brings the flow to the points; where it moves, it does not carry them along. It is taken at the
    middle of each step.

    max_step  how far a sub-step along velocities may take a point, if not without bound
    """

    flow: Flow
    frame: Frame | Mirror
    max_step: float | None = None

    def displace(self, points: Points, time: float, dt: float) -> Points:
        origin, axes = self.frame.at(time + dt / 2)
        back: Floats = np.linalg.inv(axes).astype(np.float64)
        inside = transformed(back, points - origin)
        return transformed(axes, self._inside(axes).displace(inside, time, dt)) + origin

    def cache_data(self, time: float, dt: float) -> Any:
        origin, axes = self.frame.at(time + dt / 2)
        return {"placed": [origin.tolist(), axes.tolist()], "flow": self._inside(axes).cache_data(time, dt)}

    def with_max_step(self, max_step: float) -> Placed:
        return replace(self, max_step=max_step)

    def _inside(self, axes: Floats) -> Flow:
        """Return the flow with the maximum step in units of the frame."""
        scale = float(np.linalg.norm(axes[:, 0]))
        return self.flow if self.max_step is None else self.flow.with_max_step(self.max_step / scale)

    @property
    def name(self) -> str:
        return f"{self.frame.name} {self.flow.name}"
