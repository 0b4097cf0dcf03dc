"""Placements: where the copies of a surface are, how each is turned, and how large it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Floats, Points, Vectors
from flowsculpt.pipeline.mesh.meshes import PolygonMesh, TriangleMesh

COPIES, STARTS = "copies", "starts"
"""Arrays (N, 3, 4) of a stored surface that is one copy of several: their placements now, and at rest."""

MOST_EXTREMES = 512
"""Points of one copy that stand for its extent."""

Mesh = TypeVar("Mesh", TriangleMesh, PolygonMesh)


@dataclass(frozen=True, eq=False)
class Placements:
    """The placements of N copies of a surface.

    matrices  float64 (N, 3, 4): the first three columns of each are a rotation times a size, the last is
              where the origin of the surface is
    """

    matrices: Floats

    @classmethod
    def of(cls, origins: Points, turns: Floats | None = None, sizes: Floats | None = None) -> Placements:
        """Return placements with origins (N, 3), rotations (N, 3, 3) and sizes (N,)."""
        linear = np.broadcast_to(np.eye(3), (len(origins), 3, 3)) if turns is None else turns
        if sizes is not None:
            linear = linear * sizes[:, None, None]
        return cls(np.concatenate([linear, origins[:, :, None]], axis=2))

    def __len__(self) -> int:
        return len(self.matrices)

    @property
    def origins(self) -> Points:
        """The origin of the surface in each copy, (N, 3)."""
        return self.matrices[:, :, 3]

    @cached_property
    def sizes(self) -> Floats:
        """The size (N,) of each copy over that of the surface."""
        return np.asarray(np.linalg.norm(self.matrices[:, :, 0], axis=1))

    @property
    def rotations(self) -> Floats:
        """The rotation (N, 3, 3) of each copy."""
        return np.asarray(self.matrices[:, :, :3] / self.sizes[:, None, None])

    def points(self, own: Points) -> Points:
        """Return the points (N · V, 3) of all copies, one after another, of points (V, 3) of the surface."""
        turned = np.einsum("nij,vj->nvi", self.matrices[:, :, :3], own)
        return np.asarray((turned + self.origins[:, None]).reshape(-1, 3))

    def diameter(self, own: Points) -> float:
        """Return the diagonal of the bounding box of all copies of points (V, 3) of the surface.

        Of each copy, along one axis after another, only the ends are kept: `points` takes ten times as long.
        """
        extent = []
        for row, origin in zip(self.matrices[:, :, :3].swapaxes(0, 1).copy(), self.origins.T, strict=True):
            along = row @ own.T
            extent.append((origin + along.max(axis=1)).max() - (origin + along.min(axis=1)).min())
        return float(np.linalg.norm(extent))

    def directions(self, own: Vectors) -> Vectors:
        """Return the directions (N · V, 3) of all copies, as long as those (V, 3) of the surface."""
        turns = self.matrices[:, :, :3] / self.sizes[:, None, None]
        return np.asarray(np.einsum("nij,vj->nvi", turns, own).reshape(-1, 3))

    def local(self, points: Points, copy: AnyArray) -> Points:
        """Return points (V, 3) of copies, by their numbers (V,), as points of the surface."""
        from_origin = (points - self.origins[copy])[:, :, None]
        squares = (self.sizes**2)[copy, None]
        return np.asarray((self.matrices[copy, :, :3] * from_origin).sum(axis=1) / squares)

    def placed(self, own: Points, copy: AnyArray) -> Points:
        """Return points (V, 3) of the surface, each in the copy with its number (V,)."""
        return self.turned(own, copy, self.matrices[:, :, :3]) + self.origins[copy]

    def turned(self, own: Vectors, copy: AnyArray, linear: Floats | None = None) -> Vectors:
        """Return vectors (V, 3) of the surface, turned as the copies are with their numbers (V,)."""
        turns = self.matrices[:, :, :3] / self.sizes[:, None, None] if linear is None else linear
        return np.asarray((turns[copy] * own[:, None]).sum(axis=2))

    def repeated(self, mesh: Mesh) -> Mesh:
        """Return one mesh of the copies of another, one after another."""
        vertices = self.points(mesh.vertices)
        count = len(self)
        if count == 1:
            return mesh.with_vertices(vertices)
        first = len(mesh.vertices) * np.arange(count)
        attributes = {name: np.concatenate([values] * count) for name, values in mesh.attributes.items()}
        creases = shifted(mesh.creases, first)
        if isinstance(mesh, TriangleMesh):
            faces, seams = shifted(mesh.faces, first), shifted(mesh.seams, first)
            return TriangleMesh(vertices, faces, attributes, creases, seams)
        starts = mesh.offsets[:-1] + len(mesh.corners) * np.arange(count)[:, None]
        ends = np.append(starts.reshape(-1), len(mesh.corners) * count)
        corners = (mesh.corners + first[:, None]).reshape(-1)
        return PolygonMesh.from_arrays(vertices, ends, corners, attributes, creases)

    def moved(self, reach: float, displace: Callable[[Points], Points]) -> Placements:
        """Return the copies after a flow: each origin is carried, and its turn follows the flow around it.

        The rotation nearest to the gradient of the flow's map times the turn so far is that of its polar
        decomposition (Higham, *Computing the polar decomposition*, 1986). A turn follows from the one before
        and so never jumps. Differences are central, and exact for a flow whose map is linear.

        reach     distance of the points from the origin whose differences are the gradient, in sizes
        displace  the map of the flow: points (M, 3) to points (M, 3)
        """
        away = reach * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
        around = self.origins[:, None] + self.sizes[:, None, None] * away
        moved = displace(around.reshape(-1, 3)).reshape(around.shape)
        gradients = (moved[:, 1:4] - moved[:, 4:]).swapaxes(1, 2) / (2.0 * reach * self.sizes[:, None, None])
        turns = nearest_rotations(gradients @ self.matrices[:, :, :3])
        return Placements.of(moved[:, 0], turns, self.sizes)


def shifted(numbers: AnyArray, first: AnyArray) -> AnyArray:
    """Return rows (K, n) of vertex numbers once for each copy, whose first vertices are `first` (N,)."""
    return np.asarray((numbers + first.astype(numbers.dtype)[:, None, None]).reshape(-1, numbers.shape[1]))


def nearest_rotations(matrices: Floats) -> Floats:
    """Return the rotations (N, 3, 3) nearest to matrices (N, 3, 3), in the sum of squares."""
    u, _, v = np.linalg.svd(matrices)
    flips = np.ones((len(matrices), 3))
    flips[:, 2] = np.sign(np.linalg.det(u @ v))
    return np.asarray((u * flips[:, None]) @ v)


def all_copies(arrays: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
    """Return the arrays of a shaded surface with those of all copies, one after another, of a stored one.

    arrays  as `Shading.stored` has them; those without COPIES are returned as they are
    """
    if COPIES not in arrays:
        return dict(arrays)
    now, rest = (Placements(arrays[name]) for name in (COPIES, STARTS))
    others = {name: values for name, values in arrays.items() if name not in (COPIES, STARTS)}
    own, count = arrays["vertices"].astype(np.float64), np.arange(len(now))
    sources = arrays["source_vertex"][:, None]
    return {
        **others,
        "vertices": now.points(own).astype(np.float32),
        "normals": now.directions(arrays["normals"].astype(np.float64)).astype(np.float32),
        "faces": shifted(arrays["faces"], len(own) * count),
        "source_vertex": shifted(sources, (int(sources.max()) + 1) * count).reshape(-1),
        "material": rest.points(own).astype(np.float32),
    }


def extremes(points: Points) -> Points:
    """Return the points (at most MOST_EXTREMES) that lie farthest in some direction."""
    if len(points) <= MOST_EXTREMES:
        return points
    heights = (np.arange(MOST_EXTREMES) + 0.5) / MOST_EXTREMES * 2.0 - 1.0
    angles = np.pi * (3.0 - 5.0**0.5) * np.arange(MOST_EXTREMES)  # directions on a spiral of golden angles
    around = np.sqrt(1.0 - heights**2)
    directions = np.stack([around * np.cos(angles), heights, around * np.sin(angles)])
    axes = np.concatenate([directions, np.eye(3), -np.eye(3)], axis=1)
    return points[np.unique([int(np.argmax(points @ axis)) for axis in axes.T])]
