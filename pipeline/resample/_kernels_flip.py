"""Turning soft edges of touched faces so that angles get better; creases and the shape stay (P36)."""

from __future__ import annotations

import numba
import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices, Points
from pipeline.kernels import kernel
from pipeline.mesh._kernels_halfedge import (
    INTS,
    LEAN,
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


@kernel(numba.float64(MATRIX, numba.int64, numba.int64, numba.int64), **LEAN)
def _openness(points: Points, apex: int, a: int, b: int) -> float:
    """Scalar product of the sides of a triangle that meet at `apex`: negative where the angle is obtuse."""
    x = (points[a, 0] - points[apex, 0]) * (points[b, 0] - points[apex, 0])
    y = (points[a, 1] - points[apex, 1]) * (points[b, 1] - points[apex, 1])
    z = (points[a, 2] - points[apex, 2]) * (points[b, 2] - points[apex, 2])
    return float(x + y + z)


@kernel(numba.boolean(SURFACE, numba.int64, numba.int64), **LEAN)
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


@kernel(numba.boolean(SURFACE, numba.int64, VECTOR), **LEAN)
def worth_flipping(surface: Surface, h: int, limits: Floats) -> bool:
    """Is the edge of h soft, not Delaunay, and its other diagonal a legal edge on the same surface?"""
    points, vert, twin = surface.points, surface.vert, surface.twin
    back = twin[h]
    a, b, c, d = vert[h], vert[following(h)], vert[preceding(h)], vert[preceding(back)]
    at_c, at_d = _openness(points, c, a, b), _openness(points, d, a, b)
    if at_c >= 0 and at_d >= 0:
        return False
    mx, my, mz = area_vector(points, a, b, c)
    nx, ny, nz = area_vector(points, b, a, d)
    m, n = np.sqrt(mx * mx + my * my + mz * mz), np.sqrt(nx * nx + ny * ny + nz * nz)
    if m == 0 or n == 0:
        return False
    if at_c / m + at_d / n > -_GAIN:
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


@kernel((SURFACE, numba.int64), **LEAN)
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


@kernel(numba.int64(SURFACE, numba.int64, VECTOR, INTS), **LEAN)
def _try_flip(surface: Surface, h: int, limits: Floats, again: Indices) -> int:
    """Flip the edge of h if it is worth it, and list the four edges around for another look."""
    k = surface.twin[h]
    if k < 0 or not worth_flipping(surface, h, limits):
        return 0
    flip_edge(surface, h)
    push(again, h)
    push(again, preceding(h))
    push(again, k)
    push(again, preceding(k))
    return 1


@kernel(numba.int64(SURFACE, numba.int64, VECTOR, BYTES, INTS), **LEAN)
def flip_marked(surface: Surface, faces: int, limits: Floats, marks: AnyArray, again: Indices) -> int:
    """Flip what is worth it among the edges of marked faces, and then around each flip; clears the marks.

    `again` is scratch. Flips on a curved surface might chase each other for ever, so their number is
    bounded by that of the edges looked at.
    """
    vert, twin = surface.vert, surface.twin
    again[0] = 0
    flips, looks = 0, 0
    for f in range(faces):
        if marks[f] and vert[3 * f] >= 0:
            for h in range(3 * f, 3 * f + 3):
                if h > twin[h] or marks[twin[h] // 3] == 0:
                    looks += 1
                    flips += _try_flip(surface, h, limits, again)
    at = 1
    while at <= again[0] and flips < looks:
        flips += _try_flip(surface, again[at], limits, again)
        at += 1
    marks[:faces] = 0
    return flips
