"""Curves from which points are released, by their length from the start."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flowsculpt.api.meshes import Floats

_PARTS = 64  # of a segment of a smooth curve, whose lengths are summed


@dataclass(frozen=True, eq=False)
class SeedCurve:
    """A curve through points.

    through    float64 (N, 3), two or more, no two neighbours alike
    is_closed  True if it returns from the last point to the first
    is_smooth  True: a Catmull-Rom spline; False: straight from point to point
    """

    through: Floats
    is_closed: bool = False
    is_smooth: bool = False

    @cached_property
    def length(self) -> float:
        return float(self._lengths[-1])

    def points(self, along: Floats) -> Floats:
        """Return points (N, 3) at lengths (N,) from the start."""
        where = np.interp(along, self._lengths, np.linspace(0.0, self._segments, len(self._lengths)))
        return self._at(where)

    @property
    def _segments(self) -> int:
        return len(self.through) if self.is_closed else len(self.through) - 1

    @cached_property
    def _lengths(self) -> Floats:
        """The length of the curve up to equal parts of its segments, from 0."""
        parts = (_PARTS if self.is_smooth else 1) * self._segments
        points = self._at(np.linspace(0.0, self._segments, parts + 1))
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])

    def _at(self, where: Floats) -> Floats:
        """Return points (N, 3) where segment k begins at k and ends at k + 1."""
        first = np.minimum(where.astype(np.int64), self._segments - 1)
        share = (where - first)[:, None]
        before, here, there, after = (self._knot(first + k) for k in (-1, 0, 1, 2))
        if not self.is_smooth:
            return np.asarray((1.0 - share) * here + share * there)
        slope, end = 0.5 * (there - before), 0.5 * (after - here)
        bend = 3.0 * (there - here) - 2.0 * slope - end
        return np.asarray(
            here + share * (slope + share * (bend + share * (slope + end - 2.0 * (there - here))))
        )

    def _knot(self, index: np.ndarray) -> Floats:
        """Return the points with these numbers; beyond an open end the curve goes straight on."""
        count = len(self.through)
        if self.is_closed:
            return self.through[index % count]
        inside = self.through[np.clip(index, 0, count - 1)]
        over = np.clip(index, 0, count - 1) - index
        one = np.where(
            over[:, None] > 0, self.through[1] - self.through[0], self.through[-2] - self.through[-1]
        )
        return np.asarray(inside - np.abs(over)[:, None] * one)


@dataclass(frozen=True, eq=False)
class SeedCircle:
    """A circle.

    centre  (3,)
    radius  units
    axes    (2, 3) two unit vectors in its plane at a right angle; it begins along the first, and goes on
            towards the second
    """

    centre: Floats
    radius: float
    axes: Floats
    is_closed: bool = True

    @property
    def length(self) -> float:
        return 2.0 * np.pi * self.radius

    def points(self, along: Floats) -> Floats:
        """Return points (N, 3) at lengths (N,) from the start."""
        angle = along / self.radius
        turned = np.column_stack([np.cos(angle), np.sin(angle)])
        return self.centre + self.radius * turned @ self.axes


Seeds = SeedCurve | SeedCircle
