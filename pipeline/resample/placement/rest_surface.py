"""The undeformed surface as a mesh keeps it at its vertices: rest positions, normals and rings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices, Points, Vectors
from pipeline.errors import FrameError
from pipeline.mesh.halfedge_mesh import HalfedgeMesh
from pipeline.mesh.normals import unit
from pipeline.resample.kernels.curved_patches import copy_rest_positions
from pipeline.resample.kernels.rest_surface import MAX_OPPOSITE, opposite_corners
from pipeline.resample.kernels.ring import new_ring
from pipeline.resample.placement.base import on_patches

REST, REST_NORMAL, NORMAL, ASTRAY = "rest", "rest_normal", "normal", "astray"
"""Vertex attributes of exact placement: position and normal on the undeformed surface, present normal, and a
flag for vertices that had to be left off the surface.
"""

_ONLY_TAGGED = -1.0  # the cosine that makes no edge hard by its angle


def column_of(mesh: HalfedgeMesh, name: str) -> int:
    """Return the first column of an attribute. Raises FrameError where the mesh does not have it."""
    column = mesh.column(name)
    if column is None:
        raise FrameError(f"the surface has no vertex attribute {name!r}; exact placement needs it")
    return column


def rest_of(mesh: HalfedgeMesh) -> Points:
    """Return a view (V, 3) of the vertices' rest positions."""
    column = column_of(mesh, REST)
    return mesh.arrays.attributes[: mesh.sizes[0], column : column + 3]


def on_patches_at_rest(mesh: HalfedgeMesh, births: Indices) -> tuple[Points, Vectors]:
    """Return midpoints (N, 3) of edges at rest on curved patches, and unit normals there, zero on creases."""
    room = 3 * len(mesh.arrays.points)
    rest = mesh.scratch("rest", room, np.float64)[:room].reshape(-1, 3)
    copy_rest_positions(mesh.arrays, births, column_of(mesh, REST), new_ring(), rest)
    return on_patches(mesh.arrays._replace(points=rest), births, _ONLY_TAGGED)


@dataclass(frozen=True)
class RestRings:
    """The rings of vertices at rest.

    spokes   (N,) a half-edge that leaves each vertex
    centre   (N, 3) the vertices
    corners  (N, K, 2, 3) the other corners of the surrounding faces, nan where there are fewer than K; on a
             crease its two edges, each as twice the same corner
    normals  (N, 3) unit, zero on creases
    """

    spokes: Indices
    centre: Points
    corners: Points
    normals: Vectors

    @classmethod
    def of(cls, mesh: HalfedgeMesh, spokes: Indices) -> RestRings:
        nearest_rest = np.empty((len(spokes), MAX_OPPOSITE, 2), np.int32)
        opposite_corners(mesh.arrays, spokes, new_ring(), nearest_rest)
        vertices, rest, column = mesh.arrays.vert[spokes], rest_of(mesh), column_of(mesh, REST_NORMAL)
        normals = mesh.arrays.attributes[vertices, column : column + 3]
        normals[nearest_rest[:, 0, 0] == nearest_rest[:, 0, 1]] = 0.0
        corners = np.where((nearest_rest < 0)[..., None], np.nan, rest[nearest_rest])
        return cls(spokes, rest[vertices], corners, unit(normals))

    def only(self, selected: AnyArray) -> RestRings:
        """Return the rings of the vertices with a flag in `selected` (N,)."""
        return RestRings(
            self.spokes[selected], self.centre[selected], self.corners[selected], self.normals[selected]
        )

    def sizes(self) -> Floats:
        """Return the length of one edge of each ring, (N,)."""
        return np.asarray(np.linalg.norm(self.corners[:, 0, 0] - self.centre, axis=1))

    def middle(self) -> Points:
        """Return the means (N, 3) of the corners."""
        middle: Points = np.nanmean(self.corners.reshape(len(self.spokes), -1, 3), axis=1)
        return middle
