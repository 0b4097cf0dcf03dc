"""Axes and centres, as all families take them."""

from __future__ import annotations

import math

from pipeline.errors import UsageError
from pipeline.flow.keyframes import Vector

X: Vector = (1.0, 0.0, 0.0)
Y: Vector = (0.0, 1.0, 0.0)
Z: Vector = (0.0, 0.0, 1.0)
ORIGIN: Vector = (0.0, 0.0, 0.0)


def unit(axis: Vector) -> Vector:
    """The axis with length 1. Raises UsageError where it has no direction."""
    length = math.hypot(*axis)
    if not (length > 1e-12 and math.isfinite(length)):
        raise UsageError(f"axis {axis} has no direction; write x, y, z or a vector such as [0, 1, 1]")
    x, y, z = axis
    return x / length, y / length, z / length


def across(axis: Vector, direction: Vector) -> Vector:
    """The part of a direction across an axis, with length 1. Raises UsageError where there is none."""
    (a, b, c), (x, y, z) = unit(axis), unit(direction)
    along = a * x + b * y + c * z
    return unit((x - along * a, y - along * b, z - along * c))
