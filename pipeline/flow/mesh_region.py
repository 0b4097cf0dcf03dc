"""Regions inside closed surfaces."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import ClassVar, NamedTuple

import numpy as np

from pipeline.arrays import Floats
from pipeline.flow.kernels import closed_surface as kernels
from pipeline.flow.kernels import opcodes as op
from pipeline.flow.keyframes import Number, VectorParameter, vector_at
from pipeline.flow.program import Instruction
from pipeline.flow.regions import Region
from pipeline.flow.triangle_tree import TriangleTree
from pipeline.flow.vectors import ORIGIN, Vector
from pipeline.mesh.triangle_mesh import TriangleMesh
from pipeline.mesh.validation import require

NODES = 64
"""Grid nodes along the longest side: they make lookups fast, not more exact."""

FAR = 2.5
"""Radii from the middle of a box from which on a dipole stands for its triangles. The error of the winding
number is then below 0.02, and 0.5 decides."""


class Lookup(NamedTuple):
    """memory: the flat array of `kernels.closed_surface`; low, high: the corners of the bounding box."""

    memory: Floats
    low: Vector
    high: Vector


@dataclass(frozen=True)
class ClosedSurface:
    """The triangles of a closed surface, float64 (T, 3, 3); equal bytes, equal surface."""

    data: bytes

    @classmethod
    def of(cls, mesh: TriangleMesh, name: str = "mesh") -> ClosedSurface:
        """Return the surface of a mesh.

        Raises MeshError, in one sentence that begins with `name`, where it is open or not manifold.
        """
        require(mesh, closed=True, name=name)
        return cls(mesh.vertices[mesh.faces].tobytes())

    @cached_property
    def digest(self) -> str:
        return hashlib.sha256(self.data).hexdigest()

    @property
    def lookup(self) -> Lookup:
        """The kernels' array, built on first use and shared by equal surfaces."""
        return _lookup(self)


@lru_cache(maxsize=8)
def _lookup(surface: ClosedSurface) -> Lookup:
    corners = np.frombuffer(surface.data).reshape(-1, 3, 3)
    tree = TriangleTree.of(corners)
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    spacing = float((high - low).max()) / (NODES - 3)
    shape = np.ceil((high - low) / spacing).astype(int) + 3  # one more on every side, to begin outside
    count, dipoles = int(shape.prod()), _dipoles(tree, corners[tree.order])
    begins = [tree.triangles, len(tree.memory), len(tree.memory) + dipoles.size]
    header = np.array([*begins, *(low - spacing), spacing, *shape], np.float64)
    memory = np.concatenate([header, tree.with_more(dipoles), np.empty(count)])
    kernels.distances(memory.ctypes.data, memory[-count:].reshape(tuple(shape.tolist())))
    return Lookup(memory, _vector(low), _vector(high))


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
    differences: Floats = sums[last] - sums[first]
    return differences


def _vector(row: Floats) -> Vector:
    x, y, z = row.tolist()
    return x, y, z


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
