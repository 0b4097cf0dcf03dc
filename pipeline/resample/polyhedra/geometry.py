"""Geometry of single faces: Newell normals, bounding boxes, distances."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pipeline.resample.polyhedra.polyhedron import Point


def newell(polygon: Sequence[Point]) -> Point:
    """Return the area vector of a polygon, bent or not: along its mean normal, twice as long as its area."""
    ox, oy, oz = polygon[0]
    nx = ny = nz = 0.0
    px, py, pz = polygon[1][0] - ox, polygon[1][1] - oy, polygon[1][2] - oz
    for x, y, z in polygon[2:]:
        qx, qy, qz = x - ox, y - oy, z - oz
        nx += py * qz - pz * qy
        ny += pz * qx - px * qz
        nz += px * qy - py * qx
        px, py, pz = qx, qy, qz
    return nx, ny, nz


def dot(a: Point, b: Point) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def norm(a: Point) -> float:
    """Return the length."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


def difference(a: Point, b: Point) -> Point:
    """Return the vector from b to a."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def between(a: Point, b: Point, share: float) -> Point:
    """Return the point on the line from a to b; `share` 0 is a, 1 is b."""
    return (a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share, a[2] + (b[2] - a[2]) * share)


def box(polygon: Sequence[Point]) -> tuple[int, float, float]:
    """Return the longest dimension of a polygon's bounding box (P17): axis, lowest, highest coordinate."""
    best, least, most = 0, 0.0, -1.0
    for axis in range(3):
        along = [point[axis] for point in polygon]
        low, high = min(along), max(along)
        if high - low > most - least:
            best, least, most = axis, low, high
    return best, least, most
