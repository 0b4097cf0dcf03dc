"""The paint of a model: what its file has on its faces, found again on a surface that has been resampled.

The resampler keeps the rest position of every vertex. So texture coordinates need not be carried along: a
corner takes those of the nearest point of the model at rest. The model is cut into charts, in each of which a
position has one pair of texture coordinates, one colour and one material. A face belongs to the chart that is
nearest to its middle, and its corners look for their nearest points in that chart alone, so nothing is
smeared across a seam. Seams are the edges between charts, and the resampler keeps them.

A chart that meets itself, as a map of the whole globe does at the date line, is cut in two: half way between
the texture coordinates that one position has there.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from flowsculpt import PolygonMesh
from flowsculpt.api.materials import PaintedFaces
from flowsculpt.api.meshes import Floats, Indices, connected_components, edge_keys, find_coincident

if TYPE_CHECKING:
    from flowsculpt.api.flows import TriangleTree

_STEPS = 1e-5
"""Texture coordinates and colours that differ by less are the same."""

_MOST_CUTS = 32


@dataclass(frozen=True, eq=False)
class ModelPaint:
    """The painted triangles of a model.

    points       float64 (V, 3) of the file
    corners      int64 (T, 3): the points at the corners of the triangles
    coordinates  float64 (T, 3, 2): texture coordinates, 0 to 1 to the right and upwards
    materials    int64 (T,): numbers of materials
    colours      linear Rec.709 reflectances, float32 (T, 3, 3), or None
    charts       int64 (T,)
    place        float64 (V, 3): the points where the shot has them at rest
    """

    points: Floats
    corners: np.ndarray
    coordinates: Floats
    materials: np.ndarray
    colours: np.ndarray | None
    charts: np.ndarray
    place: Floats

    @classmethod
    def of(
        cls,
        points: Floats,
        sides: np.ndarray,
        corners: np.ndarray,
        coordinates: Floats,
        materials: np.ndarray,
        colours: np.ndarray | None = None,
    ) -> ModelPaint:
        """Cut polygons into triangles and charts.

        points       (V, 3)
        sides        (F,): numbers of corners of the polygons, 3 at least
        corners      (C,): the points at the corners, polygon by polygon
        coordinates  (C, 2)
        materials    (F,)
        colours      (C, 3) linear Rec.709, or None
        """
        offsets = np.concatenate([[0], np.cumsum(sides)]).astype(np.int32)
        apart = np.arange(len(corners), dtype=np.int32)
        triangles = PolygonMesh.from_arrays(points[corners], offsets, apart).triangulated().faces
        materials = np.repeat(materials, sides - 2).astype(np.int64)
        rows = coordinates if colours is None else np.column_stack([coordinates, colours])
        _, alike = np.unique(np.round(rows / _STEPS), axis=0, return_inverse=True)
        joined = find_coincident(points, np.ones(len(points), bool))[corners]
        charts = _charts(joined[triangles], alike.reshape(-1)[triangles], coordinates[triangles], materials)
        of_corners = None if colours is None else colours[triangles].astype(np.float32)
        return cls(points, corners[triangles], coordinates[triangles], materials, of_corners, charts, points)

    @classmethod
    def unpacked(cls, content: bytes) -> ModelPaint:
        """Return the paint whose arguments of `of` were turned into bytes by `packed_arrays`."""
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            return cls.of(**arrays)

    def placed(self, place: Floats) -> ModelPaint:
        """Return the paint with its points (V, 3) where a shot has them at rest."""
        return replace(self, place=place)

    def seams(self, vertices: Floats, edges: Indices) -> Indices:
        """Return those edges (of E, 2) between charts of a surface whose vertices are points of `place`."""
        both = np.concatenate([self.place, vertices])
        joined = find_coincident(both, np.ones(len(both), bool))
        keys, chart = _sides(joined[self.corners], self.charts)
        order = np.lexsort([chart, keys])
        differs = (np.diff(keys[order]) == 0) & (np.diff(chart[order]) != 0)
        at_seam = keys[order][1:][differs]
        return edges[np.isin(edge_keys(joined[len(self.points) :][edges]), at_seam)]

    def on_faces(self, rest: Floats, faces: Indices) -> PaintedFaces:
        """Return the paint of faces (F, 3) of vertices with rest positions (V, 3)."""
        middles = np.ascontiguousarray(rest[faces].mean(axis=1), np.float64)
        triangle, _ = self._nearest(middles, np.full(len(faces), len(self._trees) - 1))
        chart = self.charts[triangle]
        codes, corner = np.unique(
            faces.astype(np.int64) * (self.charts.max() + 1) + chart[:, None], return_inverse=True
        )
        vertex, wanted = np.divmod(codes, self.charts.max() + 1)
        found, shares = self._nearest(np.ascontiguousarray(rest[vertex], np.float64), wanted)
        weights = np.column_stack([1.0 - shares.sum(axis=1), shares])
        corner = corner.reshape(-1, 3)
        coordinates = np.einsum("nc,ncx->nx", weights, self.coordinates[found])[corner]
        colours = None
        if self.colours is not None:
            colours = np.einsum("nc,ncx->nx", weights, self.colours[found])[corner].astype(np.float32)
        return PaintedFaces(coordinates, chart, self.materials[triangle], colours)

    @cached_property
    def _trees(self) -> list[tuple[np.ndarray, TriangleTree]]:
        """The triangles (T,) of each chart, and at last all of them, with their trees."""
        from flowsculpt.api.flows import TriangleTree  # processes that read files need no numba

        by_chart = np.split(np.argsort(self.charts, kind="stable"), np.cumsum(np.bincount(self.charts))[:-1])
        parts = [*by_chart, np.arange(len(self.charts))]
        return [(part, TriangleTree.of(self.place[self.corners[part]])) for part in parts]

    def _nearest(self, points: Floats, wanted: np.ndarray) -> tuple[np.ndarray, Floats]:
        """Return the nearest triangles (N,) of the trees with numbers `wanted` (N,), and shares (N, 2).

        The shares are those of their last two corners.
        """
        found, shares = np.empty(len(points), np.int64), np.zeros((len(points), 2))
        order = np.argsort(wanted, kind="stable")
        for rows in np.split(order, np.flatnonzero(np.diff(wanted[order])) + 1):
            if len(rows):
                part, tree = self._trees[wanted[rows[0]]]
                triangle, shares[rows] = tree.nearest(points[rows])
                found[rows] = part[triangle]
        return found, shares


class PaintParts:
    """Collects the painted meshes of a scene; `has_colours` tells whether one has colours of its own."""

    def __init__(self) -> None:
        self.has_colours = False
        self._vertices = 0
        self._colours: list[np.ndarray | None] = []
        self._arrays: dict[str, list[np.ndarray]] = {
            "points": [np.empty((0, 3))],
            "sides": [np.empty(0, np.int64)],
            "corners": [np.empty(0, np.int64)],
            "coordinates": [np.empty((0, 2))],
            "materials": [np.empty(0, np.int64)],
        }

    def add(
        self,
        points: Floats,
        sides: np.ndarray,
        corners: np.ndarray,
        coordinates: Floats,
        materials: np.ndarray,
        colours: Floats | None,
    ) -> None:
        """Add a mesh, by the arguments of `ModelPaint.of`; its corners count its own points."""
        added = (points, sides, corners + self._vertices, coordinates, materials)
        for held, values in zip(self._arrays.values(), added, strict=True):
            held.append(values)
        self._vertices += len(points)
        self._colours.append(colours)
        self.has_colours |= colours is not None

    def arrays(self, plain: Callable[[], np.ndarray]) -> dict[str, np.ndarray]:
        """Return the arguments of `ModelPaint.of`.

        plain  returns the colours (M, 3) of materials, for meshes without colours where others have some
        """
        found = {name: np.concatenate(parts) for name, parts in self._arrays.items()}
        if not self.has_colours:
            return found
        of_materials, colours = plain(), list[np.ndarray]()
        meshes = zip(self._arrays["sides"][1:], self._arrays["materials"][1:], self._colours, strict=True)
        for sides, materials, own in meshes:
            colours.append(of_materials[np.repeat(materials, sides)] if own is None else own)
        return {**found, "colours": np.concatenate(colours)}


def _sides(corners: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the edge keys (3T,) of the sides of triangles, and the values (T,) of their triangles."""
    ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
    return edge_keys(ends), np.repeat(values, 3)


def _charts(corners: np.ndarray, alike: np.ndarray, coordinates: Floats, materials: np.ndarray) -> np.ndarray:
    """Return the charts (T,) of triangles, numbered from 0.

    corners  (T, 3): positions of corners, by number
    alike    (T, 3): what is painted there, by number
    """
    ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
    paint = np.stack([alike, np.roll(alike, -1, axis=1)], axis=2).reshape(-1, 2)
    turned = ends[:, 0] > ends[:, 1]
    paint[turned] = paint[turned, ::-1]
    rows = np.column_stack([edge_keys(ends), paint, np.repeat(materials, 3)])
    order = np.lexsort(rows.T[::-1])
    same = (np.diff(rows[order], axis=0) == 0).all(axis=1)
    owner = order // 3
    charts = connected_components(len(corners), owner[:-1][same], owner[1:][same])
    return _without_touching(charts, corners, alike, coordinates)


def _without_touching(
    charts: np.ndarray, corners: np.ndarray, alike: np.ndarray, coordinates: Floats
) -> np.ndarray:
    """Cut charts in which a position is painted in several ways, until none is left.

    Where a position has more than two, as the pole of a globe, its triangles become charts of their own.
    Otherwise the whole chart is cut.
    """
    middles = coordinates.mean(axis=1)
    for _ in range(_MOST_CUTS):
        _, charts = np.unique(charts, return_inverse=True)
        charts = charts.reshape(-1)
        rows = np.column_stack([np.repeat(charts, 3), corners.reshape(-1), alike.reshape(-1)])
        rows, first, row = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        _, place, counts = np.unique(rows[:, :2], axis=0, return_inverse=True, return_counts=True)
        ways = counts[place.reshape(-1)]
        if (ways == 1).all():
            return charts
        row = row.reshape(-1, 3)
        most = np.argmax(ways[row], axis=1)
        own = row[np.arange(len(row)), most]
        if (at_pole := ways[own] > 2).any():
            charts = np.where(at_pole, charts.max() + 1 + own, charts)
            continue
        double = ways > 1
        chart, at = rows[double, 0], coordinates.reshape(-1, 2)[first[double]]
        low, high = np.full((charts.max() + 1, 2), np.inf), np.full((charts.max() + 1, 2), -np.inf)
        np.minimum.at(low, chart, at)
        np.maximum.at(high, chart, at)
        touches = np.isfinite(low[:, 0])
        low[~touches] = high[~touches] = 0.0
        axis = np.argmax(high - low, axis=1)
        cut = 0.5 * (low + high)[np.arange(len(low)), axis]
        beyond = touches[charts] & (middles[np.arange(len(charts)), axis[charts]] > cut[charts])
        charts = 2 * charts + beyond
    loose = np.zeros(charts.max() + 1, bool)
    loose[chart] = True
    alone = loose[charts // 2]
    return np.unique(np.where(alone, charts.max() + 1 + np.arange(len(charts)), charts), return_inverse=True)[
        1
    ]
