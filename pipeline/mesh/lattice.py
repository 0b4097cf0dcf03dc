"""How the control points of a net are laid out: rows and columns, each of which may close to a ring."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import AnyArray, Faces
from pipeline.errors import MeshError

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
