"""PolygonMesh: a frozen surface of faces with any number of sides; and its triangulation (P23)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import AnyArray, Faces, Floats, Indices, Points, Vectors
from pipeline.errors import MeshError
from pipeline.mesh.kernels.triangulation import FORBIDDEN, triangulate_all, triangulate_polygon
from pipeline.mesh.triangle_mesh import TriangleMesh, frozen, require_existing
from render.base.plural import plural


@dataclass(frozen=True, init=False, eq=False)
class PolygonMesh:
    """Polygons over shared vertices, convex or not, flat or nearly so; arrays are read-only.

    vertices    float64 (V, 3), scene units
    offsets     int32 (F + 1,): face f has the corners ``corners[offsets[f]:offsets[f + 1]]``
    corners     int32 (C,): vertex numbers, counter-clockwise seen from outside
    attributes  by name, one row a vertex: (V,) or (V, k)
    creases     int32 (K, 2): edges that are hard whatever their angle (P31), sorted, each once

    Raises MeshError where a face has fewer than three corners or names a missing vertex, or where other
    arrays have other shapes. `pipeline.mesh.require` checks whether it is a surface.
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

    def __len__(self) -> int:
        """Return the number of faces."""
        return len(self.offsets) - 1

    def face(self, number: int) -> Indices:
        """Return the corners (n,) of one face."""
        return self.corners[self.offsets[number] : self.offsets[number + 1]]

    @property
    def sides(self) -> Indices:
        """(F,) the number of sides of each face."""
        return np.diff(self.offsets)

    @property
    def average_sides(self) -> float:
        """Mean number of sides a face: 3 once all are triangles (P21)."""
        return len(self.corners) / max(len(self), 1)

    @property
    def heads(self) -> Indices:
        """(C,) the corner that follows each in its face: side c runs from ``corners[c]`` to ``heads[c]``."""
        following = np.arange(1, len(self.corners) + 1)
        following[self.offsets[1:] - 1] = self.offsets[:-1]
        return self.corners[following]

    @property
    def owners(self) -> Indices:
        """(C,) the face of each corner."""
        return np.repeat(np.arange(len(self), dtype=np.int32), self.sides)

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
        """(F, 3) Newell normals, with the area of a flat face as length."""
        if not len(self):
            return np.empty((0, 3))
        first = self.vertices[self.corners[self.offsets[:-1]]][self.owners]
        tails, heads = self.vertices[self.corners] - first, self.vertices[self.heads] - first
        return 0.5 * np.add.reduceat(np.cross(tails, heads), self.offsets[:-1], axis=0)

    @property
    def areas(self) -> Floats:
        """(F,) area of each face, seen along its Newell normal."""
        return np.linalg.norm(self.area_vectors, axis=1)

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
        named = {name: _extended(values, rings) for name, values in self.attributes.items()}
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
        raise MeshError(
            f"face {f} has {plural(int(offsets[f + 1] - offsets[f]), 'corner')}; a polygon has at least three"
        )
    require_existing(corners, vertices)


def _extended(values: AnyArray, rings: Sequence[Indices]) -> AnyArray:
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
    triangulate_all(points.copy(), offsets.copy(), corners.copy(), triangles)
    doubled = _doubled(triangles, offsets, corners)
    if not len(doubled):
        return triangles, np.empty(0, np.int32)
    return _recut(points, offsets, corners, triangles, doubled)


def _doubled(triangles: Faces, offsets: Indices, corners: Indices) -> Indices:
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
    starts = offsets - 2 * np.arange(len(offsets), dtype=np.int32)  # of each face's triangles
    redo = set(doubled.tolist())
    taken: set[Edge] = set()
    for f in range(len(offsets) - 1):
        sides = corners[offsets[f] : offsets[f + 1]]
        taken.update(_edges(np.column_stack([sides, np.roll(sides, -1)])))
        if f not in redo:
            for turn in range(3):
                taken.update(_edges(np.roll(triangles[starts[f] : starts[f + 1]], turn, axis=1)[:, :2]))
    parts: list[Faces] = []
    filled: list[int] = []
    for f in range(len(offsets) - 1):
        part = triangles[starts[f] : starts[f + 1]]
        if f in redo:
            sides = corners[offsets[f] : offsets[f + 1]]
            part, cost = _cut(points[sides], sides, taken)
            if cost >= FORBIDDEN:
                centre = len(points) + len(filled)
                filled.append(f)
                part = np.column_stack([sides, np.roll(sides, -1), np.full(len(sides), centre)])
            for turn in range(3):
                taken.update(_edges(np.roll(part, turn, axis=1)[:, :2]))
        parts.append(part)
    return np.concatenate(parts).astype(np.int32), np.array(filled, np.int32)


def _cut(polygon: Floats, sides: Indices, taken: set[Edge]) -> tuple[Faces, float]:
    n = len(sides)
    closed = np.zeros((n, n), np.uint8)
    for i in range(n):
        for j in range(i + 2, n if i else n - 1):
            closed[i, j] = _edge(int(sides[i]), int(sides[j])) in taken
    local = np.empty((n - 2, 3), np.int32)
    cost = triangulate_polygon(np.ascontiguousarray(polygon), closed, local)
    return sides[local], cost


def _edge(a: int, b: int) -> Edge:
    return (a, b) if a < b else (b, a)


def _edges(pairs: Indices) -> list[Edge]:
    return [_edge(a, b) for a, b in pairs.tolist()]
