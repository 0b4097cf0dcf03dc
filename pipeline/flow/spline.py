"""A smooth curve through given points."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Points, Vectors


def catmull_rom(points: Points, closed: bool, pieces: int) -> tuple[Points, Vectors]:
    """Points on the curve through `points` (P, 3), `pieces` for each span, and its unit tangents there.

    Between neighbours the curve is a cubic whose slope at each point is half the way from the point before
    to the one after; at the ends of an open curve it is the way to the only neighbour. Of a closed curve the
    first point stands once more at the end.

    Source: Catmull & Rom, *A Class of Local Interpolating Splines*, 1974.
    """
    if closed:
        points = np.concatenate([points[-1:], points, points[:2]])
    else:
        points = np.concatenate([2.0 * points[:1] - points[1:2], points, 2.0 * points[-1:] - points[-2:-1]])
    slopes = 0.5 * (points[2:] - points[:-2])
    here, there, leaves, arrives = points[1:-2, None], points[2:-1, None], slopes[:-1, None], slopes[1:, None]
    s = (np.arange(pieces) / pieces)[None, :, None]
    curve = (
        (2 * s**3 - 3 * s**2 + 1) * here
        + (s**3 - 2 * s**2 + s) * leaves
        + (3 * s**2 - 2 * s**3) * there
        + (s**3 - s**2) * arrives
    )
    tangent = (
        (6 * s**2 - 6 * s) * (here - there) + (3 * s**2 - 4 * s + 1) * leaves + (3 * s**2 - 2 * s) * arrives
    )
    curve = np.concatenate([curve.reshape(-1, 3), points[-2:-1]])
    tangent = np.concatenate([tangent.reshape(-1, 3), slopes[-1:]])
    return curve, tangent / np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-300)
