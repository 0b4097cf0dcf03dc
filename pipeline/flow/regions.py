"""Regions of space with a falloff: they weigh how much of a flow acts on a point."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from pipeline.arrays import Floats, Points
from pipeline.errors import FrameError, UsageError
from pipeline.flow.kernels import instructions as op
from pipeline.flow.kernels import region_kernels as kernels
from pipeline.flow.parameters import (
    ORIGIN,
    Number,
    Vector,
    VectorParameter,
    Y,
    kernel_points,
    number_at,
    unit,
    vector_at,
)
from pipeline.flow.triangle_tree import ClosedSurface
from pipeline.flow.velocity import Instruction

FalloffType = Literal["smooth", "sine", "linear"]

FALLOFF_TYPES = {"smooth": kernels.SMOOTH, "sine": kernels.SINE, "linear": kernels.LINEAR}

MAX_SLOPE = {"smooth": 1.875, "sine": np.pi / 2, "linear": 1.0}
"""The largest slope of each profile, per falloff."""


@dataclass(frozen=True, kw_only=True)
class Region(ABC):
    """The base of all regions. Inside the weight is 1, from `falloff` outside on it is 0.

    falloff       width of the transition in scene units, outside of the region's surface; 0: none
    falloff_type  its profile: smooth, with continuous second derivatives (Perlin, *Improving Noise*, SIGGRAPH
                  2002), sine, with continuous first ones, or linear
    invert        the weight is 1 outside and 0 inside
    """

    falloff: Number = 0.0
    falloff_type: FalloffType = "smooth"
    invert: bool = False

    def weight(self, points: Points, time: float) -> Floats:
        """Return weights (N,) of points (N, 3), 0 to 1. Raises FrameError where the region has no size."""
        points, closing = kernel_points(points), self.closing(time)
        out = np.empty(len(points))
        kernels.weights(points, closing.opcode, np.array(closing.numbers), out)
        return out

    def closing(self, time: float) -> Instruction:
        """Return the bracket that closes a group of a velocity program by this region."""
        first, last = self._measures(time)
        factors = (0.0, 1.0) if self.invert else (1.0, 0.0)
        shape = (*first, *(0.0,) * (6 - len(first)))
        numbers = (*shape, self.falloff_at(time), *factors, float(FALLOFF_TYPES[self.falloff_type]), *last)
        return Instruction(self.opcode, (*numbers, *(0.0,) * (op.COLUMNS - len(numbers))))

    def cache_data(self, time: float) -> Any:
        """Return all that decides its weights at a time, JSON-able."""
        return self.closing(time).as_data()

    @property
    @abstractmethod
    def opcode(self) -> int:
        """The opcode that closes a group by it."""

    @abstractmethod
    def _measures(self, time: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the numbers of its row before the falloff (at most 6), and after its type (at most 2)."""

    @abstractmethod
    def bounds(self, time: float) -> tuple[Vector, Vector]:
        """Return the middle and half the sides of a box that holds it and its falloff.

        A half-space has no end: its box extends NEAR from its centre.
        """

    def falloff_at(self, time: float) -> float:
        return max(0.0, float(number_at(self.falloff, time)))

    @property
    def name(self) -> str:
        """The name in error messages."""
        return type(self).__name__.removesuffix("Region").lower().replace("halfspace", "half-space")

    def _size(self, measure: Number, what: str, time: float) -> float:
        size = float(number_at(measure, time))
        if not size > 0:
            raise FrameError(
                f"a {self.name} has the {what} {size:g} at {time:g} s and is empty; it must be above 0. "
                "Correct its keys."
            )
        return size


@dataclass(frozen=True)
class SphereRegion(Region):
    """All points within a radius of a centre."""

    opcode: ClassVar[int] = op.CLOSE_BALL

    centre: VectorParameter = ORIGIN
    radius: Number = 1.0

    def _measures(self, time: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        return (*vector_at(self.centre, time), self._size(self.radius, "radius", time)), ()

    def bounds(self, time: float) -> tuple[Vector, Vector]:
        outer = self._size(self.radius, "radius", time) + self.falloff_at(time)
        return vector_at(self.centre, time), (outer, outer, outer)


@dataclass(frozen=True)
class BoxRegion(Region):
    """A box along the axes; a transform rotates it. size: its three sides."""

    opcode: ClassVar[int] = op.CLOSE_BOX

    centre: VectorParameter = ORIGIN
    size: Vector = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        if not min(self.size) > 0:
            raise UsageError(f"a box of the size {list(self.size)} is empty; its sides must be above 0")

    def _measures(self, time: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        return (*vector_at(self.centre, time), *(0.5 * side for side in self.size)), ()

    def bounds(self, time: float) -> tuple[Vector, Vector]:
        x, y, z = (0.5 * side + self.falloff_at(time) for side in self.size)
        return vector_at(self.centre, time), (x, y, z)


@dataclass(frozen=True)
class HalfSpaceRegion(Region):
    """All points below a plane through `centre`; `normal` points up from it."""

    opcode: ClassVar[int] = op.CLOSE_HALF_SPACE

    centre: VectorParameter = ORIGIN
    normal: Vector = Y

    def _measures(self, time: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        return (*vector_at(self.centre, time), *unit(self.normal)), ()

    def bounds(self, time: float) -> tuple[Vector, Vector]:
        near = NEAR + self.falloff_at(time)
        return vector_at(self.centre, time), (near, near, near)


NEAR = 4.0
"""Half the side, in scene units, of the box that stands for a half-space."""


@dataclass(frozen=True)
class _RoundRegion(Region):
    """A region about a line segment: `length` along `axis`, its middle at `centre`."""

    axis: Vector = Y
    centre: VectorParameter = ORIGIN
    length: Number = 1.0
    radius: Number = 0.5

    def _measures(self, time: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        sizes = 0.5 * self._size(self.length, "length", time), self._size(self.radius, "radius", time)
        return (*vector_at(self.centre, time), *unit(self.axis)), sizes

    def bounds(self, time: float) -> tuple[Vector, Vector]:
        _, (half, radius) = self._measures(time)
        outer = radius + self.falloff_at(time)
        x, y, z = (half * abs(part) + outer for part in unit(self.axis))
        return vector_at(self.centre, time), (x, y, z)


@dataclass(frozen=True)
class CapsuleRegion(_RoundRegion):
    """All points within a radius of a line segment."""

    opcode: ClassVar[int] = op.CLOSE_CAPSULE


@dataclass(frozen=True)
class CylinderRegion(_RoundRegion):
    """A cylinder with flat ends."""

    opcode: ClassVar[int] = op.CLOSE_CYLINDER


@dataclass(frozen=True)
class MeshRegion(Region):
    """All points inside a closed surface, by their exact distance from it.

    surface  of a mesh; overlapping parts unite, shells within shells are hollows
    centre   position of the mesh's origin
    scale    factor on the mesh
    """

    opcode: ClassVar[int] = op.CLOSE_MESH

    surface: ClosedSurface
    centre: VectorParameter = ORIGIN
    scale: Number = 1.0

    def closing(self, time: float) -> Instruction:
        """Return the closing bracket, with a digest of the surface instead of its address in keys."""
        closing = super().closing(time)
        known = [*closing.numbers[:4], self.surface.digest, *closing.numbers[5:]]
        return closing._replace(cache_data=known, owner=self.surface.lookup)

    def _measures(self, time: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        address = float(self.surface.lookup.memory.ctypes.data)
        return (*vector_at(self.centre, time), self._size(self.scale, "scale", time), address), ()

    def bounds(self, time: float) -> tuple[Vector, Vector]:
        scale, (_, low, high) = self._size(self.scale, "scale", time), self.surface.lookup
        falloff, centre = self.falloff_at(time), vector_at(self.centre, time)
        x, y, z = (c + 0.5 * scale * (a + b) for c, a, b in zip(centre, low, high, strict=True))
        u, v, w = (0.5 * scale * (b - a) + falloff for a, b in zip(low, high, strict=True))
        return (x, y, z), (u, v, w)
