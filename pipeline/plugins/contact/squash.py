"""The maps of space that squash a subject above a floor, or above another subject, and their inverses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.contact.heights import Heights


class Squash(NamedTuple):
    """A map that squashes what would be below a floor into a zone above it.

    With v the depth below the top of the zone, κ the strength and Y the height after the map,

        Y = top − v/√(1 + κ² v²)        Y' = (1 + κ² v²)^(−3/2)

    The derivatives up to the second are those of the identity at v = 0. κ is such that the lowest point of
    the subject arrives at the floor. A point below that one, at v = V + w, follows

        Y = base + margin² / (margin + Y'(V) w)        base = floor − margin

    so that none passes the base. Where volume is kept, distances from a vertical axis are multiplied by
    1/√Y', and the determinant of the Jacobian is 1 down to V. Below, they are multiplied as at V.

    top     height of the zone's upper end, units
    base    height that no point reaches, `margin` below the floor
    margin  units, above 0
    span    V, units: from the top down to the lowest point of the subject
    bend    κ, 1/units: 0 where nothing is squashed
    axis    x and z of the axis, units
    spreads  True where volume is kept
    """

    top: float
    base: float
    margin: float
    span: float
    bend: float
    axis: tuple[float, float]
    spreads: bool

    @classmethod
    def of(
        cls,
        floor: float,
        softness: float,
        margin: float,
        lowest: float,
        axis: tuple[float, float] = (0.0, 0.0),
        spreads: bool = True,
    ) -> Squash:
        """Return the squash of a subject whose lowest point is at `lowest`, in a zone of `softness`."""
        depth = max(0.0, floor - lowest)
        span = softness + depth
        bend = math.sqrt((span / softness) ** 2 - 1.0) / span
        return cls(floor + softness, floor - margin, margin, span, bend, axis, spreads)

    def numbers(self, undoes: bool) -> tuple[float, ...]:
        """Return the numbers of the compiled function `squash`, for the map or for its inverse."""
        return (*self[:5], *self.axis, float(self.spreads), float(undoes))

    def apply(self, points: Floats) -> Floats:
        """Return points (N, 3) after the map: a new array."""
        return _moved(points, *self.kernel_row(undoes=False))

    def undo(self, points: Floats) -> Floats:
        """Return the points (N, 3) that `apply` moves to `points`; NaN at or below the base."""
        return _moved(points, *self.kernel_row(undoes=True))

    def kernel_row(self, undoes: bool) -> Any:
        """Return the compiled function of the map or of its inverse, and its numbers."""
        # imported here, as shots are read without numba
        from flowsculpt.pipeline.plugins.contact.squash_kernels import squash

        return squash, self.numbers(undoes)


@dataclass(frozen=True)
class Press:
    """A map that squashes above another subject, as `Squash` does above a floor at height 0.

    Points are seen along three axes: a, up, away from the other subject, and b. With h(a, b) the height of
    the other subject, the map takes (a, up − h(a, b), b) through the squash and adds the height again at the
    place reached. Both shears keep volumes, so the determinant of the Jacobian is that of the squash.

    axes     (3, 3) rows a, up and b, orthonormal
    heights  of the other subject
    squash   its floor is at 0
    lowest   the height of the lowest point; `softness` below it, the heights level out, which bounds slopes
    softness  of the subject, units
    """

    axes: Floats
    heights: Heights
    squash: Squash
    lowest: float
    softness: float

    def apply(self, points: Floats) -> Floats:
        """Return points (N, 3) after the map: a new array."""
        return _moved(points, *self.kernel_row(undoes=False))

    def undo(self, points: Floats) -> Floats:
        """Return the points (N, 3) that `apply` moves to `points`; NaN within the other subject."""
        return _moved(points, *self.kernel_row(undoes=True))

    def kernel_row(self, undoes: bool) -> Any:
        """Return the compiled function of the map or of its inverse, and its numbers."""
        from flowsculpt.pipeline.plugins.contact.squash_kernels import press

        addresses = (float(each.ctypes.data) for each in (self._numbers, self.heights.numbers))
        return press, (*addresses, float(len(self.heights.numbers)), float(undoes))

    @cached_property
    def _numbers(self) -> Floats:
        """The numbers that the compiled function reads: see LEVEL in its module."""
        level = [self.lowest - self.softness, self.softness]
        return np.concatenate([self.squash.numbers(undoes=False), self.axes.ravel(), level])


def _moved(points: Floats, kernel: Any, numbers: tuple[float, ...]) -> Floats:
    rows = np.ascontiguousarray(points.T, np.float64)
    moves = np.zeros_like(rows)
    kernel(np.array(numbers), rows, 0.0, moves)
    return np.ascontiguousarray((rows + moves).T)
