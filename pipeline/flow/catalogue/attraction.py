"""Attraction to points, curves and surfaces, and repulsion from them."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

import numpy as np

from pipeline.arrays import Floats, Points
from pipeline.flow import _kernels_nearest as kernels
from pipeline.flow.choreography import Number, number_at
from pipeline.flow.external import External
from pipeline.flow.parameters import Positive, Sense
from pipeline.flow.spline import catmull_rom
from pipeline.flow.triangle_tree import TriangleTree, segments
from pipeline.kernels import BlockKernel
from pipeline.mesh.triangles import TriangleMesh

PIECES = 16
"""Segments that stand for each span of a curve."""


@dataclass(frozen=True)
class Target:
    """What attracts: triangles, segments or points, all as triangles (T, 3, 3); equal bytes, equal target."""

    data: bytes

    @classmethod
    def of(cls, corners: Floats) -> Target:
        return cls(np.ascontiguousarray(corners, np.float64).tobytes())

    @classmethod
    def points(cls, points: Points) -> Target:
        """Points (P, 3): each place is drawn to the nearest."""
        return cls.of(np.repeat(np.asarray(points, np.float64)[:, None], 3, axis=1))

    @classmethod
    def curve(cls, points: Points, closed: bool = False) -> Target:
        """The smooth curve through points (P, 3), P at least 2."""
        return cls.of(segments(catmull_rom(np.asarray(points, np.float64), closed, PIECES)[0]))

    @classmethod
    def surface(cls, mesh: TriangleMesh, scale: float = 1.0) -> Target:
        return cls.of(scale * mesh.vertices[mesh.faces])

    @cached_property
    def digest(self) -> str:
        return hashlib.sha256(self.data).hexdigest()

    @cached_property
    def tree(self) -> TriangleTree:
        return TriangleTree.of(np.frombuffer(self.data).reshape(-1, 3, 3))


@dataclass(frozen=True)
class Attraction(External):
    """Everything within a distance is drawn to the nearest point of a target, or pushed off it.

    With q the nearest point of the target to p, at the distance d = |q − p| < R,

        velocity = rate · (1 − d²/R²)² · (q − p)

    and beyond R nothing moves. Where two points of the target are equally near the velocity jumps.

    Near the target the distance shrinks as exp(−rate × seconds).

    About a convex target q moves at most as much as p does, and the gradient is at most the rate, which
    decides the sub-steps. Inside a bend it can be steeper: at the height h towards the centre of a curvature
    κ, q moves 1 / (1 − κ h) as much as p along the bend, without bound as h nears the radius 1/κ, where the
    jumps are. There points are followed less closely than `STEP_LIMIT` says; `substeps` helps but for the
    jumps. Source: ours; the falloff is that of `Expansion`.
    """

    target: Target
    rate: Annotated[Number, Sense("of drawing near; negative repels", "1/s")] = 1.0
    radius: Annotated[Positive, Sense("R, beyond which nothing moves", "units")] = 1.0

    @property
    def block(self) -> BlockKernel:
        return kernels.attraction

    def numbers(self, time: float) -> tuple[float, ...]:
        tree = self.target.tree
        rate, radius = number_at(self.rate, time), number_at(self.radius, time)
        return (float(tree.memory.ctypes.data), float(tree.triangles), rate, radius * radius)

    def identity(self, time: float) -> Any:
        return {"attraction": self.target.digest, "numbers": list(self.numbers(time)[1:])}

    def steepness(self, time: float) -> float:
        """A bound for convex targets; see above for others."""
        return abs(number_at(self.rate, time))
