"""Solids of outlines: extruded along z, with bevels in front and behind."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
import shapely

from flowsculpt import PolygonMesh, TriangleMesh, UsageError
from flowsculpt.pipeline.plugins.lettering.bevel import TooWideError, bevelled
from flowsculpt.pipeline.plugins.lettering.outlines import OutlineShape, polygons_of, rings_of

HARD = math.radians(30.0)
"""Angle between faces from which on the edge between them is a crease."""

CAP, WALL = -1, -2
"""What faces belong to, besides the pieces of bevels."""

HALVINGS = 10
"""Halvings of the interval that the widest bevel is found in."""

SHORTEST = 1e-6
"""Edges of a solid that are shorter than this, over its extent, are contracted."""


@dataclass(frozen=True)
class Section:
    """The section of a solid along z.

    depth  from front to back, units
    bevel  width and height of the bevels, units; 0 for none
    shape  round: a quarter of a circle, in `steps` pieces; flat: one piece
    """

    depth: float
    bevel: float = 0.0
    shape: Literal["round", "flat"] = "round"
    steps: int = 4

    @cached_property
    def levels(self) -> list[tuple[float, float]]:
        """Inset and height of the bevel after each of its pieces, units."""
        if not self.bevel:
            return []
        steps = self.steps if self.shape == "round" else 1
        angles = [0.5 * math.pi * (i + 1) / steps for i in range(steps)]
        return [(self.bevel * (1.0 - math.cos(a)), self.bevel * math.sin(a)) for a in angles]

    def height(self, moved: np.ndarray) -> np.ndarray:
        """Return z in front of points that have moved inwards so far; behind it is the opposite."""
        inwards, up = np.array([(0.0, 0.0), *self.levels]).T
        height: np.ndarray = 0.5 * self.depth - self.bevel + np.interp(moved, inwards, up)
        return height


def solids(shapes: Sequence[OutlineShape], profile: Section) -> TriangleMesh:
    """Return the solids of shapes as one mesh; shapes that overlap are one solid.

    Raises UsageError for a bevel that is wider than their strokes take, with one that fits all.
    """
    polygons = polygons_of(shapely.unary_union([shape.region for shape in shapes]))
    try:
        return joined([extruded(polygon, profile) for polygon in polygons])
    except TooWideError:
        widest, narrow = _widest_bevel(polygons, profile)
    name = next(shape.name for shape in shapes if shape.region.intersects(narrow))
    rounded = float(f"{0.95 * widest:.2g}")
    if rounded == 0.0:
        raise UsageError(f"the outline of {name} touches itself. Separate it there, or leave it out.")
    raise UsageError(
        f"a bevel of {profile.bevel:g} is wider than the strokes of {name} take. Write bevel: {rounded:g}."
    )


def _widest_bevel(polygons: Sequence[Any], profile: Section) -> tuple[float, Any]:
    """Return the widest bevel that all polygons take, nearly, and the one that takes no more."""
    widest, narrow = profile.bevel, polygons[0]
    for polygon in polygons:
        if _takes(polygon, profile, widest):
            continue
        low, high, narrow = 0.0, widest, polygon
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if _takes(polygon, profile, middle) else (low, middle)
        widest = low
    return widest, narrow


def _takes(polygon: Any, profile: Section, bevel: float) -> bool:
    try:
        extruded(polygon, replace(profile, bevel=bevel))
    except TooWideError:
        return False
    return True


def extruded(polygon: Any, profile: Section) -> TriangleMesh:
    """Return the solid of a polygon, between z = -depth / 2 and depth / 2.

    Raises TooWideError where the bevel is wider than the polygon takes.
    """
    bevels = [bevelled(ring, [inwards for inwards, _ in profile.levels]) for ring in rings_of(polygon)]
    first = np.cumsum([0, *(len(bevel.points) for bevel in bevels)])[:-1]
    flat = np.array([point for bevel in bevels for point in bevel.points])
    z = profile.height(np.array([moved for bevel in bevels for moved in bevel.moved]))
    placed = list(zip(bevels, first.tolist(), strict=True))
    slopes = [[corner + start for corner in face] for bevel, start in placed for face in bevel.faces]
    cap = _cap(flat, [[vertex + start for vertex in bevel.rim] for bevel, start in placed])
    _require_flat([*slopes, *cap], flat, polygon.area)
    behind = len(flat)
    edges = [(i, (i + 1) % n, start) for n, start in ((b.count, s) for b, s in placed) for i in range(n)]
    walls = [[a + s + behind, b + s + behind, b + s, a + s] for a, b, s in edges]
    back = [[corner + behind for corner in face[::-1]] for face in [*slopes, *cap]]
    pieces = [piece for bevel in bevels for piece in bevel.pieces]
    front = [*pieces, *[CAP] * len(cap)]
    sides = np.array([*front, *front, *[WALL] * len(walls)])
    vertices = np.concatenate([np.column_stack([flat, z]), np.column_stack([flat, -z])])
    mesh, kept = contracted(vertices, [*slopes, *cap, *back, *walls])
    return creased(mesh, sides[kept])


def _cap(flat: np.ndarray, rims: Sequence[Sequence[int]]) -> list[list[int]]:
    """Return the triangles of the flat face within rims, counter-clockwise.

    Raises TooWideError where the rims meet.
    """
    shell, *holes = (flat[list(rim)] for rim in rims)
    inner = shapely.Polygon(shell, holes)
    if not inner.is_valid or not inner.exterior.is_ccw:
        raise TooWideError("its strokes are narrower than the bevel on both sides")
    number = {tuple(flat[v]): v for rim in rims for v in rim}
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(inner))
    corners = [shapely.get_coordinates(t.normalize())[2::-1] for t in triangles]  # normalized is clockwise
    return [[number[tuple(point)] for point in triangle] for triangle in corners]


def _require_flat(faces: Sequence[Sequence[int]], flat: np.ndarray, area: float) -> None:
    """Raise TooWideError where faces, seen from the front, do not cover the polygon once."""
    areas = [_area(flat[list(face)]) for face in faces]
    if min(areas) < -1e-9 * area or abs(sum(areas) - area) > 1e-6 * area:
        raise TooWideError("its strokes are narrower than the bevel on both sides")


def _area(points: np.ndarray) -> float:
    x, y = (points - points[0]).T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def contracted(vertices: np.ndarray, faces: Sequence[Sequence[int]]) -> tuple[PolygonMesh, np.ndarray]:
    """Return a mesh without edges that are shorter than SHORTEST, and which of the faces it keeps."""
    root = np.arange(len(vertices))
    shortest = SHORTEST * float(np.ptp(vertices, axis=0).max())
    ends = np.array([pair for face in faces for pair in zip(face, [*face[1:], face[0]], strict=True)])
    short = ends[np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1) < shortest]
    while (root[short[:, 0]] != root[short[:, 1]]).any():
        low = root[short].min(axis=1)
        for side in short.T:
            np.minimum.at(root, side, low)
            np.minimum.at(root, root[side], low)
    while (root[root] != root).any():
        root = root[root]
    rooted = [root[list(face)].tolist() for face in faces]
    corners = [[c for c, d in zip(face, [*face[1:], face[0]], strict=True) if c != d] for face in rooted]
    kept = np.flatnonzero([len(face) > 2 for face in corners])
    used, numbers = np.unique(np.concatenate([corners[i] for i in kept]), return_inverse=True)
    offsets = np.cumsum([0, *(len(corners[i]) for i in kept)])
    return PolygonMesh.from_arrays(vertices[used], offsets, numbers), kept


def creased(mesh: PolygonMesh, sides: np.ndarray) -> TriangleMesh:
    """Return the triangles of a closed mesh, with creases and seams.

    Creases are edges that turn by more than HARD, and the borders of caps and walls. Those between pieces of
    a round bevel are seams: they are kept, and shaded smoothly.

    sides  (F,) what each face belongs to: a piece of a bevel from 0, CAP or WALL
    """
    normals, twin, side = mesh.normals[mesh.owners], mesh.twins, sides[mesh.owners]
    is_border = side != side[twin]
    hard = (normals * normals[twin]).sum(axis=1) < math.cos(HARD)
    hard |= is_border & (np.minimum(side, side[twin]) < 0)
    creases, seams = (np.column_stack([mesh.corners[k], mesh.heads[k]]) for k in (hard, is_border & ~hard))
    return mesh.with_creases(creases).triangulated().with_seams(seams)


def joined(parts: Sequence[TriangleMesh]) -> TriangleMesh:
    """Return one mesh of several. Raises UsageError for none."""
    if not parts:
        raise UsageError("the outlines have no area at this size. Write another size.")
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    numbered = list(zip(parts, first, strict=False))
    return TriangleMesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + start for part, start in numbered]),
        creases=np.concatenate([part.creases + start for part, start in numbered]),
        seams=np.concatenate([part.seams + start for part, start in numbered]),
    )
