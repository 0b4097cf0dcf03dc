"""Face soups: polygons over shared vertices before they are known to form a surface.

Coincident vertices of a file are merged, and with them its loose triangles become one surface. Faces that are
wrong by themselves are dropped: those that name a vertex twice, stand twice, or lie back to back.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Points
from flowsculpt.pipeline.errors import MeshError
from flowsculpt.pipeline.mesh.mesh_formats import LARGEST_COORDINATE, FileSurface
from flowsculpt.pipeline.mesh.meshes import FaceLists, PolygonMesh


@dataclass(frozen=True)
class FaceSoup(FaceLists):
    """Polygons over shared vertices; any number of them may meet at an edge or vertex.

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

    @cached_property
    def centred_points(self) -> Points:
        """(V, 3) positions from the middle of the bounding box, so that products keep their digits."""
        return self.points - 0.5 * (self.points.min(axis=0) + self.points.max(axis=0))

    @cached_property
    def area_vectors(self) -> Points:
        if (self.sides == 3).all():
            a, b, c = (self.points[corners] for corners in self.corners.reshape(-1, 3).T)
            triangles: Points = 0.5 * np.cross(b - a, c - a)
            return triangles
        return self._newell_normals(self.points)

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
        if vertex is None:
            origin, corners = _renumbered(self.corners, len(self.points))
            return PolygonMesh.from_arrays(self.points[origin], self.offsets, corners), origin
        _, first, corners = np.unique(vertex, return_index=True, return_inverse=True)
        order = np.argsort(self.corners[first], kind="stable")
        place = np.empty_like(order)
        place[order] = np.arange(len(order))
        origin = self.corners[first][order]
        mesh = PolygonMesh.from_arrays(self.points[origin], self.offsets, place[corners.reshape(-1)])
        return mesh, origin


def _renumbered(values: AnyArray, count: int) -> tuple[AnyArray, AnyArray]:
    """Return the different values below `count`, ascending, and the place of each value among them."""
    is_used = np.zeros(count, bool)
    is_used[values] = True
    return np.flatnonzero(is_used), (np.cumsum(is_used) - 1)[values]


def connected_components(count: int, ends: AnyArray, others: AnyArray) -> AnyArray:
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


_MERGE = 1e-9  # of the bounding box's diagonal: closer vertices are one


class MergedSurface(NamedTuple):
    """Faces of a file over merged vertices, each with three different corners at least.

    joined     (V of the file,) the first vertex of the file at the same position
    unused     vertices of the file (K,) that no face names and that lie on no other
    collapsed  faces of the file (L,) with fewer than three corners left, which were dropped
    """

    soup: FaceSoup
    joined: AnyArray
    unused: AnyArray
    collapsed: AnyArray


def merge_coincident(surface: FileSurface) -> MergedSurface:
    """Merge coincident vertices; drop unused ones, and faces with fewer than three corners left.

    Raises MeshError where a face names a vertex whose coordinates are no numbers.
    """
    points, offsets = surface.points, surface.offsets
    named = np.zeros(len(points), bool)
    named[surface.corners] = True
    _require_numbers(surface, named)
    joined = find_coincident(points, named)
    corners, sides = joined[surface.corners], np.diff(offsets)
    following = np.arange(1, len(corners) + 1)
    some = offsets[1:] > offsets[:-1]
    following[offsets[1:][some] - 1] = offsets[:-1][some]
    kept = corners != corners[following]
    if not kept.all() or (sides < 3).any():
        face = np.repeat(np.arange(len(sides)), sides)
        sides = np.bincount(face[kept], minlength=len(sides))
        corners = corners[kept & (sides >= 3)[face]]
    whole = sides >= 3
    used, renumbered = _renumbered(corners, len(points))
    starts = np.concatenate([[0], np.cumsum(sides[whole])])
    soup = FaceSoup(points[used], starts, renumbered, np.flatnonzero(whole), used)
    return MergedSurface(
        soup, joined, np.flatnonzero(~named & (joined == np.arange(len(points)))), np.flatnonzero(~whole)
    )


def _require_numbers(surface: FileSurface, named: AnyArray) -> None:
    points, first = surface.points, surface.base or 0
    wrong = np.flatnonzero(named & ~(np.abs(points) <= LARGEST_COORDINATE).all(axis=1))  # and so not NaN
    if not len(wrong):
        return
    vertex = points[wrong[0]]
    at = ", ".join(f"{value:g}" for value in vertex)
    more = f" (and {len(wrong) - 1} more)" if len(wrong) > 1 else ""
    if np.isfinite(vertex).all():
        raise MeshError(
            f"vertex {wrong[0] + first}{more} is at ({at}), which is too large; "
            "coordinates are at most 1e12. Export the model again, in larger units."
        )
    raise MeshError(
        f"vertex {wrong[0] + first}{more} is at ({at}), which is not finite; "
        "coordinates must be numbers. Export the model again, or remove the vertex with its faces."
    )


def find_coincident(points: Points, named: AnyArray) -> AnyArray:
    """Return for each point (V,) the first one at the same position; those not `named` set no tolerance."""
    if not named.any():
        return np.arange(len(points))
    lowest = points[named].min(axis=0)
    span = float(np.linalg.norm(points[named].max(axis=0) - lowest)) or 1.0
    number = np.flatnonzero(np.isfinite(points).all(axis=1))
    steps = (points[number] - lowest) / max(_MERGE * span, np.finfo(float).smallest_subnormal)
    cells = np.round(np.clip(steps, -1e18, 1e18)).astype(np.int64)
    first = np.arange(len(points))
    if _are_distinct(cells):
        return first
    order = np.lexsort(cells.T)
    starts = np.append(True, (np.diff(cells[order], axis=0) != 0).any(axis=1))
    first[number[order]] = number[order[starts]][np.cumsum(starts) - 1]
    return first


_MIXING = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)
"""Odd factors whose products with whole numbers differ in all bits."""


def _are_distinct(cells: AnyArray) -> bool:
    """Return True where hashes prove that no two of some cells (N, 3), int64, are the same."""
    hashes = np.sort((cells.view(np.uint64) * _MIXING).sum(axis=1))
    return bool((hashes[1:] != hashes[:-1]).all())


def cut_repeats(soup: FaceSoup) -> tuple[FaceSoup, AnyArray]:
    """Cut faces that name a vertex twice in two there, again and again; parts with two corners are dropped.

    Returns the soup with the parts at its end, and the vertex (K,) that each such face names twice.
    """
    order = np.lexsort([soup.corners, soup.owners])
    corners, owners = soup.corners[order], soup.owners[order]
    again = np.flatnonzero((np.diff(corners) == 0) & (np.diff(owners) == 0))
    faces, first = np.unique(owners[again], return_index=True)
    if not len(faces):
        return soup, faces
    parts = [
        (part, soup.faces[f])
        for f in faces.tolist()
        for part in _simple_parts(soup.corners[soup.offsets[f] : soup.offsets[f + 1]].tolist())
    ]
    whole = np.ones(len(soup), bool)
    whole[faces] = False
    rest = soup.keep_faces(whole)
    lengths = [len(part) for part, _ in parts]
    cut = replace(
        rest,
        offsets=np.concatenate([rest.offsets, rest.offsets[-1] + np.cumsum(lengths, dtype=np.int64)]),
        corners=np.concatenate([rest.corners, *(np.array(part, np.int64) for part, _ in parts)]),
        faces=np.concatenate([rest.faces, np.array([face for _, face in parts], np.int64)]),
    )
    return cut, corners[again[first]]


def _simple_parts(corners: list[int]) -> list[list[int]]:
    """Return the loops of a polygon, each without a vertex twice, that have three corners at least."""
    loops: list[list[int]] = []
    path: list[int] = []
    for corner in corners:
        if corner in path:
            at = path.index(corner)
            loops.append(path[at:])
            path = path[:at]
        path.append(corner)
    return [loop for loop in (*loops, path) if len(loop) >= 3]


class DuplicateFaces(NamedTuple):
    """Faces to drop, by the reason; each (F,) bool.

    twice    an earlier face has the same corners in the same order
    doubled  an earlier face is its back, and both are a sheet of their own
    inner    it and its back lie inside, between two solids that share this wall
    """

    twice: AnyArray
    doubled: AnyArray
    inner: AnyArray


def find_duplicates(soup: FaceSoup) -> DuplicateFaces:
    """Find faces that stand twice or back to back."""
    twice, mate = np.zeros(len(soup), bool), np.full(len(soup), -1)
    for sides in np.unique(soup.sides):
        faces = np.flatnonzero(soup.sides == sides)
        rows, turned = _from_lowest(soup.corners[soup.offsets[faces][:, None] + np.arange(sides)])
        order = np.lexsort([faces, turned, *rows.T[::-1]])
        rows, turned, faces = rows[order], turned[order], faces[order]
        equal = (np.diff(rows, axis=0) == 0).all(axis=1)
        twice[faces[1:][equal & (turned[1:] == turned[:-1])]] = True
        starts = np.flatnonzero(np.append(True, ~equal))
        turns = np.flatnonzero(equal & (turned[1:] != turned[:-1]))
        fronts, backs = faces[starts[np.searchsorted(starts, turns, side="right") - 1]], faces[turns + 1]
        mate[fronts], mate[backs] = backs, fronts
    doubled, inner = mate >= 0, np.zeros(len(soup), bool)
    if doubled.any():
        inner = _walls(soup, mate, ~twice)
        doubled &= ~inner & (mate < np.arange(len(soup)))
    return DuplicateFaces(twice, doubled, inner)


def _from_lowest(rows: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Return polygons (N, n) from their lowest corner on, towards the lower neighbour; True where turned."""
    count = rows.shape[1]
    lowest, step = np.argmin(rows, axis=1)[:, None], np.arange(count)
    onwards = np.take_along_axis(rows, (lowest + step) % count, axis=1)
    backwards = np.take_along_axis(rows, (lowest - step) % count, axis=1)
    turned = onwards[:, 1] > backwards[:, 1]
    return np.where(turned[:, None], backwards, onwards), turned


def _walls(soup: FaceSoup, mate: AnyArray, counted: AnyArray) -> AnyArray:
    """Return which of the faces with a `mate` at their back lie between two solids.

    Such walls are regions of doubled faces whose rim is nowhere free: other faces go on at both sides of it.
    """
    doubled = mate >= 0
    sides = np.flatnonzero(counted[soup.owners])
    low, high = np.minimum(soup.corners, soup.heads), np.maximum(soup.corners, soup.heads)
    _, edge = np.unique((low * len(soup.points) + high)[sides], return_inverse=True)
    edge, owner = edge.reshape(-1), soup.owners[sides]
    inside = doubled[owner]
    of_doubled = np.bincount(edge, inside)
    others = np.bincount(edge, ~inside)
    rim, free = (of_doubled == 2) & (others >= 2), (of_doubled == 2) & (others < 2)
    some = np.empty(len(others), np.int64)
    some[edge[inside]] = owner[inside]  # one of the doubled faces at each edge
    pairs = np.flatnonzero(doubled)
    region = connected_components(
        len(soup), np.append(owner[inside], pairs), np.append(some[edge[inside]], mate[pairs])
    )
    has_rim, has_free = np.zeros(len(soup), bool), np.zeros(len(soup), bool)
    has_rim[region[owner[inside & rim[edge]]]] = True
    has_free[region[owner[inside & free[edge]]]] = True
    return doubled & (has_rim & ~has_free)[region]
