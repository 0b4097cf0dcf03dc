"""The undeformed surface that a mesh keeps at its vertices, and its points closest to present goals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices, Points, Vectors
from pipeline.errors import FrameError
from pipeline.mesh.halfedge_mesh import HalfedgeMesh
from pipeline.mesh.normals import unit
from pipeline.resample.kernels.curved_patches import MAX_OPPOSITE, opposite_corners
from pipeline.resample.kernels.ring import new_ring

REST, REST_NORMAL, NORMAL, ASTRAY = "rest", "rest_normal", "normal", "astray"
"""Vertex attributes of exact placement: position and normal on the undeformed surface, present normal, and a
flag for vertices that had to be left off the surface.
"""


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
        return np.nanmean(self.corners.reshape(len(self.spokes), -1, 3), axis=1)


PointMap = Callable[[Points], Points]

_CUTS = 3  # parts of each triangle side in the lattice of first guesses
_LATTICE = np.array([(_CUTS - i - j, i, j) for i in range(_CUTS) for j in range(_CUTS - i)][1:]) / _CUTS
_ROUNDS = 2
_STEP = 1e-4  # finite difference, in sides of the triangle
_MAX_STEP = 0.5 / _CUTS  # of one round, in sides of the triangle


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
    lattice = np.einsum("wc,nkcx->nkwx", _LATTICE[:, 1:], corners)
    lattice += _LATTICE[:, :1] * centre[:, None, None]
    lattice = lattice.reshape(len(centre), -1, 3)
    valid = np.flatnonzero(np.isfinite(lattice[..., 0]).ravel())
    candidates = project(lattice.reshape(-1, 3)[valid])
    places = carry(candidates)
    distance = np.full(lattice.shape[:2], np.inf)
    distance.ravel()[valid] = np.linalg.norm(places - goals[valid // lattice.shape[1]], axis=1)
    best = distance.argmin(axis=1) + lattice.shape[1] * np.arange(len(centre))
    chosen = np.searchsorted(valid, best)
    nearest_rest, place = candidates[chosen], places[chosen]
    sides, normals = _tangent_frame(centre, corners)
    for _ in range(_ROUNDS):
        _refine(carry, project, nearest_rest, place, sides, normals, goals)
    return nearest_rest, place


def _tangent_frame(centre: Points, corners: Points) -> tuple[Vectors, Vectors]:
    """Return a side (N, 3) of the first triangle of each, and the unit normal of all, zero for lines."""
    spokes = corners - centre[:, None, None]
    return spokes[:, 0, 0], unit(np.nansum(np.cross(spokes[:, :, 0], spokes[:, :, 1]), axis=1))


def _refine(
    carry: PointMap,
    project: PointMap,
    nearest_rest: Points,
    place: Points,
    sides: Vectors,
    normals: Vectors,
    goals: Points,
) -> None:
    """Take one step within the surface towards the goals, for the points that it brings closer."""
    across = np.cross(normals, sides)
    along = np.cross(across, normals)
    beside = np.concatenate([nearest_rest + _STEP * along, nearest_rest + _STEP * across])
    ahead, left = np.split(carry(project(beside)), 2)
    one, two, gap = (ahead - place) / _STEP, (left - place) / _STEP, goals - place
    u, v = _least_squares(one, two, gap)
    new_rest = project(nearest_rest + u * along + v * across)
    new_place = carry(new_rest)
    nearer = np.linalg.norm(new_place - goals, axis=1) < np.linalg.norm(gap, axis=1)
    nearest_rest[nearer], place[nearer] = new_rest[nearer], new_place[nearer]


def _least_squares(one: Vectors, two: Vectors, gap: Vectors) -> tuple[Floats, Floats]:
    """Return the factors (N, 1) of two vectors that fit a third best, as a step of at most _MAX_STEP.

    Both are zero where the vectors are parallel.
    """
    aa, ab, bb = _dot(one, one), _dot(one, two), _dot(two, two)
    ag, bg = _dot(one, gap), _dot(two, gap)
    det = aa * bb - ab * ab
    solvable = det > 1e-12 * aa * bb
    det = np.where(solvable, det, 1.0)
    u, v = solvable * (bb * ag - ab * bg) / det, solvable * (aa * bg - ab * ag) / det
    size = np.hypot(u, v)
    scale = np.minimum(1.0, _MAX_STEP / np.where(size > 0, size, 1.0))
    return u * scale, v * scale


def _dot(a: Vectors, b: Vectors) -> AnyArray:
    products: AnyArray = np.einsum("nx,nx->n", a, b)
    return products[:, None]
