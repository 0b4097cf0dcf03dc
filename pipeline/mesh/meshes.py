"""Surfaces as frozen values: TriangleMesh and PolygonMesh, whose faces have any number of sides (P23)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flowsculpt.pipeline.arrays import AnyArray, Faces, Floats, Indices, Points, Vectors
from flowsculpt.pipeline.errors import MeshError
from flowsculpt.render.base.plural import plural


@dataclass(frozen=True, init=False, eq=False)
class TriangleMesh:
    """Triangles over shared vertices; arrays are read-only.

    vertices    float64 (V, 3), scene units
    faces       int32 (F, 3), counter-clockwise seen from outside
    attributes  by name, one row a vertex: (V,) or (V, k)
    creases     int32 (K, 2): edges, by their two vertices, that are hard whatever their angle (P31)
    seams       int32 (S, 2): edges where texture coordinates or materials of a model end. They are kept as
                creases are, and shaded as other edges are

    Creases and seams are sorted and unique, so that equal sets are equal arrays.

    Raises MeshError where the arrays have other shapes or a face names a missing vertex.
    `flowsculpt.pipeline.mesh.validation` checks whether a mesh is finite, manifold and closed.
    """

    vertices: Points
    faces: Faces
    attributes: Mapping[str, AnyArray] = field(default_factory=dict)
    creases: Indices = field(default_factory=lambda: np.empty((0, 2), np.int32))
    seams: Indices = field(default_factory=lambda: np.empty((0, 2), np.int32))

    def __init__(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        attributes: Mapping[str, ArrayLike] | None = None,
        creases: ArrayLike | None = None,
        seams: ArrayLike | None = None,
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
        for name, pairs in (("creases", creases), ("seams", seams)):
            object.__setattr__(self, name, frozen(_sorted_pairs(pairs, len(points)), np.int32))
        object.__setattr__(self, "vertices", points)
        object.__setattr__(self, "faces", frozen(corners, np.int32))
        object.__setattr__(self, "attributes", MappingProxyType(named))

    def with_vertices(self, vertices: ArrayLike) -> TriangleMesh:
        """Return the same surface with other positions."""
        return self._with(vertices=vertices)

    def with_attributes(self, **attributes: ArrayLike) -> TriangleMesh:
        """Return the same surface with attributes added or replaced."""
        return self._with(attributes={**self.attributes, **attributes})

    def with_creases(self, creases: ArrayLike) -> TriangleMesh:
        """Return the same surface with these creases only."""
        return self._with(creases=creases)

    def with_seams(self, seams: ArrayLike) -> TriangleMesh:
        """Return the same surface with these seams only."""
        return self._with(seams=seams)

    def _with(self, **changes: Any) -> TriangleMesh:
        return replace(self, **changes)

    @property
    def tagged_edges(self) -> dict[str, Indices]:
        """The arrays of tagged edges as files hold them: `creases`, and `seams` where there are any."""
        return {"creases": self.creases, **({"seams": self.seams} if len(self.seams) else {})}

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

    @property
    def face_normals(self) -> Vectors:
        """(F, 3) unit normals, pointing outwards; zero for a face without area."""
        from flowsculpt.pipeline.mesh.kernels.normal_kernels import normals_of_faces

        normals = np.empty((len(self.faces), 3))
        normals_of_faces(self.vertices, self.faces, normals)
        return normals

    @property
    def areas(self) -> Floats:
        """(F,) area of each face."""
        a, b, c = (self.vertices[corners] for corners in self.faces.T)
        return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))

    def scattered(self, count: int, seed: int) -> tuple[Points, AnyArray]:
        """Return points (count, 3) on the faces, evenly by area, and the face (count,) of each.

        The surface should have at least about as many faces as points. The areas of the faces, in order,
        form a line with points at equal distances. Within its face a point lies anywhere, but only half as
        far from the middle as it could: points of neighbouring faces then keep apart, without clusters or
        holes.
        """
        random = np.random.default_rng(seed)
        corners = self.vertices[self.faces]
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        ends = np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1))
        along = (np.arange(count) + random.random()) / count * ends[-1]
        face = np.minimum(np.searchsorted(ends, along, side="right"), len(ends) - 1)
        u, v = random.random((2, count, 1))
        u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
        u, v = 0.5 * u + 1.0 / 6.0, 0.5 * v + 1.0 / 6.0
        return a[face] + u * (b - a)[face] + v * (c - a)[face], face

    def __reduce__(self) -> tuple[Any, ...]:
        arrays = self.vertices, self.faces, dict(self.attributes), self.creases, self.seams
        return TriangleMesh, arrays  # pickle knows no mapping that is only read

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


class FaceLists(ABC):
    """Faces of any number of sides: side c of a face runs from ``corners[c]`` to ``heads[c]``.

    offsets  (F + 1,): face f has the corners ``corners[offsets[f]:offsets[f + 1]]``
    corners  (C,)
    """

    offsets: AnyArray
    corners: AnyArray

    def __len__(self) -> int:
        """Return the number of faces."""
        return len(self.offsets) - 1

    @cached_property
    def sides(self) -> AnyArray:
        """(F,) the number of sides of each face."""
        return np.diff(self.offsets)

    @cached_property
    def owners(self) -> AnyArray:
        """(C,) the face of each side."""
        return np.repeat(np.arange(len(self), dtype=self.offsets.dtype), self.sides)

    @cached_property
    def next_side(self) -> AnyArray:
        """(C,) the side that follows each in its face."""
        following = np.arange(1, len(self.corners) + 1)
        following[self.offsets[1:] - 1] = self.offsets[:-1]
        return following

    @cached_property
    def previous_side(self) -> AnyArray:
        """(C,) the side before each in its face."""
        before = np.arange(-1, len(self.corners) - 1)
        before[self.offsets[:-1]] = self.offsets[1:] - 1
        return before

    @cached_property
    def heads(self) -> AnyArray:
        """(C,) the vertex where each side ends."""
        return self.corners[self.next_side]

    @property
    @abstractmethod
    def area_vectors(self) -> Vectors:
        """(F, 3) Newell normals, with the area of a flat face as length."""

    @cached_property
    def areas(self) -> Floats:
        """(F,) area of each face, seen along its Newell normal."""
        return np.linalg.norm(self.area_vectors, axis=1)

    def _newell_normals(self, points: Points) -> Vectors:
        """Return `area_vectors` for corners at points (V, 3), where there are faces."""
        first = points[self.corners[self.offsets[:-1]]][self.owners]
        tails, heads = points[self.corners] - first, points[self.heads] - first
        vectors: Vectors = 0.5 * np.add.reduceat(np.cross(tails, heads), self.offsets[:-1], axis=0)
        return vectors


@dataclass(frozen=True, init=False, eq=False)
class PolygonMesh(FaceLists):
    """Polygons over shared vertices, convex or not, flat or nearly so; arrays are read-only.

    vertices    float64 (V, 3), scene units
    offsets     int32 (F + 1,): face f has the corners ``corners[offsets[f]:offsets[f + 1]]``
    corners     int32 (C,): vertex numbers, counter-clockwise seen from outside
    attributes  by name, one row a vertex: (V,) or (V, k)
    creases     int32 (K, 2): edges that are hard whatever their angle (P31), sorted, each once

    Raises MeshError where a face has fewer than three corners or names a missing vertex, or where other
    arrays have other shapes. `flowsculpt.pipeline.mesh.require` checks whether it is a surface.
    """

    vertices: Points
    offsets: Indices
    corners: Indices
    attributes: Mapping[str, AnyArray] = field(default_factory=dict)
    creases: Indices = field(default_factory=lambda: np.empty((0, 2), np.int32))

    def __init__(
        self,
        vertices: ArrayLike,
        faces: Sequence[ArrayLike],
        attributes: Mapping[str, ArrayLike] | None = None,
        creases: ArrayLike | None = None,
    ) -> None:
        """`faces`: one sequence of vertex numbers a face."""
        parts = [np.asarray(face, np.int64).reshape(-1) for face in faces]
        offsets = np.cumsum([0, *(len(part) for part in parts)])
        self._fill(vertices, offsets, np.concatenate([*parts, np.empty(0, np.int64)]), attributes, creases)

    @classmethod
    def from_arrays(
        cls,
        vertices: ArrayLike,
        offsets: ArrayLike,
        corners: ArrayLike,
        attributes: Mapping[str, ArrayLike] | None = None,
        creases: ArrayLike | None = None,
    ) -> PolygonMesh:
        """Return a mesh of arrays like the fields."""
        mesh = cls.__new__(cls)
        mesh._fill(vertices, np.asarray(offsets), np.asarray(corners), attributes, creases)
        return mesh

    @classmethod
    def from_triangles(cls, mesh: TriangleMesh) -> PolygonMesh:
        """Return the same surface with faces of three sides."""
        offsets = 3 * np.arange(len(mesh.faces) + 1)
        return cls.from_arrays(mesh.vertices, offsets, mesh.faces.reshape(-1), mesh.attributes, mesh.creases)

    def _fill(
        self,
        vertices: ArrayLike,
        offsets: AnyArray,
        corners: AnyArray,
        attributes: Mapping[str, ArrayLike] | None,
        creases: ArrayLike | None,
    ) -> None:
        # vertices, attributes and creases follow the rules of triangle meshes
        shared = TriangleMesh(vertices, np.empty((0, 3), np.int32), attributes, creases)
        _check_faces(offsets, corners, len(shared.vertices))
        object.__setattr__(self, "vertices", shared.vertices)
        object.__setattr__(self, "offsets", frozen(offsets, np.int32))
        object.__setattr__(self, "corners", frozen(corners, np.int32))
        object.__setattr__(self, "attributes", MappingProxyType(dict(shared.attributes)))
        object.__setattr__(self, "creases", shared.creases)

    def __reduce__(self) -> tuple[Any, ...]:
        arrays = self.vertices, self.offsets, self.corners, dict(self.attributes), self.creases
        return PolygonMesh.from_arrays, arrays

    def face(self, number: int) -> Indices:
        """Return the corners (n,) of one face."""
        return self.corners[self.offsets[number] : self.offsets[number + 1]]

    @property
    def average_sides(self) -> float:
        """Mean number of sides a face: 3 once all are triangles (P21)."""
        return len(self.corners) / max(len(self), 1)

    @property
    def bounds(self) -> Floats:
        """(2, 3): the lowest and the highest coordinates of the vertices."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    @property
    def extents(self) -> Floats:
        """(F,) the longest side of each face's bounding box, scene units (P17)."""
        if not len(self):
            return np.empty(0)
        at, starts = self.vertices[self.corners], self.offsets[:-1]
        size: Floats = np.maximum.reduceat(at, starts) - np.minimum.reduceat(at, starts)
        return size.max(axis=1)

    @property
    def area_vectors(self) -> Vectors:
        return self._newell_normals(self.vertices) if len(self) else np.empty((0, 3))

    @property
    def normals(self) -> Vectors:
        """(F, 3) unit Newell normals, pointing outwards; zero for a face without area."""
        vectors = self.area_vectors
        length = np.linalg.norm(vectors, axis=1, keepdims=True)
        return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)

    @property
    def edges(self) -> Indices:
        """(E, 2) every edge once, by its two vertices, lower first, sorted."""
        low = np.minimum(self.corners, self.heads).astype(np.int64)
        keys = np.unique(low * len(self.vertices) + np.maximum(self.corners, self.heads))
        return np.column_stack(np.divmod(keys, max(len(self.vertices), 1))).astype(np.int32)

    @property
    def twins(self) -> AnyArray:
        """For each corner, (C,) int64, the side that runs back along the side beginning there; else -1.

        Where more than two sides run between two vertices, one of them is taken.
        """
        tails, heads, count = self.corners.astype(np.int64), self.heads.astype(np.int64), len(self.vertices)
        sides, reverse = tails * count + heads, heads * count + tails
        order = np.argsort(sides, kind="stable")
        place = np.searchsorted(sides[order], reverse)
        exists = np.append(sides[order], -1)[place] == reverse
        return np.where(exists, np.append(order, -1)[place], -1)

    def with_vertices(self, vertices: ArrayLike) -> PolygonMesh:
        """Return the same surface with other positions."""
        return PolygonMesh.from_arrays(vertices, self.offsets, self.corners, self.attributes, self.creases)

    def with_attributes(self, **attributes: ArrayLike) -> PolygonMesh:
        """Return the same surface with attributes added or replaced."""
        more = {**self.attributes, **attributes}
        return PolygonMesh.from_arrays(self.vertices, self.offsets, self.corners, more, self.creases)

    def with_creases(self, creases: ArrayLike) -> PolygonMesh:
        """Return the same surface with these creases only."""
        return PolygonMesh.from_arrays(self.vertices, self.offsets, self.corners, self.attributes, creases)

    def triangulated(self) -> TriangleMesh:
        """Return the surface as triangles; vertices, attributes and creases stay as they are (P23).

        A face that cannot be cut without doubling another's edge takes a vertex at the mean of its corners;
        such vertices come last.
        """
        faces, filled = triangulate(self.vertices, self.offsets, self.corners)
        if not len(filled):
            return TriangleMesh(self.vertices, faces, self.attributes, self.creases)
        rings = [self.face(int(f)) for f in filled]
        points = np.concatenate([self.vertices, [self.vertices[ring].mean(axis=0) for ring in rings]])
        named = {name: _extend(values, rings) for name, values in self.attributes.items()}
        return TriangleMesh(points, faces, named, self.creases)

    def __repr__(self) -> str:
        return (
            f"PolygonMesh({len(self.vertices)} vertices, {len(self)} faces, {self.average_sides:.2f} sides)"
        )


def _check_faces(offsets: AnyArray, corners: AnyArray, vertices: int) -> None:
    if offsets.ndim != 1 or corners.ndim != 1 or not len(offsets) or offsets[0] != 0:
        raise MeshError(f"offsets have shape {offsets.shape}; they must be (F + 1,) and begin with 0")
    if offsets[-1] != len(corners):
        raise MeshError(f"offsets end at {int(offsets[-1])}; there are {len(corners)} corners")
    small = np.flatnonzero(np.diff(offsets) < 3)
    if len(small):
        f = int(small[0])
        corners_of_f = plural(int(offsets[f + 1] - offsets[f]), "corner")
        raise MeshError(f"face {f} has {corners_of_f}; a polygon has at least three")
    require_existing(corners, vertices)


def _extend(values: AnyArray, rings: Sequence[Indices]) -> AnyArray:
    """Return an attribute with a row for the middle of each ring: the mean, or one corner's if integer."""
    blends = values.dtype.kind == "f"
    rows = [values[ring].mean(axis=0) if blends else values[ring[0]] for ring in rings]
    return np.concatenate([values, np.array(rows, values.dtype)])


Edge = tuple[int, int]


def triangulate(points: Points, offsets: Indices, corners: Indices) -> tuple[Faces, Indices]:
    """Cut polygons into the triangles with the smallest sum of cotangents, seen along each Newell normal.

    points   (V, 3)
    offsets  int32 (F + 1,): face f has the corners ``corners[offsets[f]:offsets[f + 1]]``
    corners  int32 (C,)

    Returns triangles (T, 3), face after face, and the faces (M,) that took a vertex in their middle, numbered
    from V on in this order. Those are faces where every other cut would double an edge of another face. The
    least sum prefers round triangles, turns no triangle over where the polygon is simple and nearly flat, and
    makes none without area from corners on a line, which polygons with split sides have many of. (Ear
    clipping does so in nearly every second convex polygon with points on its sides.)
    """
    triangles = np.empty((int((np.diff(offsets) - 2).sum()), 3), np.int32)
    if np.diff(offsets).max(initial=3) == 3:
        return corners.reshape(-1, 3).astype(np.int32), np.empty(0, np.int32)
    from flowsculpt.pipeline.mesh.kernels.triangulation import triangulate_all  # numba takes time to import

    triangulate_all(points.copy(), offsets.copy(), corners.copy(), triangles)
    doubled = _find_doubles(triangles, offsets, corners)
    if not len(doubled):
        return triangles, np.empty(0, np.int32)
    return _recut(points, offsets, corners, triangles, doubled)


def _find_doubles(triangles: Faces, offsets: Indices, corners: Indices) -> Indices:
    """Return the faces with a side or diagonal that joins the same vertices as one of another face."""
    tails = triangles.reshape(-1).astype(np.int64)
    heads = np.roll(triangles, -1, axis=1).reshape(-1)
    keys = tails * (int(corners.max()) + 1) + heads
    _, first = np.unique(keys, return_index=True)
    again = np.ones(len(keys), bool)
    again[first] = False
    face = np.repeat(np.arange(len(offsets) - 1), 3 * (np.diff(offsets) - 2))
    # a diagonal runs both ways within its face, so it meets a doubled side whichever way that runs
    return np.unique(face[np.isin(keys, keys[again])]).astype(np.int32)


def _recut(
    points: Points, offsets: Indices, corners: Indices, triangles: Faces, doubled: Indices
) -> tuple[Faces, Indices]:
    """Cut the doubled faces again, one after the other, with regard to all edges there are."""
    from flowsculpt.pipeline.mesh.kernels.triangulation import FORBIDDEN

    starts = offsets - 2 * np.arange(len(offsets), dtype=np.int32)  # of each face's triangles
    parts = np.split(triangles, starts[1:-1])
    polygons = np.split(corners, offsets[1:-1])
    redo = set(doubled.tolist())
    taken: set[Edge] = set()
    for f, (part, sides) in enumerate(zip(parts, polygons, strict=True)):
        taken.update(_sides(sides[None]))
        if f not in redo:
            taken.update(_sides(part))
    filled: list[int] = []
    for f in doubled.tolist():
        sides = polygons[f]
        parts[f], cost = _cut(points[sides], sides, taken)
        if cost >= FORBIDDEN:
            centre = len(points) + len(filled)
            filled.append(f)
            parts[f] = np.column_stack([sides, np.roll(sides, -1), np.full(len(sides), centre)])
        taken.update(_sides(parts[f]))
    return np.concatenate(parts).astype(np.int32), np.array(filled, np.int32)


def _cut(polygon: Floats, sides: Indices, taken: set[Edge]) -> tuple[Faces, float]:
    from flowsculpt.pipeline.mesh.kernels.triangulation import triangulate_polygon

    n = len(sides)
    closed = np.zeros((n, n), np.uint8)
    for i in range(n):
        for j in range(i + 2, n if i else n - 1):
            closed[i, j] = tuple(sorted((int(sides[i]), int(sides[j])))) in taken
    local = np.empty((n - 2, 3), np.int32)
    cost = triangulate_polygon(np.ascontiguousarray(polygon), closed, local)
    return sides[local], cost


def _sides(polygons: Indices) -> set[Edge]:
    """Return the sides of polygons (N, n), each the lower of its two vertices first."""
    rows = ((row, [*row[1:], row[0]]) for row in polygons.tolist())
    return {(a, b) if a < b else (b, a) for row, after in rows for a, b in zip(row, after, strict=True)}


_BITS = 10  # of each coordinate
_SPREAD = ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249))
"""Shifts and masks that put two zero bits between the bits of a number."""


def morton_order(points: Points) -> AnyArray:
    """Return the indices (N,) of points (N, 3) along a Morton curve through their bounding cube.

    Points that are not finite, or all the same, keep their order. Source: Morton, *A computer oriented
    geodetic data base*, IBM (1966).
    """
    columns = np.ascontiguousarray(points.T)
    low, high = columns.min(axis=1), columns.max(axis=1)
    with np.errstate(all="ignore"):
        scale = ((1 << _BITS) - 1) / (high - low).max()
    if not 0.0 < scale < np.inf:
        return np.arange(len(points))
    x, y, z = (_spread(row) for row in ((columns - low[:, None]) * scale).astype(np.uint32))
    return stable_order(x | (y << 1) | (z << 2))


def stable_order(keys: AnyArray) -> AnyArray:
    """Return the indices (N,) that sort keys from 0 to 2**32 - 1; equal ones keep their order.

    Keys and indices are sorted together as one number, five times as fast as numpy's stable sorts.
    """
    packed = keys.astype(np.uint64) << np.uint64(32) | np.arange(len(keys), dtype=np.uint64)
    packed.sort()
    return (packed & np.uint64(0xFFFFFFFF)).astype(np.int64)


def _spread(numbers: AnyArray) -> AnyArray:
    for shift, mask in _SPREAD:
        numbers = (numbers | (numbers << shift)) & mask
    return numbers
