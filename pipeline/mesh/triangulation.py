"""Triangulate polygons without losing a vertex (P23)."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Faces, Floats, Indices, Points
from pipeline.mesh.kernels.triangulation import FORBIDDEN, triangulate_all, triangulate_polygon

Edge = tuple[int, int]


def triangulate(points: Points, offsets: Indices, corners: Indices) -> tuple[Faces, Indices]:
    """Cut polygons into the triangles with the smallest sum of cotangents, seen along each Newell normal.

    points   (V, 3)
    offsets  int32 (F + 1,): face f has the corners ``corners[offsets[f]:offsets[f + 1]]``
    corners  int32 (C,)

    Returns triangles (T, 3), face after face, and the faces (M,) that took a vertex in their middle, numbered
    from V on in this order. Those are faces where every other cut would double an edge of another face. The
    least sum prefers round triangles, turns no triangle over where the polygon is simple and nearly flat, and
    makes none without area from corners on a line, which polygons with split sides have many of. (Ear
    clipping does so in nearly every second convex polygon with points on its sides.)
    """
    triangles = np.empty((int((np.diff(offsets) - 2).sum()), 3), np.int32)
    if np.diff(offsets).max(initial=3) == 3:
        return corners.reshape(-1, 3).astype(np.int32), np.empty(0, np.int32)
    triangulate_all(points.copy(), offsets.copy(), corners.copy(), triangles)
    doubled = _doubled(triangles, offsets, corners)
    if not len(doubled):
        return triangles, np.empty(0, np.int32)
    return _recut(points, offsets, corners, triangles, doubled)


def _starts(offsets: Indices) -> Indices:
    """Return the start of each face's triangles, (F + 1,)."""
    starts: Indices = offsets - 2 * np.arange(len(offsets), dtype=np.int32)
    return starts


def _doubled(triangles: Faces, offsets: Indices, corners: Indices) -> Indices:
    """Return the faces with a side or diagonal that joins the same vertices as one of another face."""
    tails = triangles.reshape(-1).astype(np.int64)
    heads = np.roll(triangles, -1, axis=1).reshape(-1)
    keys = tails * (int(corners.max()) + 1) + heads
    _, first = np.unique(keys, return_index=True)
    again = np.ones(len(keys), bool)
    again[first] = False
    face = np.repeat(np.arange(len(offsets) - 1), 3 * (np.diff(offsets) - 2))
    # a diagonal runs both ways within its face, so it meets a doubled side whichever way that runs
    return np.unique(face[np.isin(keys, keys[again])]).astype(np.int32)


def _recut(
    points: Points, offsets: Indices, corners: Indices, triangles: Faces, doubled: Indices
) -> tuple[Faces, Indices]:
    """Cut the doubled faces again, one after the other, with regard to all edges there are."""
    starts, redo = _starts(offsets), set(doubled.tolist())
    taken: set[Edge] = set()
    for f in range(len(offsets) - 1):
        sides = corners[offsets[f] : offsets[f + 1]]
        taken.update(_edges(np.column_stack([sides, np.roll(sides, -1)])))
        if f not in redo:
            for turn in range(3):
                taken.update(_edges(np.roll(triangles[starts[f] : starts[f + 1]], turn, axis=1)[:, :2]))
    parts: list[Faces] = []
    filled: list[int] = []
    for f in range(len(offsets) - 1):
        part = triangles[starts[f] : starts[f + 1]]
        if f in redo:
            sides = corners[offsets[f] : offsets[f + 1]]
            part, cost = _cut(points[sides], sides, taken)
            if cost >= FORBIDDEN:
                centre = len(points) + len(filled)
                filled.append(f)
                part = np.column_stack([sides, np.roll(sides, -1), np.full(len(sides), centre)])
            for turn in range(3):
                taken.update(_edges(np.roll(part, turn, axis=1)[:, :2]))
        parts.append(part)
    return np.concatenate(parts).astype(np.int32), np.array(filled, np.int32)


def _cut(polygon: Floats, sides: Indices, taken: set[Edge]) -> tuple[Faces, float]:
    n = len(sides)
    closed = np.zeros((n, n), np.uint8)
    for i in range(n):
        for j in range(i + 2, n if i else n - 1):
            closed[i, j] = _edge(int(sides[i]), int(sides[j])) in taken
    local = np.empty((n - 2, 3), np.int32)
    cost = triangulate_polygon(np.ascontiguousarray(polygon), closed, local)
    return sides[local], cost


def _edge(a: int, b: int) -> Edge:
    return (a, b) if a < b else (b, a)


def _edges(pairs: Indices) -> list[Edge]:
    return [_edge(a, b) for a, b in pairs.tolist()]
