"""The undeformed surface that a mesh keeps at its vertices, and its points closest to present goals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices, Points, Vectors
from pipeline.errors import FrameError
from pipeline.mesh.halfedge_mesh import HalfedgeMesh
from pipeline.resample.kernels.closest_points import (
    LATTICE,
    MAX_OPPOSITE,
    choose_nearest,
    keep_nearer,
    measure_at_rest,
    opposite_corners,
    place_lattice,
    step_aside,
    step_to_goals,
    tangent_frames,
)
from pipeline.resample.kernels.ring import new_ring

REST, REST_NORMAL, NORMAL, ASTRAY = "rest", "rest_normal", "normal", "astray"
"""Vertex attributes of exact placement: position and normal on the undeformed surface, present normal, and a
flag for vertices that had to be left off the surface.
"""


_RING = new_ring()


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


@dataclass(frozen=True)
class RestRings:
    """The rings of vertices at rest.

    spokes   (N,) a half-edge that leaves each vertex
    centre   (N, 3) the vertices
    corners  (N, K, 2, 3) the other corners of the surrounding faces, nan where there are fewer than K; on a
             crease its two edges, each as twice the same corner
    normals  (N, 3) unit, zero on creases
    middle   (N, 3) the mean of the corners
    sizes    (N,) the length of one spoke, scene units
    """

    spokes: Indices
    centre: Points
    corners: Points
    normals: Vectors
    middle: Points
    sizes: Floats

    @classmethod
    def of(cls, mesh: HalfedgeMesh, spokes: Indices) -> RestRings:
        many, vertices = len(spokes), mesh.arrays.vert[spokes]
        opposite = np.empty((many, MAX_OPPOSITE, 2), np.int32)
        opposite_corners(mesh.arrays, spokes, _RING, opposite)
        centre, normals, middle = np.empty((3, many, 3))
        corners, sizes = np.empty((many, MAX_OPPOSITE, 2, 3)), np.empty(many)
        columns = column_of(mesh, REST), column_of(mesh, REST_NORMAL)
        attributes = mesh.arrays.attributes
        measure_at_rest(attributes, vertices, *columns, opposite, centre, corners, normals, middle, sizes)
        return cls(spokes, centre, corners, normals, middle, sizes)

    def only(self, selected: AnyArray) -> RestRings:
        """Return the rings of the vertices with a flag in `selected` (N,)."""
        return RestRings(*(getattr(self, field.name)[selected] for field in fields(self)))


PointMap = Callable[[Points], Points]

_ROUNDS = 2
_STEP = 1e-4  # finite difference, in sides of the triangle


def closest_points(
    carry: PointMap, project: PointMap, centre: Points, corners: Points, goals: Points
) -> tuple[Points, Points]:
    """Return the points of the surface that the flow brings closest to the goals: at rest, and now.

    carry    points at rest (N, 3) to their present positions
    project  points beside the surface at rest (N, 3) onto it
    centre   (N, 3) vertices at rest
    corners  (N, K, 2, 3) the other corners of K triangles at each, at rest; nan where there are fewer, and
             twice the same for an edge that the point must stay on
    goals    (N, 3) points now

    Takes the best point of a lattice within the triangles, then Gauss-Newton steps while they improve.
    """
    many = len(centre)
    lattice, starts = np.empty((LATTICE * many, 3)), np.empty(many + 1, np.int64)
    candidates = project(lattice[: place_lattice(centre, corners, lattice, starts)])
    nearest_rest, places = np.empty((2, many, 3))
    choose_nearest(starts, candidates, carry(candidates), goals, nearest_rest, places)
    frames, beside, new_rest = np.empty((many, 2, 3)), np.empty((2 * many, 3)), np.empty((many, 3))
    tangent_frames(centre, corners, frames)
    for _ in range(_ROUNDS):
        step_aside(nearest_rest, frames, _STEP, beside)
        moved = carry(project(beside))
        step_to_goals(nearest_rest, places, moved, goals, _STEP, frames, new_rest)
        projected = project(new_rest)
        keep_nearer(projected, carry(projected), goals, nearest_rest, places)
    return nearest_rest, places
