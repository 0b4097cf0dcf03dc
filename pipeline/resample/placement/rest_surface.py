"""The undeformed surface, as a mesh keeps it at its vertices: where they lie there, and what lies around."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices, Points, Vectors
from pipeline.errors import FrameError
from pipeline.mesh.halfedge_mesh import HalfedgeMesh
from pipeline.mesh.tangents import unit
from pipeline.resample._kernels_patch import lay_out
from pipeline.resample._kernels_rest import MOST_BLADES, blades
from pipeline.resample._kernels_ring import new_ring
from pipeline.resample.placement.base import on_patches

REST, REST_NORMAL, NORMAL, ASTRAY = "rest", "rest_normal", "normal", "astray"
"""Vertex attributes of exact placement: where a vertex lies on the undeformed surface and about its normal
there, its normal now, and whether it had to be left off the surface."""

_ONLY_TAGGED = -1.0  # the cosine that makes no edge hard by its angle


def column_of(mesh: HalfedgeMesh, name: str) -> int:
    """Where an attribute begins among the columns. Raises FrameError where the mesh has it not."""
    column = mesh.column(name)
    if column is None:
        raise FrameError(f"the surface has no vertex attribute {name!r}; exact placement needs it")
    return column


def rest_of(mesh: HalfedgeMesh) -> Points:
    """(V, 3) view of the vertices' places at rest."""
    column = column_of(mesh, REST)
    return mesh.surface.carried[: mesh.sizes[0], column : column + 3]


def on_patches_at_rest(mesh: HalfedgeMesh, births: Indices) -> tuple[Points, Vectors]:
    """Middles (N, 3) of edges at rest on curved patches, and unit normals there, zero on creases."""
    room = 3 * len(mesh.surface.points)
    rest = mesh.scratch("rest", room, np.float64)[:room].reshape(-1, 3)
    lay_out(mesh.surface, births, column_of(mesh, REST), new_ring(), rest)
    return on_patches(mesh.surface._replace(points=rest), births, _ONLY_TAGGED)


@dataclass(frozen=True)
class Surroundings:
    """What lies around vertices at rest.

    spokes   (N,) a half-edge that leaves each
    centre   (N, 3) the vertices themselves
    corners  (N, K, 2, 3) the other corners of the faces around, nan where there are fewer than K; on a crease
             its two edges, each as twice the same corner
    normals  (N, 3) unit, zero on creases
    """

    spokes: Indices
    centre: Points
    corners: Points
    normals: Vectors

    @classmethod
    def of(cls, mesh: HalfedgeMesh, spokes: Indices) -> Surroundings:
        found = np.empty((len(spokes), MOST_BLADES, 2), np.int32)
        blades(mesh.surface, spokes, new_ring(), found)
        vertices, rest, column = mesh.surface.vert[spokes], rest_of(mesh), column_of(mesh, REST_NORMAL)
        normals = mesh.surface.carried[vertices, column : column + 3]
        normals[found[:, 0, 0] == found[:, 0, 1]] = 0.0
        corners = np.where((found < 0)[..., None], np.nan, rest[found])
        return cls(spokes, rest[vertices], corners, unit(normals))

    def only(self, these: AnyArray) -> Surroundings:
        """Of the vertices that (N,) booleans tell."""
        return Surroundings(self.spokes[these], self.centre[these], self.corners[these], self.normals[these])

    def sizes(self) -> Floats:
        """(N,) lengths of an edge at each."""
        return np.asarray(np.linalg.norm(self.corners[:, 0, 0] - self.centre, axis=1))

    def middle(self) -> Points:
        """(N, 3) means of the corners."""
        middle: Points = np.nanmean(self.corners.reshape(len(self.spokes), -1, 3), axis=1)
        return middle
