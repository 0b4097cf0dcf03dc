"""The faces around a vertex, laid out in a row: what every local decision looks at.

A ring is one row of an int32 matrix and, beside it, one of normals. Spoke i runs from the centre to
`vertex[i]`; face i lies between spokes i and i + 1. A closed ring has as many faces as spokes, an open
one a spoke more.
"""

from __future__ import annotations

from typing import NamedTuple

import numba

from pipeline.arrays import Floats, Indices
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
    preceding,
)
from pipeline.resample._kernels_lists import area_vector

MOST_SPOKES = 512


class Ring(NamedTuple):
    """Scratch for one vertex and its surroundings."""

    leaving: Indices  # (MOST_SPOKES,) half-edge of spoke i, in face i
    vertex: Indices  # (MOST_SPOKES,) the other end of spoke i
    normals: Floats  # (MOST_SPOKES, 3) area vector of face i
    hard: Indices  # (MOST_SPOKES,) 1 where spoke i is a hard edge
    size: Indices  # (3,) faces, spokes, hard spokes
    place: Floats  # (3,) where the centre might move


RING = numba.types.NamedTuple([INTS, INTS, MATRIX, INTS, INTS, VECTOR], Ring)


@kernel(numba.boolean(MATRIX, numba.int64, numba.int64, numba.float64), **LEAN)
def turned(normals: Floats, i: int, j: int, cosine: float) -> bool:
    """Whether two faces meet at more than the angle of that cosine. A face without area decides nothing."""
    dot = normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1] + normals[i, 2] * normals[j, 2]
    m = normals[i, 0] ** 2 + normals[i, 1] ** 2 + normals[i, 2] ** 2
    n = normals[j, 0] ** 2 + normals[j, 1] ** 2 + normals[j, 2] ** 2
    return bool(dot * abs(dot) < cosine * abs(cosine) * (m * n))  # squares that keep their signs


@kernel(numba.boolean(SURFACE, numba.int64, RING), **LEAN)
def walk(surface: Surface, h: int, ring: Ring) -> bool:
    """Lay out spokes and faces around the start of h; false where there are too many."""
    vert, twin = surface.vert, surface.twin
    first = k = h
    n = 0
    while n + 1 < MOST_SPOKES:
        ring.leaving[n] = k
        ring.vertex[n] = vert[following(k)]
        n += 1
        back = preceding(k)
        k = twin[back]
        if k == first:
            ring.size[0], ring.size[1] = n, n
            return True
        if k < 0 and twin[first] >= 0:  # an open fan, to be laid out from its other end
            first = k = fan_start(twin, h)
            n = 0
        elif k < 0:
            ring.vertex[n] = vert[back]
            ring.size[0], ring.size[1] = n, n + 1
            return True
    return False


@kernel((SURFACE, numba.int64, RING, numba.float64), **LEAN)
def weigh(surface: Surface, centre: int, ring: Ring, cosine: float) -> None:
    """Fill in the normals and which spokes are hard (P29); a boundary edge counts as hard."""
    faces, spokes = ring.size[0], ring.size[1]
    for i in range(faces):
        b = ring.vertex[i]
        c = ring.vertex[i + 1] if i + 1 < spokes else ring.vertex[0]
        x, y, z = area_vector(surface.points, centre, b, c)
        ring.normals[i, 0], ring.normals[i, 1], ring.normals[i, 2] = x, y, z
    count = 0
    for i in range(spokes):
        edge = spokes > faces and (i == 0 or i == faces)
        hard = edge or turned(ring.normals, i - 1 if i > 0 else faces - 1, i, cosine)
        ring.hard[i] = 1 if hard else 0
        count += ring.hard[i]
    ring.size[2] = count
