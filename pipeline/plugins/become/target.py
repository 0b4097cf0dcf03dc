"""Surfaces that a fit carries, and those that it carries them to; all in the unit cube of the paths."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flowsculpt.api.flows import TriangleTree
from flowsculpt.api.meshes import Floats, Indices
from flowsculpt.pipeline.plugins.become import fit_kernels as kernels

PATCH = 50
"""Samples in a patch; they follow each other in the order of the tree, where neighbours are near."""

NODES = 96
"""Nodes along each axis of the grid that distances stand on."""


def face_vectors(points: Floats, faces: Indices) -> Floats:
    """Return vectors (F, 3) along the normals of triangles, as long as their areas."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    return 0.5 * np.cross(b - a, c - a)


def lengths(vectors: Floats) -> Floats:
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))


def within_cube(points: Floats) -> np.ndarray:
    """Return whether points (P, 3) are in the unit cube, (P,)."""
    return np.asarray(((points > 0.0) & (points < 1.0)).all(axis=1))


@dataclass(frozen=True, eq=False)
class FittedSurface:
    """A closed surface: points (V, 3) and faces (F, 3)."""

    points: Floats
    faces: Indices

    @cached_property
    def tree(self) -> TriangleTree:
        return TriangleTree.of(self.points[self.faces])

    @cached_property
    def diagonal(self) -> float:
        """Of the bounding box."""
        return float(np.sqrt((np.ptp(self.points, axis=0) ** 2).sum()))

    @cached_property
    def growth(self) -> SolidGrowth:
        """How the solid that it encloses grows."""
        return SolidGrowth.of(self)

    def thin_share(self, n: int) -> float:
        """Return the share that is thinner than two of n cells of the cube, seen from one cell below it."""
        points, normals = self.samples(4000)
        depths, _ = self.growth.whole.residual(points - normals / n)
        return float(np.mean(depths > -0.7 / n))

    @cached_property
    def holes(self) -> int:
        """The genus: half of 2 − V + E − F."""
        return 1 - (len(self.points) - len(self.faces) // 2) // 2

    @cached_property
    def vertex_normals(self) -> tuple[Floats, Floats]:
        """Unit normals (V, 3), by the areas of the faces around each vertex, and its shares (V,) of them."""
        vectors, sums = face_vectors(self.points, self.faces), np.zeros_like(self.points)
        areas = np.zeros(len(sums))
        for corners in self.faces.T:
            areas = areas + np.bincount(corners, lengths(vectors) / 3.0, len(sums))
            for c in range(3):
                sums[:, c] += np.bincount(corners, vectors[:, c], len(sums))
        return sums / np.maximum(lengths(sums), 1e-300)[:, None], areas

    @cached_property
    def face_normals(self) -> Floats:
        vectors = face_vectors(self.points, self.faces)
        return vectors / np.maximum(lengths(vectors), 1e-300)[:, None]

    def nearest(self, points: Floats) -> tuple[Floats, Floats]:
        """Return the nearest points (P, 3) of the surface, and the normals of their faces (P, 3)."""
        face, shares = self.tree.nearest(points)
        a, b, c = self.points[self.faces[face]].swapaxes(0, 1)
        return a + shares[:, :1] * (b - a) + shares[:, 1:] * (c - a), self.face_normals[face]

    def samples(self, count: int) -> tuple[Floats, Floats]:
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

    def distances(self, other: FittedSurface, count: int) -> tuple[Floats, Floats]:
        """Return samples (count, 3), and their distances (count,) from another surface."""
        points = self.samples(count)[0]
        return points, lengths(points - other.nearest(points)[0])


@dataclass(frozen=True, eq=False)
class SurfaceInBox(FittedSurface):
    """A closed surface of which a fit sees what lies in the unit cube.

    reached  the closed surface whose solid is there already
    """

    reached: FittedSurface

    @cached_property
    def growth(self) -> SolidGrowth:
        return SolidGrowth.onwards(self, self.reached)

    @cached_property
    def _seen(self) -> FittedSurface:
        """Faces that touch the cube."""
        corners = self.points[self.faces]
        touches = (corners.max(axis=1) > 0.0) & (corners.min(axis=1) < 1.0)
        return FittedSurface(self.points, self.faces[touches.all(axis=1)])

    @cached_property
    def diagonal(self) -> float:
        """Of what lies in the cube."""
        return float(np.sqrt((np.ptp(self.samples(1000)[0], axis=0) ** 2).sum()))

    def samples(self, count: int) -> tuple[Floats, Floats]:
        points, normals = self._seen.samples(count)
        here = within_cube(points)
        return points[here], normals[here]


FAR = 10.0
"""The distance of cells that cannot be reached through the solid."""

DEEP = 0.7
"""Depth over the greatest from which on a place may be the core; of these the one is taken from which no
other place is far through the solid."""

FULL = 0.7
"""How much of a ball, or of tubes, the part of a solid fills that a fit begins with."""

LANDMARKS = 6
"""Places of a solid whose distances through it tell apart what is near in space only."""


@dataclass(frozen=True, eq=False)
class SolidGrowth:
    """How a solid grows from its core, the thickest place or, with holes, loops around them.

    signed   distance from the surface (NODES, NODES, NODES), negative inside
    through  distances (NODES, NODES, NODES, 1 + LANDMARKS) through the solid: u from the core, and from
             landmarks far from each other. Outside of the solid they are those of the nearest place of its
             surface: between two limbs each side has its own.
    start    the largest u up to which the solid fills much of a ball, or of tubes around the core
    end      the largest u of the solid
    """

    signed: Floats
    through: Floats
    start: float
    end: float

    @classmethod
    def of(cls, surface: FittedSurface) -> SolidGrowth:
        signed = signed_distances(surface)
        inside = signed < 0.0
        u, radius, length = _from_core(signed, inside, surface.holes)
        reached = inside & (u < FAR)
        ordered = np.sort(u[reached])
        end = float(ordered[-1])
        size = np.arange(1, len(ordered) + 1) / NODES**3
        whole = np.pi * ordered**2 * (4.0 / 3.0 * ordered + length)
        start = max(radius, float(ordered[size >= FULL * whole][-1]))
        return cls(signed, _through(u, reached, signed), min(start, end), end)

    @classmethod
    def onwards(cls, solid: FittedSurface, reached: FittedSurface) -> SolidGrowth:
        """Return the growth, within the unit cube, of a solid from another that is there already."""
        signed = signed_distances(solid)
        inside = signed < 0.0
        core = inside & (signed_distances(reached) < 0.0)
        u = np.where(core, 0.0, FAR)
        kernels.sweep(u, inside & ~core, 1.0 / NODES)
        filled = inside & (u < FAR)
        return cls(signed, _through(u, filled, signed), 0.0, float(u[filled].max(initial=0.0)))

    @cached_property
    def _grids(self) -> list[Floats]:
        return [_padded(self.through[..., k : k + 3]) for k in range(1, 1 + LANDMARKS, 3)]

    def landmarks_at(self, points: Floats) -> Floats:
        """Return distances (P, LANDMARKS) through the solid from its landmarks."""
        values, gradient = np.empty((2, *points.shape)), np.empty((len(points), 3, 3))
        for grid, into in zip(self._grids, values, strict=True):
            kernels.gradients(grid, NODES, points * NODES, into, gradient)
        return np.hstack([*values])

    @cached_property
    def whole(self) -> GrownPart:
        return self.part(FAR)

    def part(self, until: float) -> GrownPart:
        """Return what has grown until u."""
        u = self.through[..., 0]
        inner = np.maximum(self.signed, u - until)
        known = (self.signed < 0.0) & (inner < 0.0)
        distance = np.where(known, inner, FAR)
        kernels.sweep(distance, ~known, 1.0 / NODES)
        return GrownPart(_padded(np.stack([self.signed, u, distance], axis=-1)), until)


@dataclass(frozen=True, eq=False)
class GrownPart:
    """The part of a solid with u up to `until`.

    grid  padded grid of NODES³ cells with three numbers a node: signed distance from the surface of the
          solid, u, and signed distance from the surface of the part, about
    """

    grid: Floats
    until: float

    def residual(self, points: Floats) -> tuple[Floats, Floats]:
        """Return signed distances (P,) from the part, about, and their gradients."""
        values, ways = self._values(points)
        return values[:, 2], ways[2]

    def places(self, points: Floats, normals: Floats) -> tuple[Floats, Floats]:
        """Return where points (P, 3) of a surface should be on the part, and normals there.

        Points within it whose normals point where it grows go on that way, and others to the nearest place.
        """
        x = points.copy()
        values, (towards, along, _) = self._values(x)
        ahead = np.einsum("ij,ij->i", normals, along)
        beside = np.einsum("ij,ij->i", normals, towards)
        grows = (values[:, 0] < 0.0) & (values[:, 1] < self.until) & (ahead > np.maximum(beside, 0.3))
        rows = np.flatnonzero(grows)
        for _ in range(NODES):
            values, ways = self._values(x[rows])
            rest = np.minimum(self.until - values[:, 1], -values[:, 0])
            moving = rest > 0.05 / NODES
            rows = rows[moving]
            if not len(rows):
                break
            x[rows] += np.minimum(rest[moving], 1.0 / NODES)[:, None] * ways[1][moving]
        for _ in range(3):
            distance, gradient = self.residual(x)
            far = distance[:, None] * gradient
            x -= np.where(grows[:, None], 0.0, far)
        return x, self.residual(x)[1]

    def holds(self, points: Floats) -> np.ndarray:
        """Return True for points (P, 3) on the surface of the solid that belong to the part."""
        return self._values(points)[0][:, 1] <= self.until

    def _values(self, points: Floats) -> tuple[Floats, list[Floats]]:
        """Return the numbers (P, 3) of the grid, and the directions in which each grows."""
        values, gradient = np.empty_like(points), np.empty((len(points), 3, 3))
        kernels.gradients(self.grid, NODES, points * NODES, values, gradient)
        return values, [gradient[:, k] / np.maximum(lengths(gradient[:, k]), 1e-9)[:, None] for k in range(3)]


def signed_distances(surface: FittedSurface) -> Floats:
    """Return signed distances at the nodes (NODES, NODES, NODES), negative inside."""
    shape = (NODES, NODES, NODES)
    return surface.tree.with_distances(np.zeros(3), 1.0 / NODES, shape)[-(NODES**3) :].reshape(shape)


def _padded(values: Floats) -> Floats:
    return np.pad(values, ((1, 2), (1, 2), (1, 2), (0, 0)), mode="edge").ravel()


def _from_core(signed: Floats, inside: np.ndarray, holes: int) -> tuple[Floats, float, float]:
    """Return distances u from the core of a solid, FAR in cells out of reach, and its radius and length."""
    if holes:
        core = inside.copy()
        kernels.thin(-signed, core)
        u = np.where(core, 0.0, FAR)
        radius, length = 1.0 / NODES, 1.2 * float(core.sum()) / NODES
    else:
        nodes = np.stack(np.meshgrid(*[np.arange(NODES)] * 3, indexing="ij"), axis=-1) / NODES
        seed = _middle(signed, inside)
        straight = np.sqrt(((nodes - nodes.reshape(-1, 3)[seed]) ** 2).sum(axis=-1))
        radius, length = -float(signed.ravel()[seed]), 0.0
        u = np.where(straight <= radius, straight, FAR)
    kernels.sweep(u, inside & (u == FAR), 1.0 / NODES)
    return u, radius, length


def _middle(signed: Floats, inside: np.ndarray) -> int:
    """Return the flat index of a deep node from which the farthest one through the solid is near."""
    deep = np.flatnonzero(signed <= DEEP * signed.min())
    far = _distances_from(int(np.argmin(signed)), inside)
    least, most = np.full_like(signed, FAR), np.zeros(len(deep))
    for _ in range(3):
        far = _distances_from(int(np.argmax(np.where(far < FAR, np.minimum(far, least), -1.0))), inside)
        least, most = np.minimum(least, far), np.maximum(most, far.flat[deep])
    return int(deep[np.argmin(most)])


def _distances_from(node: int, is_open: np.ndarray) -> Floats:
    """Return distances (N, N, N) through open nodes from the one with this flat index."""
    far = np.full(is_open.shape, FAR)
    far.flat[node] = 0.0
    kernels.sweep(far, is_open & (far == FAR), 1.0 / NODES)
    return far


def _through(u: Floats, reached: np.ndarray, signed: Floats) -> Floats:
    """Return distances (N, N, N, 1 + LANDMARKS) through a solid from its core, u, and from landmarks."""
    found, least = [u.copy()], np.where(reached, u, -1.0)
    for _ in range(LANDMARKS):
        far = _distances_from(int(np.argmax(least)), reached)
        found.append(far)
        least = np.minimum(least, far)
    values = np.ascontiguousarray(np.stack(found, axis=-1))
    outside = np.flatnonzero(~reached)
    order = outside[np.argsort(signed.ravel()[outside], kind="stable")]
    kernels.extend(values, np.ascontiguousarray(signed), order)
    return values
