"""Regions of space, soft at their rims: how much of a flow a point gets."""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from pipeline.arrays import Floats, Points
from pipeline.errors import FrameError, UsageError
from pipeline.flow import _kernels_opcodes as op
from pipeline.flow import _kernels_region as kernels
from pipeline.flow.flow import for_kernels
from pipeline.flow.keyframes import Number, Place, Vector, number_at, place_at
from pipeline.flow.program import Instruction
from pipeline.flow.vectors import ORIGIN, Y, unit

FalloffType = Literal["smooth", "sine", "linear"]

FALLOFF_TYPES = {"smooth": kernels.SMOOTH, "sine": kernels.SINE, "linear": kernels.LINEAR}

STEEPEST_FALL = {"smooth": 1.875, "sine": np.pi / 2, "linear": 1.0}
"""The steepest slope of each, per falloff."""


@dataclass(frozen=True, kw_only=True)
class Region(ABC):
    """What all share. Inside a point's weight is 1, from `falloff` outside on it is 0.

    falloff  how wide the rim is, in scene units, outside of the region's surface; 0: none
    falloff_type  the profile of the falloff: smooth, with continuous second derivatives (Perlin, *Improving
             Noise*, SIGGRAPH 2002), sine, with continuous first ones, or linear
    invert   the weight is 1 where it was 0, and the other way round
    """

    falloff: Number = 0.0
    falloff_type: FalloffType = "smooth"
    invert: bool = False

    def weight(self, points: Points, time: float) -> Floats:
        """Weights (N,) of points (N, 3), from 0 to 1. Raises FrameError where the region has no size."""
        points, closing = for_kernels(points), self.closing(time)
        out = np.empty(len(points))
        kernels.weights(points, closing.kind, np.array(closing.numbers), out)
        return out

    def closing(self, time: float) -> Instruction:
        """The bracket that closes a group of a velocity program by this region."""
        first, last = self._measures(time)
        factors = (0.0, 1.0) if self.invert else (1.0, 0.0)
        shape = (*first, *(0.0,) * (6 - len(first)))
        numbers = (*shape, self.falloff_at(time), *factors, float(FALLOFF_TYPES[self.falloff_type]), *last)
        return Instruction(self._opcode, (*numbers, *(0.0,) * (op.COLUMNS - len(numbers))))

    def cache_data(self, time: float) -> Any:
        """All that decides its weights at a time, JSON-able."""
        closing = self.closing(time)
        return [closing.kind, list(closing.numbers) if closing.identity is None else closing.identity]

    @property
    @abstractmethod
    def _opcode(self) -> int:
        """What closes a group by it."""

    @abstractmethod
    def _measures(self, time: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """What stands in its row before the falloff (at most 6 numbers), and after the fall (at most 2)."""

    @abstractmethod
    def bounds(self, time: float) -> tuple[Vector, Vector]:
        """A box that holds it and its rim: its middle, and half its sides. Of a half-space, what is NEAR."""

    def falloff_at(self, time: float) -> float:
        return max(0.0, float(number_at(self.falloff, time)))

    @property
    def name(self) -> str:
        """What error messages call it."""
        return type(self).__name__.lower().replace("halfspace", "half-space")

    def _size(self, measure: Number, what: str, time: float) -> float:
        size = float(number_at(measure, time))
        if not size > 0:
            raise FrameError(
                f"a {self.name} has the {what} {size:g} at {time:g} s, and nothing is in it; "
                "it must be above 0. Mend its keys."
            )
        return size


@dataclass(frozen=True)
class Sphere(Region):
    """All points within a radius of a centre."""

    centre: Place = ORIGIN
    radius: Number = 1.0

    @property
    def _opcode(self) -> int:
        return op.CLOSE_BALL

    def _measures(self, time: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        return (*place_at(self.centre, time), self._size(self.radius, "radius", time)), ()

    def bounds(self, time: float) -> tuple[Vector, Vector]:
        outer = self._size(self.radius, "radius", time) + self.falloff_at(time)
        return place_at(self.centre, time), (outer, outer, outer)


@dataclass(frozen=True)
class Box(Region):
    """A box along the axes; one that is turned stands in a frame. size: its three sides."""

    centre: Place = ORIGIN
    size: Vector = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        if not min(self.size) > 0:
            raise UsageError(f"a box of the size {list(self.size)} holds nothing; its sides must be above 0")

    @property
    def _opcode(self) -> int:
        return op.CLOSE_BOX

    def _measures(self, time: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        return (*place_at(self.centre, time), *(0.5 * side for side in self.size)), ()

    def bounds(self, time: float) -> tuple[Vector, Vector]:
        x, y, z = (0.5 * side + self.falloff_at(time) for side in self.size)
        return place_at(self.centre, time), (x, y, z)


@dataclass(frozen=True)
class HalfSpace(Region):
    """All points below a plane through `centre`, seen along its normal."""

    centre: Place = ORIGIN
    normal: Vector = Y

    @property
    def _opcode(self) -> int:
        return op.CLOSE_HALF_SPACE

    def _measures(self, time: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        return (*place_at(self.centre, time), *unit(self.normal)), ()

    def bounds(self, time: float) -> tuple[Vector, Vector]:
        near = NEAR + self.falloff_at(time)
        return place_at(self.centre, time), (near, near, near)


NEAR = 4.0
"""Scene units about its centre: what of a half-space, which has no end, is looked at."""


@dataclass(frozen=True)
class _Round(Region):
    """About a piece of a line: `length` along `axis`, its middle at `centre`."""

    axis: Vector = Y
    centre: Place = ORIGIN
    length: Number = 1.0
    radius: Number = 0.5

    def _measures(self, time: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        sizes = 0.5 * self._size(self.length, "length", time), self._size(self.radius, "radius", time)
        return (*place_at(self.centre, time), *unit(self.axis)), sizes

    def bounds(self, time: float) -> tuple[Vector, Vector]:
        _, (half, radius) = self._measures(time)
        outer = radius + self.falloff_at(time)
        x, y, z = (half * abs(part) + outer for part in unit(self.axis))
        return place_at(self.centre, time), (x, y, z)


@dataclass(frozen=True)
class Capsule(_Round):
    """All points within a radius of a piece of a line."""

    @property
    def _opcode(self) -> int:
        return op.CLOSE_CAPSULE


@dataclass(frozen=True)
class Cylinder(_Round):
    """A cylinder with flat ends."""

    @property
    def _opcode(self) -> int:
        return op.CLOSE_CYLINDER


@dataclass(frozen=True, eq=False)
class SampledRegion(Region):
    """A region of any form, by how far points lie outside of it at the nodes of a grid; negative inside.

    distances  float64 (nx, ny, nz), at least 2 along each axis; trilinear between nodes
    origin     where the first node lies
    spacing    between nodes, scene units

    Beyond the grid the distances of its rim hold, so it should reach `falloff` around the region. Raises
    UsageError where the distances are no such grid, or not finite.
    """

    distances: Floats
    origin: Vector = ORIGIN
    spacing: float = 1.0
    _numbers: Floats = field(init=False, repr=False)
    _digest: str = field(init=False, repr=False)

    def __post_init__(self) -> None:
        grid = np.array(self.distances, dtype=np.float64, order="C")
        if grid.ndim != 3 or min(grid.shape) < 2 or not np.isfinite(grid).all() or not self.spacing > 0:
            raise UsageError(
                f"distances of shape {grid.shape} with a spacing of {self.spacing:g} are no grid to look up "
                "in; they are finite numbers (nx, ny, nz), at least 2 along each axis. Sample them again."
            )
        numbers = np.concatenate([np.array(grid.shape, np.float64), grid.ravel()])
        object.__setattr__(self, "_numbers", numbers)
        object.__setattr__(self, "_digest", hashlib.sha256(numbers.tobytes()).hexdigest())

    def closing(self, time: float) -> Instruction:
        """What stands for it in keys holds a digest of the distances in place of their address."""
        closing = super().closing(time)
        known = [*closing.numbers[:4], self._digest, *closing.numbers[5:]]
        return closing._replace(identity=known, owner=self)

    @property
    def _opcode(self) -> int:
        return op.CLOSE_SAMPLED

    def _measures(self, time: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        address = float(self._numbers.ctypes.data)
        return (*self.origin, self.spacing, address), ()

    def bounds(self, time: float) -> tuple[Vector, Vector]:
        half = 0.5 * self.spacing * (np.array(self.distances.shape) - 1.0)
        (x, y, z), (u, v, w) = (np.array(self.origin) + half).tolist(), half.tolist()
        return (x, y, z), (u, v, w)
