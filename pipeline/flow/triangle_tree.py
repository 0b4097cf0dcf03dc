"""Triangles, segments and points in a tree of boxes, as the kernels search them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pipeline.arrays import AnyArray, Floats

LEAF = 6
"""Triangles in a box that is not halved any more."""


@dataclass(frozen=True, eq=False)
class TriangleTree:
    """The flat array of `_kernels_nearest`: boxes, then triangles.

    memory     float64, all of it; further numbers may follow
    triangles  where in it the triangles begin
    order      (T,) which of the given triangles each of them is
    ranges     (B, 2) the first of the triangles in each box, and the one after its last
    """

    memory: Floats
    triangles: int
    order: AnyArray = field(repr=False)
    ranges: AnyArray = field(repr=False)

    @classmethod
    def of(cls, corners: Floats) -> TriangleTree:
        """From corners (T, 3, 3), T at least 1. Each box is halved across its longest side, by number."""
        centres, order = corners.mean(axis=1), np.arange(len(corners))
        boxes: list[list[float]] = []
        ranges: list[tuple[int, int]] = []
        waiting: list[tuple[int, int, int]] = [(0, len(corners), -1)]
        while waiting:
            first, last, parent = waiting.pop()
            mine = order[first:last]
            if parent >= 0:
                boxes[parent][6] = float(len(boxes))  # the second child; the first stands right behind
            around = corners[mine].reshape(-1, 3)
            box = [
                *around.min(axis=0).tolist(),
                *around.max(axis=0).tolist(),
                float(first),
                float(last - first),
            ]
            boxes.append(box)
            ranges.append((first, last))
            if last - first <= LEAF:
                continue
            box[7], me, middle = 0.0, len(boxes) - 1, (first + last) // 2
            axis = int(np.argmax(np.ptp(centres[mine], axis=0)))
            order[first:last] = mine[np.argsort(centres[mine, axis], kind="stable")]
            waiting += [(middle, last, me), (first, middle, -1)]
        memory = np.concatenate([np.array(boxes).ravel(), corners[order].ravel()])
        return cls(memory, 8 * len(boxes), order, np.array(ranges))

    def with_more(self, numbers: Floats) -> Floats:
        """The array with numbers behind its triangles."""
        return np.concatenate([self.memory, numbers.ravel()])


def segments(points: Floats, closed: bool = False) -> Floats:
    """Triangles (P − 1, 3, 3), or (P, 3, 3) where closed, that are the segments between points (P, 3).

    A single point is a triangle of no size.
    """
    if len(points) == 1:
        return np.repeat(points[None], 3, axis=1)
    ends = np.roll(points, -1, axis=0)
    pairs = np.stack([points, ends, ends], axis=1)
    return pairs if closed else pairs[:-1]
