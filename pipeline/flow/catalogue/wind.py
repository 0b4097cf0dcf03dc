"""Wind along a drawn curve."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

import numpy as np

from pipeline.arrays import Floats
from pipeline.flow import _kernels_nearest as kernels
from pipeline.flow.choreography import Number, Vector, number_at
from pipeline.flow.external import External
from pipeline.flow.parameters import Positive, Sense
from pipeline.flow.spline import catmull_rom
from pipeline.flow.triangle_tree import TriangleTree, segments
from pipeline.kernels import BlockKernel

PIECES = 16
"""Segments that stand for each span."""

FALL = 8.0 / (3.0 * math.sqrt(3.0))
"""The steepest of (1 − s²)² for s from 0 to 1: 4 s (1 − s²) at s = 1/√3."""


@dataclass(frozen=True)
class Wind(External):
    """Blows along a smooth curve through points, strongest on it, and not at all beyond a distance.

    With T the curve's unit tangent at its point nearest to p, and d the distance to that,

        velocity = speed · (1 − d²/R²)² · T

    The steepness is that of the falloff, and of T along the curve; where the curve bends within R, places
    inside the bend see T turn faster. Source: ours; the curve is that of `pipeline.flow.spline`.
    """

    through: tuple[Vector, ...]
    speed: Annotated[Number, Sense("on the curve; negative blows backwards", "units/s")] = 1.0
    radius: Annotated[Positive, Sense("R, beyond which no wind blows", "units")] = 1.0
    closed: Annotated[bool, Sense("from the last point the curve goes on to the first")] = False

    @property
    def block(self) -> BlockKernel:
        return kernels.wind

    @cached_property
    def _curve(self) -> tuple[Floats, int, int, float]:
        """The kernel's array, where its triangles and its directions begin, and how fast T turns at most."""
        points, tangents = catmull_rom(np.array(self.through, np.float64), self.closed, PIECES)
        tree = TriangleTree.of(segments(points))
        directions = np.concatenate([tangents[:-1], tangents[1:]], axis=1)[tree.order]
        lengths = np.maximum(np.linalg.norm(np.diff(points, axis=0), axis=1), 1e-12)
        turns = float((np.linalg.norm(np.diff(tangents, axis=0), axis=1) / lengths).max())
        return tree.with_more(directions), tree.triangles, len(tree.memory), turns

    def numbers(self, time: float) -> tuple[float, ...]:
        memory, triangles, directions, _ = self._curve
        speed, radius = number_at(self.speed, time), number_at(self.radius, time)
        return (float(memory.ctypes.data), float(triangles), speed, radius * radius, float(directions))

    def identity(self, time: float) -> Any:
        curve = [list(point) for point in self.through]
        return {"wind": curve, "closed": self.closed, "numbers": list(self.numbers(time)[2:4])}

    def steepness(self, time: float) -> float:
        return abs(number_at(self.speed, time)) * (FALL / number_at(self.radius, time) + self._curve[3])
