"""Start shapes of letters: for each part a drop, or rings with as many holes, of the part's volume."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely

from flowsculpt import TriangleMesh, icosphere
from flowsculpt.pipeline.plugins.lettering.extrusion import Section, extruded, joined
from flowsculpt.pipeline.plugins.lettering.outlines import OutlineShape, polygons_of

TUBE = 0.4
"""Radius of a ring's tube over that of the ring."""

ARC = 12
"""Pieces of a quarter of a ring."""


def starts(shapes: Sequence[OutlineShape], depth: float) -> TriangleMesh:
    """Return the surfaces that solids of shapes begin as, each in the middle of its part."""
    polygons = polygons_of(shapely.unary_union([shape.region for shape in shapes]))
    return joined([_start(polygon, depth) for polygon in polygons])


def _start(polygon: Any, depth: float) -> TriangleMesh:
    left, low, right, high = polygon.bounds
    middle = np.array([0.5 * (left + right), 0.5 * (low + high), 0.0])
    volume, holes = polygon.area * depth, len(polygon.interiors)
    if holes:
        radius = (volume / (holes * 2.0 * math.pi**2 * TUBE**2)) ** (1.0 / 3.0)
        mesh = _rings(holes, radius, _direction(polygon))
    else:
        mesh = icosphere(16, (0.75 * volume / math.pi) ** (1.0 / 3.0))
    return TriangleMesh(mesh.vertices + middle, mesh.faces)


def _direction(polygon: Any) -> np.ndarray:
    """Return the direction (2,) from the first hole of a polygon to the last; x for one hole."""
    holes = [shapely.Polygon(ring).centroid for ring in polygon.interiors]
    middles = shapely.get_coordinates(holes)
    along = middles[-1] - middles[0]
    length = float(np.linalg.norm(along))
    return along / length if length else np.array([1.0, 0.0])


def _rings(holes: int, radius: float, direction: np.ndarray) -> TriangleMesh:
    """Return rings around the z axis that share their tubes, side by side: one, a lying eight, and so on."""
    tube = TUBE * radius
    places = 2.0 * radius * np.outer(np.arange(holes) - 0.5 * (holes - 1), direction)
    discs = shapely.unary_union(shapely.buffer(shapely.points(places), radius + tube, quad_segs=ARC))
    smooth = discs.buffer(radius, quad_segs=ARC).buffer(-radius, quad_segs=ARC)  # fills the waists
    inner = shapely.unary_union(shapely.buffer(shapely.points(places), radius - tube, quad_segs=ARC))
    mesh = extruded(smooth.difference(inner), Section(2.0 * tube, 0.96 * tube, "round", 6))
    return TriangleMesh(mesh.vertices, mesh.faces)
