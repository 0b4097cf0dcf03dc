"""Control nets that have the surface of a sheet, a tube or a torus, about the origin and facing outwards."""

from __future__ import annotations

import math

import numpy as np

from pipeline.arrays import Floats, Points
from pipeline.errors import UsageError
from pipeline.mesh.lattice import Lattice

Net = tuple[Points, Lattice]


def sheet_net(size: tuple[float, float], rows: int, columns: int) -> Net:
    """A rectangle in the plane y = 0 that faces upwards. `size` is along x and z; rows go along x."""
    z, x = _line(size[1], rows), _line(size[0], columns)
    points = np.zeros((rows, columns, 3))
    points[..., 2], points[..., 0] = z[:, None], x[None, :]
    return points.reshape(-1, 3), Lattice(rows, columns)


def tube_net(length: float, radius: float, rows: int, columns: int) -> Net:
    """An open tube along the y axis; rows go around it. It has the radius where columns are."""
    points = np.empty((rows, columns, 3))
    points[..., 1] = _line(length, rows)[:, None]
    points[..., 0], points[..., 2] = _ring(radius, columns)
    return points.reshape(-1, 3), Lattice(rows, columns, (False, True))


def torus_net(radius: float, tube_radius: float, rows: int, columns: int) -> Net:
    """A ring around the y axis; rows go around the axis, columns around the tube.

    Raises UsageError where the tube is as thick as the ring is wide.
    """
    if tube_radius >= radius:
        raise UsageError(
            f"tube_radius {tube_radius:g} must be below radius {radius:g}, or the ring meets itself"
        )
    away, height = _ring(tube_radius, rows)
    cos, sin = _ring(1.0, columns)
    points = np.empty((rows, columns, 3))
    points[..., 0] = (radius + away)[:, None] * cos
    points[..., 1] = height[:, None]
    points[..., 2] = (radius + away)[:, None] * sin
    return points.reshape(-1, 3), Lattice(rows, columns, (True, True))


def _line(extent: float, count: int) -> Floats:
    """Points evenly on a line, one beyond each end of it: a cubic with open ends is as long as the extent."""
    return extent * ((np.arange(count) - 1.0) / (count - 3) - 0.5)


def _ring(radius: float, count: int) -> tuple[Floats, Floats]:
    """Points on a circle so much larger that a closed cubic has the radius at its points; cosine and sine.

    There it is a sixth of the neighbours and four sixths of the point: (4 + 2 cos step) / 6 of the circle.
    """
    step = 2.0 * math.pi / count
    angle = step * np.arange(count)
    outer = radius * 3.0 / (2.0 + math.cos(step))
    return outer * np.cos(angle), outer * np.sin(angle)
