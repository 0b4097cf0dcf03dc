"""Triangles, segments and points in a tree of boxes, and closed surfaces, as the kernels search them."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from pipeline.arrays import AnyArray, Floats
from pipeline.flow.kernels import region_kernels as kernels
from pipeline.flow.parameters import Vector
from pipeline.mesh.triangle_mesh import TriangleMesh
from pipeline.mesh.validation import require

LEAF = 6
"""The most triangles in a leaf."""


@dataclass(frozen=True, eq=False)
class TriangleTree:
    """The flat array of `kernels.lookups`: boxes, then triangles.

    memory     float64, all of it; further numbers may follow
    triangles  start of the triangles in it
    order      (T,) the index of each among the given triangles
    ranges     (B, 2) the first of the triangles in each box, and the one after its last
    """

    memory: Floats
    triangles: int
    order: AnyArray = field(repr=False)
    ranges: AnyArray = field(repr=False)

    @classmethod
    def of(cls, corners: Floats) -> TriangleTree:
        """Build the tree of corners (T, 3, 3), T at least 1, by halving boxes across their longest side."""
        centres, order = corners.mean(axis=1), np.arange(len(corners))
        boxes: list[list[float]] = []
        ranges: list[tuple[int, int]] = []
        stack: list[tuple[int, int, int]] = [(0, len(corners), -1)]
        while stack:
            first, last, parent = stack.pop()
            members = order[first:last]
            if parent >= 0:
                boxes[parent][6] = float(len(boxes))  # the second child; the first follows its parent
            around = corners[members].reshape(-1, 3)
            box = [
                *around.min(axis=0).tolist(),
                *around.max(axis=0).tolist(),
                float(first),
                float(last - first),
            ]
            boxes.append(box)
            ranges.append((first, last))
            if last - first <= LEAF:
                continue
            box[7], index, middle = 0.0, len(boxes) - 1, (first + last) // 2
            axis = int(np.argmax(np.ptp(centres[members], axis=0)))
            order[first:last] = members[np.argsort(centres[members, axis], kind="stable")]
            stack += [(middle, last, index), (first, middle, -1)]
        memory = np.concatenate([np.array(boxes).ravel(), corners[order].ravel()])
        return cls(memory, 8 * len(boxes), order, np.array(ranges))

    def with_more(self, numbers: Floats) -> Floats:
        """Return the array with numbers appended to its triangles."""
        return np.concatenate([self.memory, numbers.ravel()])


def segments(points: Floats) -> Floats:
    """Return the segments between points (P, 3) as triangles (P − 1, 3, 3); one point as a triangle."""
    if len(points) == 1:
        return np.repeat(points[None], 3, axis=1)
    return np.stack([points[:-1], points[1:], points[1:]], axis=1)


NODES = 64
"""Grid nodes along the longest side: they make lookups fast, not more exact."""

FAR = 2.5
"""Radii from the middle of a box from which on a dipole stands for its triangles. The error of the winding
number is then below 0.02, and 0.5 decides."""


class Lookup(NamedTuple):
    """memory: the flat array of `kernels.regions`; low, high: the corners of the bounding box."""

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
    return sums[last] - sums[first]


def _vector(row: Floats) -> Vector:
    x, y, z = row.tolist()
    return x, y, z
