"""Solids and sheets as meshes with near-uniform triangles, faces outwards; and the grids they are made of."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from flowsculpt.pipeline.arrays import AnyArray, Faces, Floats, Points
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.mesh.meshes import PolygonMesh, TriangleMesh

ORIGIN = (0.0, 0.0, 0.0)


def box(
    size: ArrayLike = (2.0, 2.0, 2.0), edge_length: float | None = None, centre: ArrayLike = ORIGIN
) -> TriangleMesh:
    """Return a box with crisp edges along the axes.

    size         full extents in x, y and z, or one number for a cube
    edge_length  the sides are cut into squares no larger than this; without it, one square a side
    """
    extents = np.broadcast_to(np.asarray(size, np.float64), 3)
    positive("size", extents)
    counts = [cut_into(side, edge_length) for side in extents]
    parts = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        grid, faces = square_grid(counts[u], counts[v])
        for side in (1.0, -1.0):
            points = np.empty((len(grid), 3))
            points[:, u], points[:, v] = grid.T - 0.5
            points[:, axis] = 0.5 * side
            parts.append((points, faces if side > 0 else faces[:, ::-1]))
    points, faces = welded(parts)
    return TriangleMesh(points * extents + np.asarray(centre, np.float64), faces)


def sheet(
    size: tuple[float, float] = (2.0, 2.0), edge_length: float | None = None, centre: ArrayLike = ORIGIN
) -> TriangleMesh:
    """Return a flat rectangle in the plane y = 0 that faces upwards.

    size         along x and z
    edge_length  it is cut into squares no larger than this; without it, one square
    """
    extents = np.asarray(size, np.float64)
    positive("size", extents)
    grid, faces = square_grid(cut_into(extents[1], edge_length), cut_into(extents[0], edge_length))
    points = np.zeros((len(grid), 3))
    points[:, 2], points[:, 0] = (grid.T - 0.5) * extents[::-1, None]
    return TriangleMesh(points + np.asarray(centre, np.float64), faces)


def icosphere(frequency: int = 8, radius: float = 1.0, centre: ArrayLike = ORIGIN) -> TriangleMesh:
    """Return a geodesic sphere of 10 frequency² + 2 vertices.

    frequency  parts into which the edges of an icosahedron are cut
    """
    if frequency < 1:
        raise UsageError(f"frequency {frequency} must be at least 1; 16 gives a sphere of 2562 vertices")
    positive("radius", np.array([radius]))
    corners, triangles = _icosahedron()
    steps, pattern = _triangle_grid(frequency)
    points, faces = welded([(steps @ corners[t], pattern) for t in triangles])
    points *= radius / np.linalg.norm(points, axis=1, keepdims=True)
    return TriangleMesh(points + np.asarray(centre, np.float64), faces)


def torus(
    radius: float = 1.0, tube_radius: float = 0.4, edge_length: float = 0.1, centre: ArrayLike = ORIGIN
) -> TriangleMesh:
    """Return a ring around the y axis.

    radius       from the axis to the middle of the tube, more than `tube_radius` (UsageError otherwise)
    edge_length  of its triangles, about
    """
    positive("radius and tube_radius", np.array([radius, tube_radius, edge_length]))
    if tube_radius >= radius:
        raise UsageError(
            f"tube_radius {tube_radius:g} must be below radius {radius:g}, or the ring intersects itself"
        )
    around = max(6, math.ceil(2 * math.pi * tube_radius / (edge_length * math.sqrt(0.75))))
    angle = 2 * math.pi * np.arange(around) / around
    profile = np.column_stack([radius + tube_radius * np.cos(angle), tube_radius * np.sin(angle)])
    return _revolve([*profile, profile[0]], edge_length, centre)


def rod(
    length: float = 3.0,
    radius: float = 0.5,
    edge_length: float = 0.1,
    caps: str = "round",
    centre: ArrayLike = ORIGIN,
) -> TriangleMesh:
    """Return a bar along the y axis.

    length       with its caps
    edge_length  of its triangles, about
    caps         "round" or "flat"
    """
    positive("length, radius and edge_length", np.array([length, radius, edge_length]))
    if caps not in ("round", "flat"):
        raise UsageError(f"caps {caps!r} must be 'round' or 'flat'")
    if caps == "round" and length < 2 * radius:
        raise UsageError(
            f"length {length:g} leaves no room for round caps of radius {radius:g}; write 'flat'"
        )
    step = edge_length * math.sqrt(0.75)
    if caps == "round":
        turns = max(2, math.ceil(0.5 * math.pi * radius / step))
        angle = 0.5 * math.pi * np.arange(turns + 1) / turns
        cap = np.column_stack([radius * np.sin(angle), -radius * np.cos(angle) - (0.5 * length - radius)])
    else:
        rings = max(2, math.ceil(radius / step))
        cap = np.column_stack([np.linspace(0, radius, rings + 1), np.full(rings + 1, -0.5 * length)])
    straight = length - 2 * radius if caps == "round" else length
    pieces = max(1, math.ceil(straight / step))
    heights = cap[-1, 1] + straight * np.arange(1, pieces) / pieces
    side = np.column_stack([np.full(pieces - 1, radius), heights])
    upper = (cap * (1, -1))[::-1]
    if straight == 0:
        upper = upper[1:]
    return _revolve([*cap, *side, *upper], edge_length, centre)


def _revolve(profile: Sequence[Points], edge_length: float, centre: ArrayLike) -> TriangleMesh:
    """Return rings around y through the (radius, height) rows of a profile that ascends on the outside.

    Each ring has as many vertices as its circumference needs, so triangles keep their shape towards the
    poles. A profile that returns to its first row closes a ring of rings; otherwise both ends are poles.
    """
    closed = bool(np.array_equal(profile[0], profile[-1]))
    rings: list[tuple[AnyArray, Floats]] = []
    points, start = [], 0
    for row, (radius, height) in enumerate(profile[:-1] if closed else profile):
        pole = not closed and row in (0, len(profile) - 1)
        count = 1 if pole else max(5, round(2 * math.pi * radius / edge_length))
        angle = 2 * math.pi * (np.arange(count) + 0.5 * (row % 2)) / count
        points.append(
            np.column_stack([radius * np.cos(angle), np.full(count, height), radius * np.sin(angle)])
        )
        if pole:
            points[-1][:, [0, 2]] = 0.0
        rings.append((np.arange(start, start + count), angle))
        start += count
    pairs = list(zip(rings, rings[1:] + (rings[:1] if closed else []), strict=False))
    faces = [_zip_rings(*below, *above) for below, above in pairs]
    return TriangleMesh(np.concatenate(points) + np.asarray(centre, np.float64), np.concatenate(faces))


def _zip_rings(low: AnyArray, low_angle: Floats, high: AnyArray, high_angle: Floats) -> Faces:
    """Return triangles between two rings, always taking the next vertex that comes first around the axis."""
    m, n = len(low), len(high)
    faces, i, j = [], 0, 0
    while i < (m if m > 1 else 0) or j < (n if n > 1 else 0):
        next_low = low_angle[0] + 2 * math.pi * (i + 0.5) / m
        next_high = high_angle[0] + 2 * math.pi * (j + 0.5) / n
        if n == 1 or j == n or (m > 1 and i < m and next_low <= next_high):
            faces.append((low[i % m], high[j % n], low[(i + 1) % m]))
            i += 1
        else:
            faces.append((low[i % m], high[j % n], high[(j + 1) % n]))
            j += 1
    return np.array(faces, np.int32)


def _triangle_grid(n: int) -> tuple[Points, Faces]:
    """Return barycentric points of a triangle cut into n² smaller ones, and their corners."""
    rows = [(i, j) for i in range(n + 1) for j in range(n + 1 - i)]
    at = {cell: k for k, cell in enumerate(rows)}
    upright = [(at[i, j], at[i + 1, j], at[i, j + 1]) for i, j in rows if i + j < n]
    turned = [(at[i + 1, j], at[i + 1, j + 1], at[i, j + 1]) for i, j in rows if i + j < n - 1]
    steps = np.array(rows, np.float64) / n
    return np.column_stack([1 - steps.sum(axis=1), steps]), np.array(upright + turned, np.int32)


def _icosahedron() -> tuple[Points, Faces]:
    """Return two poles and two rings of five, the upper one turned by 36 degrees."""
    turn = 2 * math.pi * np.arange(5) / 5
    height, girth = 1 / math.sqrt(5), 2 / math.sqrt(5)
    upper = np.column_stack([girth * np.cos(turn), np.full(5, height), -girth * np.sin(turn)])
    lower = np.column_stack(
        [girth * np.cos(turn + 0.2 * math.pi), np.full(5, -height), -girth * np.sin(turn + 0.2 * math.pi)]
    )
    points = np.vstack([[0, 1, 0], upper, lower, [0, -1, 0]])
    faces = []
    for k in range(5):
        u, u1, w, w1 = 1 + k, 1 + (k + 1) % 5, 6 + k, 6 + (k + 1) % 5
        faces += [(0, u, u1), (u, w, u1), (u1, w, w1), (11, w1, w)]
    return points, np.array(faces, np.int32)


_SIDES = [(4, 6, 7, 5), (0, 1, 3, 2), (2, 3, 7, 6), (0, 4, 5, 1), (1, 5, 7, 3), (0, 2, 6, 4)]


def six_sided_box(size: ArrayLike) -> PolygonMesh:
    """Return a box of six quadrilaterals around the origin; `size` holds its full extents (P20)."""
    corners = np.array(list(product((-0.5, 0.5), repeat=3)))
    return PolygonMesh(corners * np.asarray(size, np.float64), _SIDES)


def one_sided_sheet(size: ArrayLike) -> PolygonMesh:
    """Return one quadrilateral in the plane y = 0 that faces upwards; `size` is along x and z (P20)."""
    half = 0.5 * np.asarray(size, np.float64)
    corners = np.zeros((4, 3))
    corners[:, (0, 2)] = half * [(-1, -1), (-1, 1), (1, 1), (1, -1)]
    return PolygonMesh(corners, [range(4)])


def square_grid(m: int, n: int) -> tuple[Points, Faces]:
    """Return (m + 1)(n + 1) points of the unit square and its triangles, whose diagonals alternate."""
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
    """Return the number of parts of a side for edges no longer than `edge_length`; 1 without a length."""
    if edge_length is None:
        return 1
    positive("edge_length", np.array([edge_length]))
    return max(1, math.ceil(side / edge_length - 1e-9))


def positive(name: str, values: Points) -> None:
    """Raise UsageError unless all lengths (N,) are finite and positive."""
    if not (np.isfinite(values).all() and (values > 0).all()):
        raise UsageError(
            f"{name} {', '.join(f'{v:g}' for v in values)} must be positive lengths in scene units"
        )
