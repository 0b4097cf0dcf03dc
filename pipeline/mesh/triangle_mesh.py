"""TriangleMesh: a surface as a frozen value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import AnyArray, Faces, Floats, Indices, Points
from pipeline.errors import MeshError
from render.base.plural import plural


@dataclass(frozen=True, init=False, eq=False)
class TriangleMesh:
    """Triangles over shared vertices; arrays are read-only.

    vertices    float64 (V, 3), scene units
    faces       int32 (F, 3), counter-clockwise seen from outside
    attributes  by name, one row a vertex: (V,) or (V, k)
    creases     int32 (K, 2): edges, by their two vertices, that are hard whatever their angle (P31)

    Creases are sorted and unique, so that equal sets are equal arrays.

    Raises MeshError where the arrays have other shapes or a face names a missing vertex.
    `pipeline.mesh.validation` checks whether a mesh is finite, manifold and closed.
    """

    vertices: Points
    faces: Faces
    attributes: Mapping[str, AnyArray] = field(default_factory=dict)
    creases: Indices = field(default_factory=lambda: np.empty((0, 2), np.int32))

    def __init__(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        attributes: Mapping[str, ArrayLike] | None = None,
        creases: ArrayLike | None = None,
    ) -> None:
        points = frozen(vertices, np.float64)
        corners = np.asarray(faces)
        if points.ndim != 2 or points.shape[1] != 3:
            raise MeshError(f"vertices have shape {points.shape}; they must be (V, 3)")
        if corners.size == 0:
            corners = corners.reshape(0, 3)
        if corners.ndim != 2 or corners.shape[1] != 3:
            raise MeshError(f"faces have shape {corners.shape}; they must be (F, 3): triangulate first")
        require_existing(corners, len(points))
        named = {name: frozen(values) for name, values in (attributes or {}).items()}
        for name, values in named.items():
            if values.ndim == 0 or len(values) != len(points):
                raise MeshError(
                    f"attribute {name!r} has shape {values.shape}; it needs {plural(len(points), 'row')}"
                )
        object.__setattr__(self, "creases", frozen(_sorted_pairs(creases, len(points)), np.int32))
        object.__setattr__(self, "vertices", points)
        object.__setattr__(self, "faces", frozen(corners, np.int32))
        object.__setattr__(self, "attributes", MappingProxyType(named))

    def with_vertices(self, vertices: ArrayLike) -> TriangleMesh:
        """Return the same surface with other positions."""
        return TriangleMesh(vertices, self.faces, self.attributes, self.creases)

    def with_attributes(self, **attributes: ArrayLike) -> TriangleMesh:
        """Return the same surface with attributes added or replaced."""
        return TriangleMesh(self.vertices, self.faces, {**self.attributes, **attributes}, self.creases)

    def with_creases(self, creases: ArrayLike) -> TriangleMesh:
        """Return the same surface with these creases only."""
        return TriangleMesh(self.vertices, self.faces, self.attributes, creases)

    @property
    def halfedge_ends(self) -> Indices:
        """(3F, 2) the two vertices of each half-edge ``3f + i``."""
        return np.stack([self.faces, np.roll(self.faces, -1, axis=1)], axis=2).reshape(-1, 2)

    def ends_of(self, halfedges: AnyArray) -> Indices:
        """Return the two vertices (N, 2) of half-edges (N,), which `halfedge_ends` has for all."""
        corners, corner = self.faces.reshape(-1), halfedges % 3
        ends: Indices = np.column_stack([corners[halfedges], corners[halfedges - corner + (corner + 1) % 3]])
        return ends

    @property
    def bounds(self) -> Floats:
        """(2, 3): the lowest and the highest coordinates of the vertices."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    def __repr__(self) -> str:
        names = ", ".join(self.attributes) or "no attributes"
        return f"TriangleMesh({len(self.vertices)} vertices, {len(self.faces)} faces, {names})"


def require_existing(corners: AnyArray, vertices: int) -> None:
    """Raise MeshError where the corners of faces name a vertex that is not among `vertices`."""
    if corners.size and (corners.min() < 0 or corners.max() >= vertices):
        raise MeshError(
            f"faces name vertex {int(corners.max())} and {int(corners.min())}; "
            f"the mesh has {plural(vertices, 'vertex', 'vertices')}, numbered from 0"
        )


def edge_keys(pairs: Indices) -> AnyArray:
    """Return int64 (N,), one number for each pair of vertices (N, 2) in either order."""
    low, high = np.sort(pairs.astype(np.int64), axis=1).T
    return (low << 32) + high


def _sorted_pairs(pairs: ArrayLike | None, vertices: int) -> Indices:
    """Return pairs (K, 2) int32, each ascending and once, in order; does not check that they are edges."""
    ends = np.asarray([] if pairs is None else pairs)
    if ends.size == 0:
        return np.empty((0, 2), np.int32)
    if ends.ndim != 2 or ends.shape[1] != 2:
        raise MeshError(f"creases have shape {ends.shape}; they must be pairs of vertices, (K, 2)")
    if ends.min() < 0 or ends.max() >= vertices:
        raise MeshError(
            f"creases name vertex {int(ends.max())}; the mesh has {plural(vertices, 'vertex', 'vertices')}"
        )
    return np.unique(np.sort(ends, axis=1), axis=0).astype(np.int32)


def frozen(values: ArrayLike, kind: type | None = None) -> AnyArray:
    """Return a read-only array in C order: a copy, or the array itself if nobody can write to its data.

    Whoever made such an array must not write into it again.
    """
    if type(values) is np.ndarray and values.dtype == (kind or values.dtype):
        owner = _owner(values)
        is_read_only = owner.flags.owndata and not owner.flags.writeable and not values.flags.writeable
        if is_read_only and values.flags.c_contiguous and owner.nbytes == values.nbytes:
            return values
    array = np.array(values, dtype=kind, order="C")
    array.flags.writeable = False
    return array


def freeze(values: AnyArray) -> None:
    """Make an array, and the one whose data it shows, read-only, so that a mesh takes it without a copy."""
    values.flags.writeable = _owner(values).flags.writeable = False


def _owner(values: AnyArray) -> AnyArray:
    """Return the array that an array shows in another shape, or the array itself."""
    return values.base if isinstance(values.base, np.ndarray) else values
