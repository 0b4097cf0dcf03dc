"""Vectors as parameters, and arrays of points as the kernels take them."""

from __future__ import annotations

import math

import numpy as np

from pipeline.arrays import Floats, Points
from pipeline.errors import UsageError

Vector = tuple[float, float, float]

X: Vector = (1.0, 0.0, 0.0)
Y: Vector = (0.0, 1.0, 0.0)
Z: Vector = (0.0, 0.0, 1.0)
ORIGIN: Vector = (0.0, 0.0, 0.0)


def unit(axis: Vector) -> Vector:
    """Return the axis with length 1. Raises UsageError where it has no direction."""
    length = math.hypot(*axis)
    if not (length > 1e-12 and math.isfinite(length)):
        raise UsageError(f"axis {axis} has no direction; write x, y, z or a vector such as [0, 1, 1]")
    x, y, z = axis
    return x / length, y / length, z / length


def across(axis: Vector, direction: Vector) -> Vector:
    """Return the part of a direction across an axis, with length 1. Raises UsageError where there is none."""
    (a, b, c), (x, y, z) = unit(axis), unit(direction)
    along = a * x + b * y + c * z
    return unit((x - along * a, y - along * b, z - along * c))


def transform(matrix: Floats, points: Points) -> Points:
    """Return matrix (3, 3) · each of points (N, 3), with bits that do not depend on the other points."""
    x, y, z = points.T[:, :, None]
    out: Points = x * matrix[:, 0] + y * matrix[:, 1] + z * matrix[:, 2]
    return out


def kernel_points(points: Points) -> Points:
    """Return points (N, 3) as the kernels' declared type: a read-only array would have another."""
    return np.require(points, np.float64, ["C", "W"])
