"""Control nets: the layout of their points, and nets with the surface of a sheet, a tube or a torus."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import AnyArray, Faces, Floats, Points
from pipeline.errors import MeshError, UsageError

LEAST = 4
"""Points along each side: the support of one cubic piece."""


@dataclass(frozen=True)
class Lattice:
    """Layout of control points in rows, one row after the other: point (i, j) is number i · columns + j.

    rows, columns  their numbers; at least 4
    closed         True where the first row follows the last one, and where the first column does

    The front of a net is the side from which the turn from the row to the column direction is
    counter-clockwise.

    Raises MeshError for fewer rows or columns.
    """

    rows: int
    columns: int
    closed: tuple[bool, bool] = (False, False)

    def __post_init__(self) -> None:
        if min(self.rows, self.columns) < LEAST:
            raise MeshError(
                f"a net of {self.rows} × {self.columns} points is too small; a bicubic patch needs "
                f"{LEAST} × {LEAST}. Add rows or columns."
            )

    def __len__(self) -> int:
        """Return the number of points."""
        return self.rows * self.columns

    def faces(self) -> Faces:
        """Return the net as triangles (F, 3), two for each of its cells."""
        return grid_faces(self.rows, self.columns, self.closed)

    def as_array(self) -> AnyArray:
        """Return int32 (4,): rows, columns, and 1 for each closed direction."""
        return np.array([self.rows, self.columns, *self.closed], np.int32)

    @classmethod
    def from_array(cls, numbers: AnyArray) -> Lattice:
        """Return the lattice of an `as_array`. Raises MeshError for other arrays."""
        if numbers.shape != (4,):
            raise MeshError(
                f"a net has shape {numbers.shape}; it must be 4 numbers: rows, columns and what is closed"
            )
        rows, columns, around, across = numbers.tolist()
        return cls(rows, columns, (bool(around), bool(across)))


def grid_faces(rows: int, columns: int, closed: tuple[bool, bool]) -> Faces:
    """Return triangles (F, 3) over points in rows, two a cell; closed sides share their points."""
    i = np.arange(rows if closed[0] else rows - 1)[:, None]
    j = np.arange(columns if closed[1] else columns - 1)[None, :]
    below, above = i * columns, (i + 1) % rows * columns
    after = (j + 1) % columns
    corners = np.stack([below + j, above + j, above + after, below + after], axis=-1).reshape(-1, 4)
    return corners[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3).astype(np.int32)


Net = tuple[Points, Lattice]


def sheet_net(size: tuple[float, float], rows: int, columns: int) -> Net:
    """Return a rectangle in the plane y = 0 that faces upwards. `size` is along x and z; rows run along x."""
    z, x = _line(size[1], rows), _line(size[0], columns)
    points = np.zeros((rows, columns, 3))
    points[..., 2], points[..., 0] = z[:, None], x[None, :]
    return points.reshape(-1, 3), Lattice(rows, columns)


def tube_net(length: float, radius: float, rows: int, columns: int) -> Net:
    """Return an open tube along the y axis with this radius at the columns; rows run around it."""
    points = np.empty((rows, columns, 3))
    points[..., 1] = _line(length, rows)[:, None]
    points[..., 0], points[..., 2] = _ring(radius, columns)
    return points.reshape(-1, 3), Lattice(rows, columns, (False, True))


def torus_net(radius: float, tube_radius: float, rows: int, columns: int) -> Net:
    """Return a ring around the y axis; rows run around the axis, columns around the tube.

    Raises UsageError where the tube is as thick as the ring is wide.
    """
    if tube_radius >= radius:
        raise UsageError(
            f"tube_radius {tube_radius:g} must be below radius {radius:g}, or the ring intersects itself"
        )
    away, height = _ring(tube_radius, rows)
    cos, sin = _ring(1.0, columns)
    points = np.empty((rows, columns, 3))
    points[..., 0] = (radius + away)[:, None] * cos
    points[..., 1] = height[:, None]
    points[..., 2] = (radius + away)[:, None] * sin
    return points.reshape(-1, 3), Lattice(rows, columns, (True, True))


def _line(extent: float, count: int) -> Floats:
    """Return points evenly on a line, one beyond each end, so that an open cubic spans the extent."""
    return extent * ((np.arange(count) - 1.0) / (count - 3) - 0.5)


def _ring(radius: float, count: int) -> tuple[Floats, Floats]:
    """Return cosine and sine of a circle enlarged so that a closed cubic through it has the radius.

    At its points the cubic takes a sixth of each neighbour and four sixths of the point: (4 + 2 cos step) / 6
    of the circle.
    """
    step = 2.0 * math.pi / count
    angle = step * np.arange(count)
    outer = radius * 3.0 / (2.0 + math.cos(step))
    return outer * np.cos(angle), outer * np.sin(angle)
