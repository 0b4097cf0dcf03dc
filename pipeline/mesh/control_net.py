"""How the control points of a net are laid out: rows and columns, each of which may close to a ring."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import AnyArray, Faces, Floats, Points
from pipeline.errors import MeshError, UsageError

LEAST = 4
"""Points along each side: what one piece of a cubic is made of."""


@dataclass(frozen=True)
class Lattice:
    """Points in rows, of which those of a row follow each other: point (i, j) is the (i · columns + j)th.

    rows, columns  how many there are; 4 at least
    closed         whether the first row follows the last one, and the first column the last

    The front of a net is where going from row to row, then from column to column, turns counter-clockwise.

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
        """How many points there are."""
        return self.rows * self.columns

    def faces(self) -> Faces:
        """(F, 3) the net itself as triangles, two for each of its cells."""
        return grid_faces(self.rows, self.columns, self.closed)

    def as_array(self) -> AnyArray:
        """int32 (4,): rows, columns, and 1 for each way that is closed."""
        return np.array([self.rows, self.columns, *self.closed], np.int32)

    @classmethod
    def from_array(cls, numbers: AnyArray) -> Lattice:
        """What `as_array` was called on. Raises MeshError where it was nothing."""
        if numbers.shape != (4,):
            raise MeshError(f"a net is told by 4 numbers, not by {numbers.shape}; it is no frame of ours")
        rows, columns, around, across = numbers.tolist()
        return cls(rows, columns, (bool(around), bool(across)))


def grid_faces(rows: int, columns: int, closed: tuple[bool, bool]) -> Faces:
    """(F, 3) triangles over points in rows, two a cell; closed sides share their points."""
    i = np.arange(rows if closed[0] else rows - 1)[:, None]
    j = np.arange(columns if closed[1] else columns - 1)[None, :]
    below, above = i * columns, (i + 1) % rows * columns
    after = (j + 1) % columns
    corners = np.stack([below + j, above + j, above + after, below + after], axis=-1).reshape(-1, 4)
    return corners[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3).astype(np.int32)


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
