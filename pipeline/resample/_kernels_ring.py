"""The faces around a vertex, laid out in a row: what every local decision looks at.

A ring is one row of an int32 matrix and, beside it, one of normals. Spoke i runs from the centre to
`vertex[i]`; face i lies between spokes i and i + 1. A closed ring has as many faces as spokes, an open
one a spoke more.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from pipeline.arrays import Floats, Indices, Points
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
from pipeline.resample._kernels_lists import area_vector, squared

MOST_SPOKES = 512
UPRIGHT = 0.2  # cosine: a face may turn by 78 degrees in one step, not more
_THIN = 0.02  # twice the area over the longest side squared; below it a face counts as a sliver


class Ring(NamedTuple):
    """Scratch for one vertex and its surroundings."""

    leaving: Indices  # (MOST_SPOKES,) half-edge of spoke i, in face i
    vertex: Indices  # (MOST_SPOKES,) the other end of spoke i
    normals: Floats  # (MOST_SPOKES, 3) area vector of face i
    hard: Indices  # (MOST_SPOKES,) 1 where spoke i is a hard edge
    size: Indices  # (3,) faces, spokes, hard spokes
    place: Floats  # (3,) where the centre might move


def new_ring() -> Ring:
    """Room for a ring."""
    return Ring(
        np.empty(MOST_SPOKES, np.int32),
        np.empty(MOST_SPOKES, np.int32),
        np.empty((MOST_SPOKES, 3)),
        np.empty(MOST_SPOKES, np.int32),
        np.zeros(3, np.int32),
        np.zeros(3),
    )


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


@kernel((SURFACE, numba.int64, RING), **LEAN)
def weigh_faces(surface: Surface, centre: int, ring: Ring) -> None:
    """Fill in the area vectors of the faces."""
    faces, spokes = ring.size[0], ring.size[1]
    for i in range(faces):
        b = ring.vertex[i]
        c = ring.vertex[i + 1] if i + 1 < spokes else ring.vertex[0]
        x, y, z = area_vector(surface.points, centre, b, c)
        ring.normals[i, 0], ring.normals[i, 1], ring.normals[i, 2] = x, y, z


@kernel((SURFACE, numba.int64, RING, numba.float64), **LEAN)
def weigh(surface: Surface, centre: int, ring: Ring, cosine: float) -> None:
    """Fill in the normals and which spokes are hard (P29); tagged edges (P31) and boundaries are."""
    faces, spokes = ring.size[0], ring.size[1]
    weigh_faces(surface, centre, ring)
    count = 0
    for i in range(spokes):
        edge = spokes > faces and (i == 0 or i == faces)
        tagged = i < faces and surface.tagged[ring.leaving[i]] > 0
        hard = edge or tagged or turned(ring.normals, i - 1 if i > 0 else faces - 1, i, cosine)
        ring.hard[i] = 1 if hard else 0
        count += ring.hard[i]
    ring.size[2] = count


@kernel(numba.boolean(MATRIX, RING, numba.int64, VECTOR, numba.float64), **LEAN)
def folds(points: Points, ring: Ring, other: int, place: Floats, cosine: float) -> bool:
    """Whether a face of the ring would turn too far or become a sliver if its centre moved to `place`.

    Too far is more than the angle of that cosine. Faces at the vertex `other`, which the centre may merge
    with, do not count. `weigh_faces` comes first.
    """
    faces, spokes = ring.size[0], ring.size[1]
    for i in range(faces):
        b = ring.vertex[i]
        c = ring.vertex[i + 1] if i + 1 < spokes else ring.vertex[0]
        if b == other or c == other:
            continue
        ux, uy, uz = points[b, 0] - place[0], points[b, 1] - place[1], points[b, 2] - place[2]
        vx, vy, vz = points[c, 0] - place[0], points[c, 1] - place[1], points[c, 2] - place[2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        new = nx * nx + ny * ny + nz * nz
        mx, my, mz = ring.normals[i, 0], ring.normals[i, 1], ring.normals[i, 2]
        old = mx * mx + my * my + mz * mz
        dot = nx * mx + ny * my + nz * mz
        if old > 0 and dot * abs(dot) < cosine * abs(cosine) * old * new:
            return True
        side = max(ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, squared(points, b, c))
        if new < _THIN * _THIN * side * side and new < old:
            return True
    return False
