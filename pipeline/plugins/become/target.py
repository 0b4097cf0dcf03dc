"""Surfaces that a fit carries, and those that it carries them to; all in the unit cube of the paths."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.arrays import Faces, Floats, Points, Vectors
from pipeline.flow.regions import TriangleTree, with_distances
from pipeline.plugins.become import fit_kernels as kernels

NODES = 96
"""Nodes along each axis of the grid that distances stand on."""


def face_vectors(points: Points, faces: Faces) -> Vectors:
    """Return vectors (F, 3) along the normals of triangles, as long as their areas."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    return 0.5 * np.cross(b - a, c - a)


def lengths(vectors: Vectors) -> Floats:
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))


@dataclass(frozen=True, eq=False)
class FittedSurface:
    """A closed surface: points (V, 3) and faces (F, 3)."""

    points: Points
    faces: Faces

    @cached_property
    def tree(self) -> TriangleTree:
        return TriangleTree.of(self.points[self.faces])

    @cached_property
    def diagonal(self) -> float:
        """Of the bounding box."""
        return float(np.sqrt((np.ptp(self.points, axis=0) ** 2).sum()))

    @cached_property
    def holes(self) -> int:
        """The genus: half of 2 − V + E − F."""
        return 1 - (len(self.points) - len(self.faces) // 2) // 2

    @cached_property
    def vertex_normals(self) -> tuple[Vectors, Floats]:
        """Unit normals (V, 3), by the areas of the faces around each vertex, and its shares (V,) of them."""
        vectors, sums = face_vectors(self.points, self.faces), np.zeros_like(self.points)
        areas = np.zeros(len(sums))
        for corners in self.faces.T:
            areas = areas + np.bincount(corners, lengths(vectors) / 3.0, len(sums))
            for c in range(3):
                sums[:, c] += np.bincount(corners, vectors[:, c], len(sums))
        return sums / np.maximum(lengths(sums), 1e-300)[:, None], areas

    @cached_property
    def face_normals(self) -> Vectors:
        vectors = face_vectors(self.points, self.faces)
        return vectors / np.maximum(lengths(vectors), 1e-300)[:, None]

    def nearest(self, points: Points) -> tuple[Points, Vectors]:
        """Return the nearest points (P, 3) of the surface, and the normals of their faces (P, 3)."""
        tree, out, found = self.tree, np.empty_like(points), np.empty(len(points), np.int64)
        kernels.nearest_on_triangles(tree.memory.ctypes.data, tree.triangles, points, out, found)
        return out, self.face_normals[tree.order[found]]

    def samples(self, count: int) -> tuple[Points, Vectors]:
        """Return points (count, 3), evenly by area, and the normals of their faces.

        They are evenly spaced along the areas of faces in the order of the tree, where neighbours are near.
        """
        order = self.tree.order
        areas = np.cumsum(lengths(face_vectors(self.points, self.faces[order])))
        place = (np.arange(count) + 0.5) / count * areas[-1]
        face = order[np.minimum(np.searchsorted(areas, place), len(order) - 1)]
        s, r = (np.arange(count)[:, None] * np.array([0.7548776662466927, 0.5698402909980532]) % 1.0).T
        s, r = np.where(s + r > 1.0, 1.0 - s, s), np.where(s + r > 1.0, 1.0 - r, r)  # the R2 sequence
        a, b, c = (self.points[self.faces[face, k]] for k in range(3))
        return a + s[:, None] * (b - a) + r[:, None] * (c - a), self.face_normals[face]


DEEP = 0.9
"""Depth over the greatest from which on a place counts as thickest; of these the one nearest the middle is
taken."""

FULL = 0.7
"""How much of a ball the part of a solid fills that a fit begins with."""


@dataclass(frozen=True, eq=False)
class SolidGrowth:
    """How a solid grows from its thickest place: distances from there within it.

    grid   padded grid of NODES³ cells with three numbers a node: signed distance from the surface, negative
           inside; distance u from the thickest place through the solid, and on from its surface; 0
    start  the largest u up to which the solid fills much of a ball; with holes it is `end`, for what grows
           around a hole meets itself
    end    the largest u of the solid
    """

    grid: Floats
    start: float
    end: float

    @classmethod
    def of(cls, surface: FittedSurface) -> SolidGrowth:
        signed = signed_distances(surface)
        nodes = np.stack(np.meshgrid(*[np.arange(NODES)] * 3, indexing="ij"), axis=-1) / NODES
        inside, deep = signed < 0.0, signed <= DEEP * signed.min()
        off_centre = ((nodes[deep] - nodes[inside].mean(axis=0)) ** 2).sum(axis=-1)
        seed = np.flatnonzero(deep)[np.argmin(off_centre)]
        straight = np.sqrt(((nodes - nodes.reshape(-1, 3)[seed]) ** 2).sum(axis=-1))
        u = np.where(straight <= -signed.ravel()[seed], straight, 10.0)
        kernels.sweep(u, inside & (u == 10.0), 1.0 / NODES, 3)
        reached = inside & (u < 10.0)
        kernels.sweep(u, ~reached, 1.0 / NODES, 2)
        ordered = np.sort(u[reached])
        end, radius = float(ordered[-1]), -float(signed.ravel()[seed])
        size = np.arange(1, len(ordered) + 1) / NODES**3
        round_until = ordered[size >= FULL * 4.0 / 3.0 * np.pi * ordered**3]
        start = end if surface.holes else max(radius, float(round_until[-1]))
        values = np.stack([signed, np.minimum(u, 2.0), np.zeros_like(u)], axis=-1)
        grid = np.pad(values, ((1, 2), (1, 2), (1, 2), (0, 0)), mode="edge").ravel()
        return cls(grid, start, end)

    def residual(self, points: Points, until: float) -> tuple[Floats, Vectors]:
        """Return signed distances (P,) from the part with u up to `until`, about, and their gradients."""
        signed, towards, u, along = self._values(points)
        front = u - until > signed
        return np.where(front, u - until, signed), np.where(front[:, None], along, towards)

    def places(self, points: Points, normals: Vectors, until: float) -> tuple[Points, Vectors]:
        """Return where points (P, 3) of a surface should be on what has grown until u, and normals there.

        Points within it whose normals point where it grows go on that way, and others to the nearest place.
        """
        x = points.copy()
        signed, towards, u, along = self._values(x)
        ahead = np.einsum("ij,ij->i", normals, along)
        grows = (
            (signed < 0.0) & (u < until) & (ahead > np.maximum(np.einsum("ij,ij->i", normals, towards), 0.3))
        )
        rows = np.flatnonzero(grows)
        for _ in range(NODES):
            signed, _, u, along = self._values(x[rows])
            rest = np.minimum(until - u, -signed)
            moving = rest > 0.05 / NODES
            rows = rows[moving]
            if not len(rows):
                break
            x[rows] += np.minimum(rest[moving], 1.0 / NODES)[:, None] * along[moving]
        for _ in range(3):
            distance, gradient = self.residual(x, until)
            far = distance[:, None] * gradient
            x -= np.where(grows[:, None], 0.0, far)
        _, gradient = self.residual(x, until)
        return x, gradient

    def reached(self, points: Points) -> Floats:
        """Return u (P,) at points (P, 3)."""
        return self._values(points)[2]

    def _values(self, points: Points) -> tuple[Floats, Vectors, Floats, Vectors]:
        """Return signed distances and their directions, u and its directions."""
        values, gradient = np.empty_like(points), np.empty((len(points), 3, 3))
        kernels.gradients(self.grid, NODES, points * NODES, values, gradient)
        towards, along = (gradient[:, k] / np.maximum(lengths(gradient[:, k]), 1e-9)[:, None] for k in (0, 1))
        return values[:, 0], towards, values[:, 1], along


def signed_distances(surface: FittedSurface) -> Floats:
    """Return signed distances at the nodes (NODES, NODES, NODES), negative inside."""
    shape, corners = (NODES, NODES, NODES), surface.points[surface.faces]
    memory = with_distances(surface.tree, corners, np.zeros(3), 1.0 / NODES, shape)
    return memory[-(NODES**3) :].reshape(shape)
