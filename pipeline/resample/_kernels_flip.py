"""Turning soft edges of touched faces so that angles get better; creases and the shape stay (P36)."""

from __future__ import annotations

import numba
import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices, Points
from pipeline.kernels import kernel
from pipeline.mesh._kernels_halfedge import (
    INTS,
    MATRIX,
    SURFACE,
    VECTOR,
    Surface,
    fan_start,
    following,
    join,
    preceding,
)
from pipeline.resample._kernels_lists import BYTES, area_vector, push, squared

_GAIN = 0.1  # cot α + cot β must be below minus this: a flip has to be worth the change of the surface
_FLAT = 0.94  # cosine of 20 degrees: how far the two faces may lean before and after
_ROUNDS = 4  # flips allowed for each edge listed at first


@kernel(numba.float64(MATRIX, numba.int64, numba.int64, numba.int64, numba.float64))
def _cotangent(points: Points, apex: int, a: int, b: int, area: float) -> float:
    """Cotangent of the angle at `apex` of a triangle with twice that area."""
    dot = 0.0
    for k in range(3):
        dot += (points[a, k] - points[apex, k]) * (points[b, k] - points[apex, k])
    return dot / area


@kernel(numba.boolean(SURFACE, numba.int64, numba.int64))
def _adjacent(surface: Surface, h: int, other: int) -> bool:
    """Whether an edge joins the start of h with `other`."""
    vert, twin = surface.vert, surface.twin
    first = fan_start(twin, h)
    k = first
    while True:
        if vert[following(k)] == other:
            return True
        back = preceding(k)
        k = twin[back]
        if k < 0:
            return bool(vert[back] == other)
        if k == first:
            return False


@kernel(numba.boolean(SURFACE, numba.int64, VECTOR))
def worth_flipping(surface: Surface, h: int, limits: Floats) -> bool:
    """Is the edge of h soft, not Delaunay, and its other diagonal a legal edge on the same surface?"""
    points, vert, twin = surface.points, surface.vert, surface.twin
    back = twin[h]
    a, b, c, d = vert[h], vert[following(h)], vert[preceding(h)], vert[preceding(back)]
    mx, my, mz = area_vector(points, a, b, c)
    nx, ny, nz = area_vector(points, b, a, d)
    m, n = np.sqrt(mx * mx + my * my + mz * mz), np.sqrt(nx * nx + ny * ny + nz * nz)
    if m == 0 or n == 0:
        return False
    if _cotangent(points, c, a, b, m) + _cotangent(points, d, a, b, n) > -_GAIN:
        return False
    if mx * nx + my * ny + mz * nz < max(_FLAT, limits[2]) * m * n:
        return False
    crossing = squared(points, c, d)
    if crossing > limits[0] or crossing < limits[1]:
        return False
    px, py, pz = area_vector(points, a, d, c)
    qx, qy, qz = area_vector(points, b, c, d)
    p, q = np.sqrt(px * px + py * py + pz * pz), np.sqrt(qx * qx + qy * qy + qz * qz)
    sx, sy, sz = mx + nx, my + ny, mz + nz
    s = np.sqrt(sx * sx + sy * sy + sz * sz)
    if px * sx + py * sy + pz * sz < _FLAT * p * s or qx * sx + qy * sy + qz * sz < _FLAT * q * s:
        return False
    return not _adjacent(surface, preceding(h), d)


@kernel((SURFACE, numba.int64))
def flip_edge(surface: Surface, h: int) -> None:
    """Turn the edge of h: a→b between c and d into d→c. Half-edges c→a and d→b keep their places."""
    vert, twin = surface.vert, surface.twin
    k = twin[h]
    h1, k1 = following(h), following(k)
    c, d = vert[preceding(h)], vert[preceding(k)]
    beside, beyond = twin[k1], twin[h1]
    vert[h1], vert[k1] = d, c
    join(twin, h, beside)
    join(twin, k, beyond)
    join(twin, h1, k1)


@kernel(numba.int64(SURFACE, numba.int64, VECTOR, BYTES, INTS))
def flip_marked(surface: Surface, faces: int, limits: Floats, marks: AnyArray, edges: Indices) -> int:
    """Flip what is worth it among the edges of marked faces, and then around each flip; clears the marks."""
    vert, twin = surface.vert, surface.twin
    edges[0] = 0
    for f in range(faces):
        if marks[f] == 0:
            continue
        if vert[3 * f] >= 0:
            for h in range(3 * f, 3 * f + 3):
                if twin[h] >= 0 and (h > twin[h] or marks[twin[h] // 3] == 0):
                    push(edges, h)
        marks[f] = 0
    flips, at, most = 0, 1, _ROUNDS * edges[0]
    while at <= edges[0]:
        h = edges[at]
        at += 1
        if twin[h] < 0 or flips >= most or not worth_flipping(surface, h, limits):
            continue
        k = twin[h]
        flip_edge(surface, h)
        flips += 1
        push(edges, h)
        push(edges, preceding(h))
        push(edges, k)
        push(edges, preceding(k))
    return flips
