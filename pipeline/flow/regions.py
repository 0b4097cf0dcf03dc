"""Regions of space with a falloff, which weigh how much of a flow acts on a point; and trees of triangles.

Triangles, segments and points are searched in a tree of boxes; closed surfaces add what tells inside from
outside.
"""

from __future__ import annotations

import hashlib
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Floats, Points, Vectors
from flowsculpt.pipeline.errors import FrameError, UsageError
from flowsculpt.pipeline.flow.kernels import external_kernels, face_walks
from flowsculpt.pipeline.flow.kernels import instructions as op
from flowsculpt.pipeline.flow.kernels import region_kernels as kernels
from flowsculpt.pipeline.flow.parameters import (
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
from flowsculpt.pipeline.flow.velocity import Instruction, StableProperty
from flowsculpt.pipeline.kernels import BlockKernel
from flowsculpt.pipeline.mesh.meshes import TriangleMesh
from flowsculpt.pipeline.mesh.validation import validate

LEAF = 6  # the most triangles in a leaf


@dataclass(frozen=True, eq=False)
class TriangleTree:
    """Triangles in a tree of boxes, which finds the nearest of them: the flat array of `external_kernels`.

    memory     float64, all of it; further numbers may follow
    triangles  start of the triangles in it
    order      (T,) the index of each among the given triangles
    ranges     (B, 2) the first of the triangles in each box, and the one after its last
    """

    memory: Floats
    triangles: int
    order: AnyArray = field(repr=False)
    ranges: AnyArray = field(repr=False)

    attraction: ClassVar[BlockKernel] = external_kernels.attraction
    wind: ClassVar[BlockKernel] = external_kernels.wind
    """The kernels of fields around triangles; `external_kernels` says which numbers each takes."""

    @classmethod
    def of(cls, corners: Floats) -> TriangleTree:
        """Build the tree of corners (T, 3, 3), T at least 1, by halving boxes across their longest side."""
        centres, order = corners.mean(axis=1), np.arange(len(corners))
        low, high = corners.min(axis=1), corners.max(axis=1)
        counts = _counts_of_boxes(len(corners))
        boxes, ranges = np.empty((counts[len(corners)], 8)), np.empty((counts[len(corners)], 2), np.int64)
        begin, count, index = np.zeros(1, np.int64), np.array([len(corners)]), np.zeros(1, np.int64)
        while len(begin):  # one level of the tree; the first child of a box follows it, with its own children
            boxes[index, 0:3] = _joined(np.minimum, low[order], begin, count)
            boxes[index, 3:6] = _joined(np.maximum, high[order], begin, count)
            boxes[index, 6], boxes[index, 7] = begin, count
            ranges[index] = np.column_stack([begin, begin + count])
            inner = count > LEAF
            begin, count, index = begin[inner], count[inner], index[inner]
            if not len(begin):
                break
            width = _joined(np.maximum, centres[order], begin, count)
            width -= _joined(np.minimum, centres[order], begin, count)
            rows = np.repeat(begin - np.cumsum(count) + count, count) + np.arange(count.sum())
            along = centres[order[rows], np.repeat(np.argmax(width, axis=1), count)]
            order[rows] = order[rows][np.lexsort([along, np.repeat(np.arange(len(count)), count)])]
            half = count // 2
            second = index + 1 + counts[half]
            boxes[index, 6], boxes[index, 7] = second, 0.0
            begin = np.column_stack([begin, begin + half]).ravel()
            count = np.column_stack([half, count - half]).ravel()
            index = np.column_stack([index + 1, second]).ravel()
        memory = np.concatenate([boxes.ravel(), corners[order].ravel()])
        return cls(memory, boxes.size, order, ranges)

    def nearest(
        self, points: Points, normals: Vectors | None = None, least: float = 0.0
    ) -> tuple[AnyArray, Floats]:
        """Return the triangle (P,) nearest to each of points (P, 3), and shares (P, 2) of its corners.

        normals  unit (P, 3): only triangles count whose normals make an angle with them that has a cosine of
                 at least `least`

        Triangles are numbered as they were given, and -1 where none counts; the shares are those of the
        second and the third corner in the nearest point.
        """
        found, shares = np.empty(len(points), np.int64), np.empty((len(points), 2))
        at = self.memory.ctypes.data, self.triangles
        if normals is None:
            external_kernels.find_nearest(*at, points, found, shares)
        else:
            external_kernels.find_facing(*at, points, normals, least, found, shares)
        return np.where(found < 0, -1, self.order[found]), shares

    def walked_to(self, points: Points, ends: Points, starts: AnyArray, neighbours: AnyArray) -> AnyArray:
        """Return the triangle (P,) nearest to each of points (P, 3) over neighbouring triangles.

        ends        (P, 2, 3) points on the surface, twice the same for one end
        starts      (P, 2) the triangles that these are on
        neighbours  (T, 3) the triangles across the edges of each, -1 at a boundary
        """
        found, at = np.empty(len(points), np.int64), (self.memory.ctypes.data, self.triangles)
        across = np.append(self.places, -1)[neighbours[self.order]]
        face_walks.walk_to_nearest(*at, across, points, ends, self.places[starts], found)
        return np.asarray(self.order[found])

    def shares_on(self, triangles: AnyArray, points: Points) -> Floats:
        """Return the shares (P, 2) in triangles (P,) at the places there nearest to points (P, 3)."""
        shares, at = np.empty((len(points), 2)), (self.memory.ctypes.data, self.triangles)
        face_walks.find_shares(*at, points, self.places[triangles], shares)
        return shares

    @cached_property
    def places(self) -> AnyArray:
        """The place (T,) in the tree of each of the given triangles."""
        return np.argsort(self.order)

    def with_distances(self, first: Points, spacing: float, shape: tuple[int, ...]) -> Floats:
        """Return the array of `region_kernels`; it ends with signed distances on a grid of a shape.

        first    the first node (3,)
        spacing  between nodes, units

        The triangles are those of a closed surface; distances are negative inside.
        """
        corners = self.memory[self.triangles :].reshape(-1, 3, 3)
        count, dipoles = math.prod(shape), _dipoles(self, corners)
        begins = [self.triangles, len(self.memory), len(self.memory) + dipoles.size]
        header = np.array([*begins, *first, spacing, *shape], np.float64)
        memory = np.concatenate([header, self.with_more(dipoles), np.empty(count)])
        kernels.distances(memory.ctypes.data, memory[-count:].reshape(shape))
        return memory

    def with_more(self, numbers: Floats) -> Floats:
        """Return the array with numbers appended to its triangles."""
        return np.concatenate([self.memory, numbers.ravel()])


def _counts_of_boxes(most: int) -> AnyArray:
    """Return how many boxes (most + 1,) a tree of each number of triangles has."""
    counts = np.ones(most + 1, np.int64)
    sizes = {most}
    halves = list[int]()
    while sizes:
        halves += sizes
        sizes = {half for size in sizes if size > LEAF for half in (size // 2, size - size // 2)}
    for size in sorted(set(halves)):
        if size > LEAF:
            counts[size] = 1 + counts[size // 2] + counts[size - size // 2]
    return counts


def _joined(least: np.ufunc, rows: Floats, begin: AnyArray, count: AnyArray) -> Floats:
    """Return the minimum or maximum (B, 3) of `count` rows from `begin` on; ranges ascend, apart."""
    ends = np.column_stack([begin, begin + count]).ravel()
    return np.asarray(least.reduceat(rows, ends[:-1] if ends[-1] == len(rows) else ends, axis=0)[::2])


NODES = 64  # grid nodes along the longest side: they make lookups fast, not more exact

FAR = 2.5
"""Radii from the middle of a box from which on a dipole stands for its triangles. The error of the winding
number is then below 0.02, and 0.5 decides."""


class Lookup(NamedTuple):
    """memory: the flat array of `region_kernels`; low, high: the corners of the bounding box."""

    memory: Floats
    low: Floats
    high: Floats


@dataclass(frozen=True)
class ClosedSurface:
    """The triangles of a closed surface, float64 (T, 3, 3); equal bytes, equal surface."""

    data: bytes

    @classmethod
    def of(cls, mesh: TriangleMesh, name: str = "mesh") -> ClosedSurface:
        """Return the surface of a mesh.

        Raises MeshError, in one sentence that begins with `name`, where it is open or not manifold.
        """
        validate(mesh).require(closed=True, name=name)
        return cls(mesh.vertices[mesh.faces].tobytes())

    @cached_property
    def digest(self) -> str:
        return hashlib.sha256(self.data).hexdigest()

    @StableProperty
    def lookup(self) -> Lookup:
        return _lookup(self)


@lru_cache(maxsize=8)
def _lookup(surface: ClosedSurface) -> Lookup:
    """Return the kernels' array, which equal surfaces share."""
    corners = np.frombuffer(surface.data).reshape(-1, 3, 3)
    tree = TriangleTree.of(corners)
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    spacing = float((high - low).max()) / (NODES - 3)
    shape = np.ceil((high - low) / spacing).astype(int) + 3  # one more on every side, to begin outside
    return Lookup(tree.with_distances(low - spacing, spacing, tuple(shape.tolist())), low, high)


def _dipoles(tree: TriangleTree, corners: Floats) -> Floats:
    """Return the dipole (B, 8) of each box, from the triangles (T, 3, 3) in the order of the tree."""
    a, b, c = corners.transpose(1, 0, 2)
    areas = 0.5 * np.cross(b - a, c - a)
    sizes = np.linalg.norm(areas, axis=1, keepdims=True)
    vector, size, moment = (_box_sums(tree, rows) for rows in (areas, sizes, sizes * (a + b + c) / 3.0))
    boxes = tree.memory[: tree.triangles].reshape(-1, 8)
    low, high = boxes[:, :3], boxes[:, 3:6]
    centre = np.where(size > 0, moment / np.where(size > 0, size, 1.0), 0.5 * (low + high))
    radius = np.linalg.norm(np.maximum(np.abs(low - centre), np.abs(high - centre)), axis=1)
    return np.column_stack([centre, vector, (FAR * radius) ** 2, np.zeros(len(boxes))])


def _box_sums(tree: TriangleTree, rows: Floats) -> Floats:
    """Return the sums (B, k) of rows (T, k) over the triangles of each box."""
    sums = np.concatenate([np.zeros((1, rows.shape[1])), np.cumsum(rows, axis=0)])
    first, last = tree.ranges.T
    return sums[last] - sums[first]


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
        shape, ends = (*first, *(0.0,) * (6 - len(first))), (*last, *(0.0,) * (2 - len(last)))
        profile = float(FALLOFF_TYPES[self.falloff_type])
        return Instruction(self.opcode, (*shape, self.falloff_at(time), *factors, profile, *ends))

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
            fact = f"a {self.name} has the {what} {size:g} at {time:g} s and is empty"
            raise FrameError(f"{fact}; it must be above 0. Correct its keys.")
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


NEAR = 4.0  # half the side, in scene units, of the box that stands for a half-space


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
        half, (_, low, high) = 0.5 * self._size(self.scale, "scale", time), self.surface.lookup
        x, y, z = (vector_at(self.centre, time) + half * (low + high)).tolist()
        u, v, w = (half * (high - low) + self.falloff_at(time)).tolist()
        return (x, y, z), (u, v, w)
