"""Analytic surfaces of solids: the nearest point on them, and the normal there.

Each is centred at the origin, like the meshes of `pipeline.mesh.solids`. A point on a flat side or
a straight edge keeps its bits.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import AnyArray, Points, Vectors
from pipeline.mesh.normals import unit

CLOSE = 1e-9
"""Distance, in sizes of the solid, that counts as on a crease."""

RIM = 2e-4
"""Distance from a round rim, in radii, within which points are put on the rim.

Interpolation between vertices 20° apart bends a rim by as much.
"""


AHEAD, UP = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
"""Direction for a point in the middle, where all directions are equal."""


class AnalyticSurface(ABC):
    """Maps points (N, 3) to the nearest points on it: `surface(points)`."""

    @abstractmethod
    def __call__(self, points: Points) -> Points:
        """Return the nearest point (N, 3) on the surface to each point; of equally near ones, any."""

    @abstractmethod
    def normals(self, points: Points) -> Vectors:
        """Return the outward unit normal (N, 3) at the nearest point to each; zero on a crease."""

    @abstractmethod
    def encloses(self, points: Points) -> AnyArray:
        """Return flags (N,) of the points inside, or on the surface."""


@dataclass(frozen=True)
class SphereSurface(AnalyticSurface):
    """A sphere."""

    radius: float

    def __call__(self, points: Points) -> Points:
        return self.radius * self.normals(points)

    def normals(self, points: Points) -> Vectors:
        return unit(points, UP)

    def encloses(self, points: Points) -> AnyArray:
        return _is_within(points, self.radius)


@dataclass(frozen=True)
class TorusSurface(AnalyticSurface):
    """A torus around y; `radius` reaches to the middle of the tube."""

    radius: float
    tube_radius: float

    def __call__(self, points: Points) -> Points:
        return self._middle(points) + self.tube_radius * self.normals(points)

    def normals(self, points: Points) -> Vectors:
        return unit(points - self._middle(points), UP)

    def encloses(self, points: Points) -> AnyArray:
        return _is_within(points - self._middle(points), self.tube_radius)

    def _middle(self, points: Points) -> Points:
        return self.radius * unit(points * (1.0, 0.0, 1.0), AHEAD)


@dataclass(frozen=True)
class CapsuleSurface(AnalyticSurface):
    """A cylinder along y with round caps; `length` includes them."""

    length: float
    radius: float

    def __call__(self, points: Points) -> Points:
        return self._core(points) + self.radius * self.normals(points)

    def normals(self, points: Points) -> Vectors:
        return unit(points - self._core(points), AHEAD)

    def encloses(self, points: Points) -> AnyArray:
        return _is_within(points - self._core(points), self.radius)

    def _core(self, points: Points) -> Points:
        half = 0.5 * self.length - self.radius
        core = np.zeros_like(points)
        core[:, 1] = np.clip(points[:, 1], -half, half)
        return core


@dataclass(frozen=True)
class CylinderSurface(AnalyticSurface):
    """A cylinder along y with flat caps."""

    length: float
    radius: float

    def __call__(self, points: Points) -> Points:
        points = np.array(points, np.float64)
        half, away = 0.5 * self.length, np.hypot(points[:, 0], points[:, 2])
        above, beyond = np.abs(points[:, 1]) - half, away - self.radius
        rim = (np.abs(above) < RIM * self.radius) & (np.abs(beyond) < RIM * self.radius)
        to_side = rim | (beyond > 0) | (beyond > above)
        to_cap = rim | (above > 0) | ~to_side
        side = unit(points * (1.0, 0.0, 1.0), AHEAD) * self.radius
        points[to_side, 0], points[to_side, 2] = side[to_side, 0], side[to_side, 2]
        points[to_cap, 1] = np.copysign(half, points[to_cap, 1])
        return points

    def normals(self, points: Points) -> Vectors:
        on = self(points)
        near = CLOSE * max(self.length, self.radius)
        across = on * (1.0, 0.0, 1.0)
        cap = 0.5 * self.length - np.abs(on[:, 1]) < near
        side = self.radius - np.linalg.norm(across, axis=1) < near
        normals = unit(across, UP)
        normals[cap] = np.sign(on[cap]) * (0.0, 1.0, 0.0)
        normals[cap & side] = 0.0
        return normals

    def encloses(self, points: Points) -> AnyArray:
        low = np.abs(points[:, 1]) <= 0.5 * self.length
        return low & _is_within(points * (1.0, 0.0, 1.0), self.radius)


@dataclass(frozen=True)
class BoxSurface(AnalyticSurface):
    """A box along the axes; `size` holds the full extents."""

    size: tuple[float, float, float]

    def __call__(self, points: Points) -> Points:
        half = 0.5 * np.array(self.size)
        on = np.clip(points, -half, half)
        inside = np.flatnonzero((np.abs(points) < half).all(axis=1))
        nearest = np.argmin(half - np.abs(points[inside]), axis=1)
        on[inside, nearest] = np.copysign(half[nearest], on[inside, nearest])
        return on

    def normals(self, points: Points) -> Vectors:
        on, half = self(points), 0.5 * np.array(self.size)
        sides = half - np.abs(on) < CLOSE * half.max()
        return np.where(sides & (sides.sum(axis=1) == 1)[:, None], np.sign(on), 0.0)

    def encloses(self, points: Points) -> AnyArray:
        return np.asarray((np.abs(points) <= 0.5 * np.array(self.size)).all(axis=1))


@dataclass(frozen=True)
class SheetSurface(AnalyticSurface):
    """A rectangle in the plane y = 0, facing upwards; `size` is along x and z."""

    size: tuple[float, float]

    def __call__(self, points: Points) -> Points:
        half = 0.5 * np.array([self.size[0], 0.0, self.size[1]])
        return np.clip(points, -half, half) + 0.0  # +0.0: the plane is not at -0

    def normals(self, points: Points) -> Vectors:
        return np.tile((0.0, 1.0, 0.0), (len(points), 1))

    def encloses(self, points: Points) -> AnyArray:
        """Return no flag: the surface is open."""
        return np.zeros(len(points), bool)


@dataclass(frozen=True, eq=False)
class RepeatedSurface(AnalyticSurface):
    """Copies of a surface, or the one surface moved.

    middles  (N, 3) of the spheres around the copies, which do not touch
    offsets  (N, 3) from the surface to its copies
    """

    surface: AnalyticSurface
    middles: Points
    offsets: Points

    def __call__(self, points: Points) -> Points:
        moved = self._offsets(points)
        return self.surface(points - moved) + moved

    def normals(self, points: Points) -> Vectors:
        return self.surface.normals(points - self._offsets(points))

    def encloses(self, points: Points) -> AnyArray:
        return self.surface.encloses(points - self._offsets(points))

    def _offsets(self, points: Points) -> Points:
        """Return the offsets (N, 3) of the copies whose middles are nearest to points."""
        if len(self.offsets) == 1:
            return self.offsets
        return np.asarray(self.offsets[nearest_middles(points, self.middles)])


def nearest_middles(points: Points, middles: Points) -> AnyArray:
    """Return for each point (V, 3) the index (V,) of the nearest of the middles (N, 3)."""
    nearest, least = np.zeros(len(points), np.int64), np.full(len(points), np.inf)
    for number, middle in enumerate(middles):
        away = points - middle
        squares = np.einsum("ij,ij->i", away, away)
        nearest[squares < least] = number
        np.minimum(least, squares, out=least)
    return nearest


def _is_within(points: Points, distance: float) -> AnyArray:
    """Return flags (N,) of the points within a distance from the origin."""
    return np.einsum("ij,ij->i", points, points) <= distance * distance
