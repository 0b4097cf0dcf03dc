"""Regions of space, soft at their rims: how much of a flow a point gets."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from pipeline.arrays import Floats, Points
from pipeline.errors import FrameError, UsageError
from pipeline.flow.catalogue.directions import ORIGIN, Y, unit
from pipeline.flow.choreography import Number, Place, Vector, number_at, place_at

Fall = Literal["smooth", "sine", "linear"]


@dataclass(frozen=True, kw_only=True)
class Region:
    """What all share. Inside a point's weight is 1, from `falloff` outside on it is 0.

    falloff  how wide the rim is, in scene units, outside of the region's surface; 0: none
    fall     how the weight goes down there: smooth, with continuous second derivatives (Perlin, *Improving
             Noise*, SIGGRAPH 2002), sine, with continuous first ones, or linear
    invert   the weight is 1 where it was 0, and the other way round
    """

    falloff: Number = 0.0
    fall: Fall = "smooth"
    invert: bool = False

    def weight(self, points: Points, time: float) -> Floats:
        """Weights (N,) of points (N, 3), from 0 to 1. Raises FrameError where the region has no size."""
        distance, width = self.distance(points, time), self.falloff_at(time)
        t = np.clip(distance / width, 0.0, 1.0) if width > 0 else (distance > 0).astype(np.float64)
        weight: Floats = _FALLS[self.fall](t)
        return 1.0 - weight if self.invert else weight

    @abstractmethod
    def distance(self, points: Points, time: float) -> Floats:
        """How far (N,) points (N, 3) lie outside; 0 or less inside."""

    @abstractmethod
    def numbers(self, time: float) -> tuple[float, ...]:
        """Its measures at a time."""

    def acting(self, time: float) -> Any:
        """All that decides its weights at a time, JSON-able."""
        return [self.name, *self.numbers(time), self.falloff_at(time), self.fall, self.invert]

    def falloff_at(self, time: float) -> float:
        return float(number_at(self.falloff, time))

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


_FALLS = {
    "smooth": lambda t: 1.0 - t * t * t * (10.0 + t * (6.0 * t - 15.0)),
    "sine": lambda t: 0.5 + 0.5 * np.cos(math.pi * t),
    "linear": lambda t: 1.0 - t,
}

STEEPEST_FALL = {"smooth": 1.875, "sine": math.pi / 2, "linear": 1.0}
"""The steepest slope of each, per falloff."""


@dataclass(frozen=True)
class Sphere(Region):
    """All points within a radius of a centre."""

    centre: Place = ORIGIN
    radius: Number = 1.0

    def distance(self, points: Points, time: float) -> Floats:
        x, y, z, radius = self.numbers(time)
        return _lengths(points - np.array([x, y, z])) - radius

    def numbers(self, time: float) -> tuple[float, ...]:
        return (*place_at(self.centre, time), self._size(self.radius, "radius", time))


@dataclass(frozen=True)
class Box(Region):
    """A box along the axes; one that is turned stands in a frame. size: its three sides."""

    centre: Place = ORIGIN
    size: Vector = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        if not min(self.size) > 0:
            raise UsageError(f"a box of the size {list(self.size)} holds nothing; its sides must be above 0")

    def distance(self, points: Points, time: float) -> Floats:
        beyond = np.abs(points - np.array(place_at(self.centre, time))) - 0.5 * np.array(self.size)
        inside: Floats = np.minimum(beyond.max(axis=1, initial=-np.inf), 0.0)
        return _lengths(np.maximum(beyond, 0.0)) + inside

    def numbers(self, time: float) -> tuple[float, ...]:
        return (*place_at(self.centre, time), *self.size)


@dataclass(frozen=True)
class HalfSpace(Region):
    """All points below a plane through `centre`, seen along its normal."""

    centre: Place = ORIGIN
    normal: Vector = Y

    def distance(self, points: Points, time: float) -> Floats:
        x, y, z = (points - np.array(place_at(self.centre, time))).T
        nx, ny, nz = unit(self.normal)
        height: Floats = nx * x + ny * y + nz * z
        return height

    def numbers(self, time: float) -> tuple[float, ...]:
        return (*place_at(self.centre, time), *unit(self.normal))


@dataclass(frozen=True)
class _Round(Region):
    """About a piece of a line: `length` along `axis`, its middle at `centre`."""

    axis: Vector = Y
    centre: Place = ORIGIN
    length: Number = 1.0
    radius: Number = 0.5

    def numbers(self, time: float) -> tuple[float, ...]:
        sizes = self._size(self.length, "length", time), self._size(self.radius, "radius", time)
        return (*place_at(self.centre, time), *unit(self.axis), *sizes)

    def _along_and_across(self, points: Points, time: float) -> tuple[Floats, Floats]:
        """How far along the axis from the centre, and how far from the axis."""
        offsets = points - np.array(place_at(self.centre, time))
        axis = np.array(unit(self.axis))
        along = offsets[:, 0] * axis[0] + offsets[:, 1] * axis[1] + offsets[:, 2] * axis[2]
        return along, _lengths(offsets - along[:, None] * axis)


@dataclass(frozen=True)
class Capsule(_Round):
    """All points within a radius of a piece of a line."""

    def distance(self, points: Points, time: float) -> Floats:
        *_, length, radius = self.numbers(time)
        along, across = self._along_and_across(points, time)
        beyond = np.maximum(np.abs(along) - 0.5 * length, 0.0)
        return np.sqrt(beyond * beyond + across * across) - radius


@dataclass(frozen=True)
class Cylinder(_Round):
    """A cylinder with flat ends."""

    def distance(self, points: Points, time: float) -> Floats:
        *_, length, radius = self.numbers(time)
        along, across = self._along_and_across(points, time)
        out, beyond = across - radius, np.abs(along) - 0.5 * length
        outside = np.sqrt(np.maximum(out, 0.0) ** 2 + np.maximum(beyond, 0.0) ** 2)
        inside: Floats = np.minimum(np.maximum(out, beyond), 0.0)
        return outside + inside


def _lengths(vectors: Points) -> Floats:
    x, y, z = vectors.T
    lengths: Floats = np.sqrt(x * x + y * y + z * z)
    return lengths
