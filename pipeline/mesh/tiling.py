"""Flat pieces cut into triangles, and joined where their borders coincide."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pipeline.arrays import Faces, Points
from pipeline.errors import UsageError


def square_grid(m: int, n: int) -> tuple[Points, Faces]:
    """(m + 1)(n + 1) points of the unit square and its triangles, whose diagonals alternate."""
    i, j = (part.reshape(-1) for part in np.meshgrid(np.arange(m), np.arange(n), indexing="ij"))
    a, b = i * (n + 1) + j, (i + 1) * (n + 1) + j
    quads = np.column_stack([a, b, b + 1, a + 1])
    quads[(i + j) % 2 == 1] = np.roll(quads[(i + j) % 2 == 1], 1, axis=1)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    u, v = np.meshgrid(np.arange(m + 1) / m, np.arange(n + 1) / n, indexing="ij")
    return np.column_stack([u.reshape(-1), v.reshape(-1)]), faces.astype(np.int32)


def welded(parts: Sequence[tuple[Points, Faces]]) -> tuple[Points, Faces]:
    """Join patches whose borders coincide, to within rounding, on points of about unit size."""
    points = np.concatenate([p for p, _ in parts])
    starts = np.cumsum([0, *(len(p) for p, _ in parts[:-1])])
    faces = np.concatenate([f + s for (_, f), s in zip(parts, starts, strict=True)])
    _, first, joined = np.unique(np.round(points * 2**30), axis=0, return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(first))
    return points[np.sort(first)], order[joined.reshape(-1)][faces].astype(np.int32)


def cut_into(side: float, edge_length: float | None) -> int:
    """Into how many a side is cut, for edges no longer than this; 1 without a length."""
    if edge_length is None:
        return 1
    positive("edge_length", np.array([edge_length]))
    return max(1, math.ceil(side / edge_length - 1e-9))


def positive(name: str, values: Points) -> None:
    """Raises UsageError where one of the lengths (N,) is none."""
    if not (np.isfinite(values).all() and (values > 0).all()):
        raise UsageError(
            f"{name} {', '.join(f'{v:g}' for v in values)} must be positive lengths in scene units"
        )
