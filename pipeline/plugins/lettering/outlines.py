"""Outlines: curves as polylines, and the regions that contours enclose by the rules of fonts and of SVG."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import shapely
from fontTools.pens.basePen import BasePen

FillRule = Literal["nonzero", "evenodd"]

Transform = tuple[float, float, float, float, float, float]
"""Maps (x, y) to (a x + c y + e, b x + d y + f), in the order of SVG's matrix."""

IDENTITY: Transform = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0)

MOST_PIECES = 256
"""Segments of one Bézier curve at most."""

SPECK = 1e-9
"""Area over that of the region up to which a part is an error of rounding."""

GRID = 1e-6
"""The grid that regions lie on, over their extent: crossings closer together than that are one."""


@dataclass(frozen=True)
class OutlineShape:
    """A shape to extrude, such as a letter.

    name    for messages: its characters, or where it is in a drawing
    region  a shapely Polygon or MultiPolygon
    """

    name: str
    region: Any


class PolylinePen(BasePen):  # type: ignore[misc]  # fontTools has no types
    """Collects contours as polylines that keep within a tolerance of the curves.

    contours  float64 (N, 2) each; a closed one does not repeat its first point
    closed    whether each is closed
    """

    def __init__(self, transform: Transform, tolerance: float, glyphs: Any = None) -> None:
        super().__init__(glyphs)
        self._transform, self.tolerance = transform, tolerance
        self.contours: list[np.ndarray] = []
        self.closed: list[bool] = []
        self._points: list[tuple[float, float]] = []

    def _place(self, point: tuple[float, float]) -> tuple[float, float]:
        (x, y), (a, b, c, d, e, f) = point, self._transform
        return a * x + c * y + e, b * x + d * y + f

    def _moveTo(self, point: tuple[float, float]) -> None:  # noqa: N802  # BasePen calls it so
        self._points = [self._place(point)]

    def _lineTo(self, point: tuple[float, float]) -> None:  # noqa: N802
        self._points.append(self._place(point))

    def _curveToOne(self, *controls: tuple[float, float]) -> None:  # noqa: N802
        """Cut a cubic into pieces of equal parameter, by the bound of its second difference (Wang 1984)."""
        p = np.array([self._points[-1], *map(self._place, controls)])
        bend = np.linalg.norm(p[:-2] - 2.0 * p[1:-1] + p[2:], axis=1).max()
        pieces = min(max(math.ceil(math.sqrt(0.75 * bend / self.tolerance)), 1), MOST_PIECES)
        t = np.linspace(0.0, 1.0, pieces + 1)[1:, None]
        s = 1.0 - t
        cut = s**3 * p[0] + 3.0 * s * s * t * p[1] + 3.0 * s * t * t * p[2] + t**3 * p[3]
        self._points += map(tuple, cut)

    def _closePath(self) -> None:  # noqa: N802
        self._end(True)

    def _endPath(self) -> None:  # noqa: N802
        self._end(False)

    def _end(self, is_closed: bool) -> None:
        points = np.array(self._points)
        keep = np.ones(len(points), bool)
        keep[1:] = (points[1:] != points[:-1]).any(axis=1)
        points = points[keep]
        if is_closed and len(points) > 1 and (points[0] == points[-1]).all():
            points = points[:-1]
        self.contours.append(points)
        self.closed.append(is_closed)


def filled(contours: Sequence[np.ndarray], rule: FillRule) -> Any:
    """Return the region, a shapely Polygon or MultiPolygon, that contours (N, 2) fill; it may be empty.

    The contours may cross themselves and each other. All are cut where they cross, and each piece of the
    plane between them is in or out by how often they wind around it.
    """
    rings = [ring for ring in contours if len(ring) > 2]
    if not rings:
        return shapely.Polygon()
    lines = shapely.set_precision([shapely.LinearRing(ring) for ring in rings], _grid(np.concatenate(rings)))
    pieces = shapely.get_parts(shapely.polygonize([shapely.unary_union(lines)]))
    windings = sum(
        _winding(shapely.point_on_surface(pieces), shapely.get_coordinates(line)) for line in lines
    )
    is_in = windings != 0 if rule == "nonzero" else windings % 2 != 0
    return shapely.unary_union(pieces[is_in])


def _grid(points: np.ndarray) -> float:
    """Return the grid of a region: a power of two, so that rounding to it is exact."""
    return 2.0 ** round(math.log2(max(GRID * float(np.ptp(points, axis=0).max()), 1e-300)))


def _winding(points: np.ndarray, ring: np.ndarray) -> np.ndarray:
    """Return how often a ring (N, 2), closed, winds around points: crossings of a ray, signed."""
    if len(ring) < 2:
        return np.zeros(len(points), int)
    x, y = shapely.get_x(points)[:, None], shapely.get_y(points)[:, None]
    (x0, y0), (x1, y1) = ring[:-1].T, ring[1:].T
    side = (x1 - x0) * (y - y0) - (x - x0) * (y1 - y0)
    up, down = (y0 <= y) & (y1 > y) & (side > 0), (y0 > y) & (y1 <= y) & (side < 0)
    winding: np.ndarray = up.sum(axis=1) - down.sum(axis=1)
    return winding


def polygons_of(region: Any) -> list[Any]:
    """Return the polygons of a region, from left to right, and at the same place from below; no specks."""
    least = SPECK * shapely.area(region)
    parts = [part for part in shapely.get_parts(region) if part.geom_type == "Polygon" and part.area > least]
    return sorted(parts, key=lambda part: part.bounds)


def rings_of(polygon: Any) -> list[np.ndarray]:
    """Return the rings of a polygon (N, 2) with its inside on the left: the shell, then the holes."""
    rings = [polygon.exterior, *polygon.interiors]
    ccw = [shapely.get_coordinates(ring)[:-1] for ring in rings]
    turned = [
        points if ring.is_ccw == (i == 0) else points[::-1]
        for i, (ring, points) in enumerate(zip(rings, ccw, strict=True))
    ]
    return [without_straight(points) for points in turned]


def without_straight(points: np.ndarray) -> np.ndarray:
    """Return a ring (N, 2) without the points that lie on the line between their neighbours."""
    before, after = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    scale = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    kept = points[np.abs(cross) > 1e-7 * scale]
    return kept if len(kept) > 2 else points
