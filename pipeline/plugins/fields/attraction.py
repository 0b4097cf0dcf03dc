"""Attraction to the nearest point of a target, and wind along a curve: both look for the nearest triangle."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

import numpy as np

from flowsculpt import TriangleMesh
from flowsculpt.api.flows import (
    ExternalField,
    Number,
    ParameterDoc,
    PositiveNumber,
    StableProperty,
    TriangleTree,
    number_at,
)
from flowsculpt.api.meshes import Floats

SEGMENTS = 16  # segments that approximate each span of a curve

FALLOFF_SLOPE = 8.0 / (3.0 * math.sqrt(3.0))
"""The largest slope of (1 − s²)² for s from 0 to 1: 4 s (1 − s²) at s = 1/√3."""


def catmull_rom(points: Floats, closed: bool, pieces: int) -> tuple[Floats, Floats]:
    """Return points on the curve through `points` (P, 3), `pieces` a span, and its unit tangents there.

    Between neighbours the curve is a cubic whose slope at each point is half the vector from the point before
    to the point after; at the ends of an open curve it is the vector to the only neighbour. A closed curve
    ends with its first point again.

    Source: Catmull & Rom, *A Class of Local Interpolating Splines*, 1974.
    """
    if closed:
        points = np.concatenate([points[-1:], points, points[:2]])
    else:
        points = np.concatenate([2.0 * points[:1] - points[1:2], points, 2.0 * points[-1:] - points[-2:-1]])
    slopes = 0.5 * (points[2:] - points[:-2])
    start, end, leaves, arrives = points[1:-2, None], points[2:-1, None], slopes[:-1, None], slopes[1:, None]
    s = (np.arange(pieces) / pieces)[None, :, None]
    curve = (
        (2 * s**3 - 3 * s**2 + 1) * start
        + (s**3 - 2 * s**2 + s) * leaves
        + (3 * s**2 - 2 * s**3) * end
        + (s**3 - s**2) * arrives
    )
    tangent = (
        (6 * s**2 - 6 * s) * (start - end) + (3 * s**2 - 4 * s + 1) * leaves + (3 * s**2 - 2 * s) * arrives
    )
    curve = np.concatenate([curve.reshape(-1, 3), points[-2:-1]])
    tangent = np.concatenate([tangent.reshape(-1, 3), slopes[-1:]])
    return curve, tangent / np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-300)


@dataclass(frozen=True)
class Target:
    """The target of an attraction: triangles, segments or points, all as triangles (T, 3, 3).

    Equal bytes, equal target.
    """

    data: bytes

    @classmethod
    def of(cls, corners: Floats) -> Target:
        return cls(np.ascontiguousarray(corners, np.float64).tobytes())

    @classmethod
    def points(cls, points: Floats) -> Target:
        """Return a target of points (P, 3); the nearest one attracts."""
        return cls.of(np.repeat(np.asarray(points, np.float64)[:, None], 3, axis=1))

    @classmethod
    def curve(cls, points: Floats, closed: bool = False) -> Target:
        """Return the smooth curve through points (P, 3), P at least 2."""
        return cls.of(_segments(catmull_rom(np.asarray(points, np.float64), closed, SEGMENTS)[0]))

    @classmethod
    def surface(cls, mesh: TriangleMesh, scale: float = 1.0) -> Target:
        return cls.of(scale * mesh.vertices[mesh.faces])

    @cached_property
    def digest(self) -> str:
        return hashlib.sha256(self.data).hexdigest()

    @StableProperty
    def tree(self) -> TriangleTree:
        return TriangleTree.of(np.frombuffer(self.data).reshape(-1, 3, 3))


@dataclass(frozen=True)
class Attraction(ExternalField):
    """Everything within a distance is drawn to the nearest point of a target, or pushed off it.

    With q the nearest point of the target to p, at the distance d = |q − p| < R,

        velocity = rate · (1 − d²/R²)² · (q − p)

    and beyond R nothing moves. Where two points of the target are equally near the velocity jumps.

    Near the target the distance shrinks as exp(−rate × seconds).

    About a convex target q moves at most as much as p does, and the gradient is at most the rate, which
    decides the sub-steps. Inside a bend it can be larger: at the height h towards the centre of a curvature
    κ, q moves 1 / (1 − κ h) as much as p along the bend, without bound as h nears the radius 1/κ, where the
    jumps are. There points are followed less closely than `STEP_LIMIT` says; `substeps` helps except at the
    jumps. Source: ours; the falloff is that of `Expansion`.
    """

    block = TriangleTree.attraction

    target: Target
    rate: Annotated[Number, ParameterDoc("of drawing near; negative repels", "1/s")] = 1.0
    radius: Annotated[PositiveNumber, ParameterDoc("R, beyond which nothing moves", "units")] = 1.0

    def numbers(self, time: float) -> tuple[float, ...]:
        tree = self.target.tree
        rate, radius = number_at(self.rate, time), number_at(self.radius, time)
        return (float(tree.memory.ctypes.data), float(tree.triangles), rate, radius * radius)

    def cache_data(self, time: float) -> Any:
        return {"attraction": self.target.digest, "numbers": list(self.numbers(time)[1:])}

    def gradient_bound(self, time: float) -> float:
        """Return the bound for convex targets; see above for others."""
        return abs(number_at(self.rate, time))

    def length_scale(self, time: float) -> float:
        return number_at(self.radius, time)


@dataclass(frozen=True)
class Wind(ExternalField):
    """Blows along a smooth curve through points, strongest on it, and not at all beyond a distance.

    With T the curve's unit tangent at its point nearest to p, and d the distance to that,

        velocity = speed · (1 − d²/R²)² · T

    The gradient bound is that of the falloff, and of T along the curve; where the curve bends within R, T
    turns faster inside the bend. Source: ours.
    """

    block = TriangleTree.wind

    through: tuple[tuple[float, float, float], ...]
    speed: Annotated[Number, ParameterDoc("on the curve; negative blows backwards", "units/s")] = 1.0
    radius: Annotated[PositiveNumber, ParameterDoc("R, beyond which no wind blows", "units")] = 1.0
    closed: Annotated[bool, ParameterDoc("from the last point the curve goes on to the first")] = False

    @StableProperty
    def _curve(self) -> tuple[Floats, int, int, float]:
        """The kernel's array, the starts of its triangles and of its tangents, and the largest turn of T."""
        points, tangents = catmull_rom(np.array(self.through, np.float64), self.closed, SEGMENTS)
        tree = TriangleTree.of(_segments(points))
        ends = np.concatenate([tangents[:-1], tangents[1:]], axis=1)[tree.order]
        lengths = np.maximum(np.linalg.norm(np.diff(points, axis=0), axis=1), 1e-12)
        turns = float((np.linalg.norm(np.diff(tangents, axis=0), axis=1) / lengths).max())
        return tree.with_more(ends), tree.triangles, len(tree.memory), turns

    def numbers(self, time: float) -> tuple[float, ...]:
        memory, triangles, tangents, _ = self._curve
        speed, radius = number_at(self.speed, time), number_at(self.radius, time)
        return (float(memory.ctypes.data), float(triangles), speed, radius * radius, float(tangents))

    def cache_data(self, time: float) -> Any:
        curve = [list(point) for point in self.through]
        return {"wind": curve, "closed": self.closed, "numbers": list(self.numbers(time)[2:4])}

    def gradient_bound(self, time: float) -> float:
        return abs(number_at(self.speed, time)) * (
            FALLOFF_SLOPE / number_at(self.radius, time) + self._curve[3]
        )

    def length_scale(self, time: float) -> float:
        """Return the radius, or that of the sharpest bend."""
        return min(number_at(self.radius, time), 1.0 / max(self._curve[3], 1e-12))


def _segments(points: Floats) -> Floats:
    """Return the segments between points (P, 3) as triangles (P − 1, 3, 3); one point as a triangle."""
    if len(points) == 1:
        return np.repeat(points[None], 3, axis=1)
    return np.stack([points[:-1], points[1:], points[1:]], axis=1)
