"""Triangles, segments and points in a tree of boxes, as the kernels search it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pipeline.arrays import AnyArray, Floats

LEAF = 6
"""The most triangles in a leaf."""


@dataclass(frozen=True, eq=False)
class TriangleTree:
    """The flat array of `kernels.nearest`: boxes, then triangles.

    memory     float64, all of it; further numbers may follow
    triangles  start of the triangles in it
    order      (T,) the index of each among the given triangles
    ranges     (B, 2) the first of the triangles in each box, and the one after its last
    """

    memory: Floats
    triangles: int
    order: AnyArray = field(repr=False)
    ranges: AnyArray = field(repr=False)

    @classmethod
    def of(cls, corners: Floats) -> TriangleTree:
        """Build the tree of corners (T, 3, 3), T at least 1, by halving boxes across their longest side."""
        centres, order = corners.mean(axis=1), np.arange(len(corners))
        boxes: list[list[float]] = []
        ranges: list[tuple[int, int]] = []
        stack: list[tuple[int, int, int]] = [(0, len(corners), -1)]
        while stack:
            first, last, parent = stack.pop()
            members = order[first:last]
            if parent >= 0:
                boxes[parent][6] = float(len(boxes))  # the second child; the first follows its parent
            around = corners[members].reshape(-1, 3)
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
            box[7], index, middle = 0.0, len(boxes) - 1, (first + last) // 2
            axis = int(np.argmax(np.ptp(centres[members], axis=0)))
            order[first:last] = members[np.argsort(centres[members, axis], kind="stable")]
            stack += [(middle, last, index), (first, middle, -1)]
        memory = np.concatenate([np.array(boxes).ravel(), corners[order].ravel()])
        return cls(memory, 8 * len(boxes), order, np.array(ranges))

    def with_more(self, numbers: Floats) -> Floats:
        """Return the array with numbers appended to its triangles."""
        return np.concatenate([self.memory, numbers.ravel()])


def segments(points: Floats, closed: bool = False) -> Floats:
    """Return the segments between points (P, 3) as triangles (P − 1, 3, 3), or (P, 3, 3) where closed.

    A single point becomes a triangle without extent.
    """
    if len(points) == 1:
        return np.repeat(points[None], 3, axis=1)
    ends = np.roll(points, -1, axis=0)
    pairs = np.stack([points, ends, ends], axis=1)
    return pairs if closed else pairs[:-1]
