"""Analytic surfaces of solids: the nearest point on them, the normal there, and texture coordinates.

Each is centred at the origin, like the meshes of `flowsculpt.pipeline.mesh.solids`. A point on a flat side or
a straight edge keeps its bits. A BarLattice has square bars on the lines of a cubic grid, joined to one
closed surface with crisp edges.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from flowsculpt.pipeline.arrays import AnyArray, Faces, Floats, Points, Vectors
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.mesh.meshes import TriangleMesh
from flowsculpt.pipeline.mesh.normals import unit
from flowsculpt.pipeline.mesh.placed_copies import Placements
from flowsculpt.pipeline.mesh.solids import cut_into, positive, square_grid, welded
from flowsculpt.render.scene.texture_projection import turns_around, unfolded_box

CLOSE = 1e-9  # distance, in sizes of the solid, that counts as on a crease

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


class SolidSurface(AnalyticSurface):
    """The surface of a solid, which has an inside and texture coordinates."""

    @abstractmethod
    def encloses(self, points: Points) -> AnyArray:
        """Return flags (N,) of the points inside, or on the surface."""

    @abstractmethod
    def texture(self, points: Points, faces: Faces) -> tuple[Floats, AnyArray]:
        """Return texture coordinates (F, 3, 2) of corners of faces on the surface, and their charts (F,).

        They go from 0 to 1, to the right and upwards seen from outside, and beyond 1 in faces that cross the
        seam behind. Corners of one vertex in faces of one chart have the same coordinates.
        """


@dataclass(frozen=True)
class SphereSurface(SolidSurface):
    """A sphere."""

    radius: float

    def __call__(self, points: Points) -> Points:
        return self.radius * self.normals(points)

    def normals(self, points: Points) -> Vectors:
        return unit(points, UP)

    def encloses(self, points: Points) -> AnyArray:
        return _is_within(points, self.radius)

    def texture(self, points: Points, faces: Faces) -> tuple[Floats, AnyArray]:
        around, charts = turns_around(points[:, 0], points[:, 2], faces)
        up = 0.5 + np.arctan2(points[:, 1], np.hypot(points[:, 0], points[:, 2])) / math.pi
        return np.stack([around, up[faces]], axis=2), charts


@dataclass(frozen=True)
class TorusSurface(SolidSurface):
    """A torus around y; `radius` reaches to the middle of the tube."""

    radius: float
    tube_radius: float

    def __call__(self, points: Points) -> Points:
        return self._middle(points) + self.tube_radius * self.normals(points)

    def normals(self, points: Points) -> Vectors:
        return unit(points - self._middle(points), UP)

    def encloses(self, points: Points) -> AnyArray:
        return _is_within(points - self._middle(points), self.tube_radius)

    def texture(self, points: Points, faces: Faces) -> tuple[Floats, AnyArray]:
        around, charts = turns_around(points[:, 0], points[:, 2], faces)
        away = np.hypot(points[:, 0], points[:, 2]) - self.radius
        up, charts_up = turns_around(points[:, 1], away, faces)
        return np.stack([around, up], axis=2), charts + (len(faces) + 2) * (charts_up > 0)

    def _middle(self, points: Points) -> Points:
        return self.radius * unit(points * (1.0, 0.0, 1.0), AHEAD)


@dataclass(frozen=True)
class CapsuleSurface(SolidSurface):
    """A cylinder along y with round caps; `length` includes them."""

    length: float
    radius: float

    def __call__(self, points: Points) -> Points:
        return self._core(points) + self.radius * self.normals(points)

    def normals(self, points: Points) -> Vectors:
        return unit(points - self._core(points), AHEAD)

    def encloses(self, points: Points) -> AnyArray:
        return _is_within(points - self._core(points), self.radius)

    def texture(self, points: Points, faces: Faces) -> tuple[Floats, AnyArray]:
        around, charts = turns_around(points[:, 0], points[:, 2], faces)
        core, away = self._core(points)[:, 1], np.hypot(points[:, 0], points[:, 2])
        along = core + self.radius * np.arctan2(points[:, 1] - core, away)
        whole = self.length + (math.pi - 2.0) * self.radius
        return np.stack([around, 0.5 + along[faces] / whole], axis=2), charts

    def _core(self, points: Points) -> Points:
        half = 0.5 * self.length - self.radius
        core = np.zeros_like(points)
        core[:, 1] = np.clip(points[:, 1], -half, half)
        return core


@dataclass(frozen=True)
class CylinderSurface(SolidSurface):
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

    def texture(self, points: Points, faces: Faces) -> tuple[Floats, AnyArray]:
        """Return coordinates in which the side is above the two caps, the lower one on the left."""
        around, charts = turns_around(points[:, 0], points[:, 2], faces)
        width, height = 2.0 * math.pi * self.radius, self.length + 2.0 * self.radius
        up = points[faces, 1] / height + 1.0 - 0.5 * self.length / height
        coordinates = np.stack([around, up], axis=2)
        for way in (-1.0, 1.0):
            cap = (way * points[faces, 1] > (0.5 - CLOSE) * self.length).all(axis=1)
            middle = np.array([0.5 + 0.25 * way, self.radius / height])
            coordinates[cap] = middle + points[faces[cap]][..., (0, 2)] * (1.0, -way) / (width, height)
            charts[cap] = len(faces) + 2 + (way > 0.0)
        return coordinates, charts


@dataclass(frozen=True)
class BoxSurface(SolidSurface):
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

    def texture(self, points: Points, faces: Faces) -> tuple[Floats, AnyArray]:
        return unfolded_box(self.size, points, faces, self.normals(points[faces].mean(axis=1)))


@dataclass(frozen=True)
class SheetSurface(SolidSurface):
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

    def texture(self, points: Points, faces: Faces) -> tuple[Floats, AnyArray]:
        along = points[:, (0, 2)] * (1.0, -1.0) / self.size + 0.5
        return along[faces], np.zeros(len(faces), np.int64)


@dataclass(frozen=True, eq=False)
class RepeatedSurface(AnalyticSurface):
    """Copies of a surface, or the one surface moved.

    middles  (N, 3) of the spheres around the copies, which do not touch
    """

    surface: AnalyticSurface
    middles: Points
    placements: Placements

    def __call__(self, points: Points) -> Points:
        copy = self._copies(points)
        return self.placements.placed(self.surface(self.placements.local(points, copy)), copy)

    def normals(self, points: Points) -> Vectors:
        copy = self._copies(points)
        return self.placements.turned(self.surface.normals(self.placements.local(points, copy)), copy)

    def _copies(self, points: Points) -> AnyArray:
        """Return the numbers (N,) of the copies whose middles are nearest to points."""
        if len(self.middles) == 1:
            return np.zeros(len(points), np.int64)
        return nearest_middles(points, self.middles)


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


MAX_CROSSINGS = 8000
"""Crossings of bars: more are finer than a picture, and each costs a hundred triangles even uncut."""

BLOCK = 20_000  # points per block: each is compared with 30 rectangles


@dataclass(frozen=True)
class BarLattice(SolidSurface):
    """Square bars around the origin. If `size` equals `thickness` along an axis they lie in one layer.

    size       full extents in x, y and z, scene units, the outer bars included
    spacing    between the middles of neighbouring bars; adjusted so that whole spacings fill the size
    thickness  of a bar

    Raises UsageError where bars are thicker than the lattice, would meet, or are too many.
    """

    size: tuple[float, float, float]
    spacing: float
    thickness: float

    def __post_init__(self) -> None:
        positive("size, spacing and thickness", np.array([*self.size, self.spacing, self.thickness]))
        if self.spacing <= self.thickness:
            raise UsageError(
                f"spacing {self.spacing:g} must be above thickness {self.thickness:g}, or the bars touch"
            )
        for length in self.size:
            if length != self.thickness and length <= 2 * self.thickness:
                one_layer = f"thickness {self.thickness:g}, for one layer of bars"
                raise UsageError(f"size {length:g} must be {one_layer}, or more than twice that")
        crossings = math.prod(self._along(length) for length in self.size)
        if crossings > MAX_CROSSINGS:
            raise UsageError(
                f"bars {self.spacing:g} apart cross at {crossings:g} places; {MAX_CROSSINGS} are the most. "
                "Widen spacing, or lower size."
            )

    def _along(self, length: float) -> int:
        """Return the number of bars side by side in a length."""
        spare = length - self.thickness
        if spare == 0:
            return 1
        most = math.ceil(spare / self.thickness) - 1
        return 1 + max(1, min(round(spare / self.spacing), most))

    @cached_property
    def crossings(self) -> tuple[int, int, int]:
        """Numbers of bars along x, y and z."""
        x, y, z = (self._along(length) for length in self.size)
        return x, y, z

    @cached_property
    def pitch(self) -> Floats:
        """(3,): the adjusted spacing, scene units; 0 across a single layer."""
        return (np.array(self.size) - self.thickness) / np.maximum(1, np.array(self.crossings) - 1)

    def middles(self, axis: int) -> Floats:
        """Return the coordinates of the crossings along an axis."""
        last = self.crossings[axis] - 1
        return self.pitch[axis] * (np.arange(last + 1) - 0.5 * last)

    def __call__(self, points: Points) -> Points:
        return self._closest(points)[0]

    def normals(self, points: Points) -> Vectors:
        return self._closest(points)[1]

    def encloses(self, points: Points) -> AnyArray:
        middle = np.stack([self.middles(k)[self._nearest_crossing(points, k)] for k in range(3)], axis=1)
        along_bar = np.abs(points) <= 0.5 * np.array(self.size)
        across_bar = np.abs(points - middle) <= 0.5 * self.thickness
        inside = [along_bar[:, k] & np.delete(across_bar, k, axis=1).all(axis=1) for k in range(3)]
        return np.asarray(np.any(inside, axis=0))

    def texture(self, points: Points, faces: Faces) -> tuple[Floats, AnyArray]:
        """Return those of a box of its size; sides behind each other have the same."""
        return unfolded_box(self.size, points, faces, self.normals(points[faces].mean(axis=1)))

    def _closest(self, points: Points) -> tuple[Points, Vectors]:
        points = np.asarray(points, np.float64)
        pieces = [self._nearest(points[i : i + BLOCK]) for i in range(0, max(1, len(points)), BLOCK)]
        return np.concatenate([on for on, _ in pieces]), np.concatenate([normals for _, normals in pieces])

    def _nearest(self, points: Points) -> tuple[Points, Vectors]:
        """Return the nearest points (N, 3), and the normals there.

        Bars go straight through, so the nearest place is next to the nearest crossing, on one of 30
        rectangles: the four sides of each half bar, and an end where there is none.
        """
        node = np.stack([self._nearest_crossing(points, axis) for axis in range(3)], axis=1)
        middle = np.stack([self.middles(axis)[node[:, axis]] for axis in range(3)], axis=1)
        local = points - middle
        low, high, outwards, bar, of_bar = self._rectangles
        goes_on = np.stack([node > 0, node < np.array(self.crossings) - 1], axis=2).reshape(-1, 6)
        on = np.clip(local[:, None], low, high)
        squared = np.where(goes_on[:, bar] == of_bar, ((local[:, None] - on) ** 2).sum(axis=2), np.inf)
        nearest = on[np.arange(len(on)), squared.argmin(axis=1)]
        touched = ((on - nearest[:, None]) ** 2).sum(axis=2) <= (CLOSE * self.thickness) ** 2
        sides = np.sign((touched & np.isfinite(squared)).astype(np.float64) @ outwards)
        sides[np.abs(sides).sum(axis=1) != 1] = 0.0
        return np.where(nearest == local, points, middle + nearest), sides

    def _nearest_crossing(self, points: Points, axis: int) -> NDArray[np.int64]:
        last = self.crossings[axis] - 1
        if last == 0:
            return np.zeros(len(points), np.int64)
        place = np.rint(points[:, axis] / self.pitch[axis] + 0.5 * last)
        return np.clip(place, 0, last).astype(np.int64)

    @cached_property
    def _rectangles(self) -> tuple[Floats, Floats, Floats, AnyArray, AnyArray]:
        """The 30 rectangles about a crossing at the origin.

        Lowest and highest corners and normals, each (30, 3); for each rectangle its half bar of six, and True
        for a side of the bar or False for the end in its place, (30,).
        """
        half, reach = 0.5 * self.thickness, 0.5 * np.maximum(self.pitch, self.thickness)
        low, high = np.full((30, 3), -half), np.full((30, 3), half)
        outwards, bar, of_bar = np.zeros((30, 3)), np.repeat(np.arange(6), 5), np.arange(30) % 5 > 0
        faces = product(range(3), (-1, 1), range(5))
        for row, (axis, way, part) in enumerate(faces):
            facing, side = (axis, way) if part == 0 else ((axis + 1 + part % 2) % 3, 1 if part > 2 else -1)
            if part:
                low[row, axis], high[row, axis] = sorted((way * half, way * reach[axis]))
            low[row, facing] = high[row, facing] = side * half
            outwards[row, facing] = side
        return low, high, outwards, bar, of_bar


def lattice(
    size: tuple[float, float, float] = (2.0, 2.0, 2.0),
    spacing: float = 0.6,
    thickness: float = 0.15,
    edge_length: float | None = None,
) -> TriangleMesh:
    """Return the mesh of a `BarLattice`, its flat sides cut into rectangles with no side over `edge_length`.

    Planes along the sides of the bars divide space into blocks. A block is full if at least two of its three
    extents are across a bar; the surface lies between full and empty blocks.
    """
    shape = BarLattice(size, spacing, thickness)
    cuts = [_cuts(shape, axis, edge_length) for axis in range(3)]
    marks = [np.concatenate([[0], np.cumsum(along)]) for along in cuts]
    across = [np.arange(len(along)) % 2 == 0 for along in cuts]
    x, y, z = np.meshgrid(*across, indexing="ij")
    full = np.pad(x.astype(int) + y + z >= 2, 1)
    parts = []
    for axis, side in product(range(3), (1, -1)):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for block in np.argwhere(full & ~np.roll(full, -side, axis)) - 1:
            m, n = cuts[u][block[u]], cuts[v][block[v]]
            square, faces = square_grid(m, n)
            at = np.empty((len(square), 3))
            at[:, u] = marks[u][block[u]] + np.rint(square[:, 0] * m)
            at[:, v] = marks[v][block[v]] + np.rint(square[:, 1] * n)
            at[:, axis] = marks[axis][block[axis] + (side > 0)]
            parts.append((at, faces if side > 0 else faces[:, ::-1]))
    points, faces = welded(parts)
    marks_hit = points.astype(np.int64)
    return TriangleMesh(
        np.column_stack([_ruler(shape, axis, cuts[axis])[marks_hit[:, axis]] for axis in range(3)]), faces
    )


def _cuts(shape: BarLattice, axis: int, edge_length: float | None) -> list[int]:
    """Return the number of parts of each block along an axis: bars and gaps alternate."""
    bar = cut_into(shape.thickness, edge_length)
    gap = cut_into(shape.pitch[axis] - shape.thickness, edge_length)
    return [gap if k % 2 else bar for k in range(2 * shape.crossings[axis] - 1)]


def _ruler(shape: BarLattice, axis: int, cuts: list[int]) -> Floats:
    """Return the coordinates of the cuts along an axis, scene units."""
    half = 0.5 * shape.thickness
    ends = np.ravel([(at - half, at + half) for at in shape.middles(axis)])
    pieces = [np.linspace(ends[k], ends[k + 1], n + 1)[:-1] for k, n in enumerate(cuts)]
    return np.concatenate([*pieces, ends[-1:]])
