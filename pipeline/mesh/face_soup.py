"""Face soups: polygons over shared vertices before they are known to form a surface."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipeline.arrays import AnyArray, Points
from pipeline.mesh.polygon_mesh import PolygonMesh


@dataclass(frozen=True)
class FaceSoup:
    """Polygons over shared vertices; any number of them may meet at an edge or vertex.

    Side c of a face runs from ``corners[c]`` to the next corner of the face.

    points    float64 (V, 3)
    offsets   int64 (F + 1,): face f has the corners ``corners[offsets[f]:offsets[f + 1]]``
    corners   int64 (C,), from 0
    faces     int64 (F,): number of each face in its file, from 0
    vertices  int64 (V,): number of each vertex in its file, from 0
    """

    points: Points
    offsets: AnyArray
    corners: AnyArray
    faces: AnyArray
    vertices: AnyArray

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
        return np.repeat(np.arange(len(self)), self.sides)

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

    @cached_property
    def centred_points(self) -> Points:
        """(V, 3) positions from the middle of the bounding box, so that products keep their digits."""
        return self.points - 0.5 * (self.points.min(axis=0) + self.points.max(axis=0))

    @cached_property
    def area_vectors(self) -> Points:
        """(F, 3) Newell normals, with the area of a flat face as length."""
        if (self.sides == 3).all():
            a, b, c = (self.points[corners] for corners in self.corners.reshape(-1, 3).T)
            triangles: Points = 0.5 * np.cross(b - a, c - a)
            return triangles
        first = self.points[self.corners[self.offsets[:-1]]][self.owners]
        tails, heads = self.points[self.corners] - first, self.points[self.heads] - first
        vectors: Points = 0.5 * np.add.reduceat(np.cross(tails, heads), self.offsets[:-1], axis=0)
        return vectors

    @cached_property
    def areas(self) -> AnyArray:
        """(F,) area of each face, seen along its Newell normal."""
        return np.linalg.norm(self.area_vectors, axis=1)

    @cached_property
    def volumes(self) -> AnyArray:
        """(F,) signed volume between each face and the middle of the bounding box."""
        first = self.centred_points[self.corners[self.offsets[:-1]]]
        return np.einsum("ij,ij->i", first, self.area_vectors) / 3.0

    def keep_faces(self, kept: AnyArray) -> FaceSoup:
        """Return the soup of the faces where `kept` (F,) is True; all vertices stay."""
        corners = self.corners[kept[self.owners]]
        offsets = np.concatenate([[0], np.cumsum(self.sides[kept])])
        return replace(self, offsets=offsets, corners=corners, faces=self.faces[kept])

    def to_mesh(self, vertex: AnyArray | None = None) -> tuple[PolygonMesh, AnyArray]:
        """Return the mesh, and for each of its vertices that of the soup; unused vertices are left out.
        Vertices keep their order.

        vertex  (C,) labels: corners with one label share a vertex; by default those at one vertex of the soup
        """
        labels = self.corners if vertex is None else vertex
        _, first, corners = np.unique(labels, return_index=True, return_inverse=True)
        order = np.argsort(self.corners[first], kind="stable")
        place = np.empty_like(order)
        place[order] = np.arange(len(order))
        origin = self.corners[first][order]
        mesh = PolygonMesh.from_arrays(self.points[origin], self.offsets, place[corners.reshape(-1)])
        return mesh, origin


def components(count: int, ends: AnyArray, others: AnyArray) -> AnyArray:
    """Return for each of `count` nodes the lowest node that links (L,) between `ends` and `others` reach."""
    root = np.arange(count)
    while True:
        a, b = root[ends], root[others]
        apart = a != b
        if not apart.any():
            return root
        ends, others = ends[apart], others[apart]
        np.minimum.at(root, np.maximum(a, b)[apart], np.minimum(a, b)[apart])
        while not np.array_equal(root[root], root):
            root = root[root]
