"""Which way faces look at rest: no step may turn one over, or the surface would come back pleated."""

from __future__ import annotations

import numba
import numpy as np

from pipeline.arrays import Floats, Indices, Points
from pipeline.kernels import kernel
from pipeline.mesh._kernels_halfedge import INTS, LEAN, MATRIX, SURFACE, VECTOR, Surface, following
from pipeline.resample._kernels_ring import RING, Ring, walk

MOST_BLADES = 8
_BLADES = numba.int32[:, :, ::1]
_ONE, _TWO = np.uint64(1), np.uint64(2)


@kernel(numba.float64(MATRIX, VECTOR, numba.int64, numba.int64, numba.int64), **LEAN)
def upright(carried: Points, limits: Floats, a: int, b: int, c: int) -> float:
    """Positive where the triangle abc looks outwards at rest, by the normals that its corners have there."""
    i, j, k = np.uint64(a), np.uint64(b), np.uint64(c)
    m, o = np.uint64(limits[7]), np.uint64(limits[8])
    x, y, z = carried[i, m], carried[i, m + _ONE], carried[i, m + _TWO]
    ux, uy, uz = carried[j, m] - x, carried[j, m + _ONE] - y, carried[j, m + _TWO] - z
    vx, vy, vz = carried[k, m] - x, carried[k, m + _ONE] - y, carried[k, m + _TWO] - z
    nx = carried[i, o] + carried[j, o] + carried[k, o]
    ny = carried[i, o + _ONE] + carried[j, o + _ONE] + carried[k, o + _ONE]
    nz = carried[i, o + _TWO] + carried[j, o + _TWO] + carried[k, o + _TWO]
    return float((uy * vz - uz * vy) * nx + (uz * vx - ux * vz) * ny + (ux * vy - uy * vx) * nz)


@kernel(numba.boolean(MATRIX, RING, numba.int64, numba.int64, VECTOR), **LEAN)
def overturns(carried: Points, ring: Ring, centre: int, other: int, limits: Floats) -> bool:
    """Whether a face of the ring that looks outwards at rest would not, if its centre merged into `other`."""
    for i in range(ring.size[0]):
        b, c = ring.vertex[i], ring.vertex[i + 1]
        if b == other or c == other:
            continue
        if upright(carried, limits, other, b, c) <= 0 and upright(carried, limits, centre, b, c) > 0:
            return True
    return False


@kernel(numba.int64(MATRIX, RING, numba.int64, VECTOR), **LEAN)
def _inwards(carried: Points, ring: Ring, centre: int, limits: Floats) -> int:
    """How many faces of the ring look inwards at rest."""
    count = 0
    for i in range(ring.size[0]):
        b, c = ring.vertex[i], ring.vertex[i + 1]
        count += upright(carried, limits, centre, b, c) <= 0
    return count


@kernel(numba.boolean(MATRIX, RING, numba.int64, MATRIX, numba.int64, VECTOR), **LEAN)
def moved_at_rest(carried: Points, ring: Ring, centre: int, goals: Points, i: int, limits: Floats) -> bool:
    """Move the ring's centre to goals[i] at rest, if no more faces then look inwards there; answers whether
    it went. Where nothing is known of rest it may go, and stays."""
    column = int(limits[7])
    if column < 0:
        return True
    before = _inwards(carried, ring, centre, limits)
    x, y, z = carried[centre, column], carried[centre, column + 1], carried[centre, column + 2]
    for k in range(3):
        carried[centre, column + k] = goals[i, k]
    if _inwards(carried, ring, centre, limits) <= before:
        return True
    carried[centre, column], carried[centre, column + 1], carried[centre, column + 2] = x, y, z
    return False


@kernel(numba.int64(SURFACE, numba.int64, numba.int64, INTS))
def spokes_of_marked(surface: Surface, halfedges: int, column: int, spokes: Indices) -> int:
    """A half-edge that leaves each vertex whose attribute in `column` is not zero; answers how many."""
    vert, carried, count = surface.vert, surface.carried, 0
    for h in range(halfedges):
        v = np.uint64(vert[h])
        if carried[v, column] == 1.0:
            spokes[count] = h
            count += 1
            carried[v, column] = 2.0  # seen
    for i in range(count):
        carried[vert[spokes[i]], column] = 1.0
    return count


@kernel((SURFACE, INTS, RING, _BLADES))
def blades(surface: Surface, spokes: Indices, ring: Ring, found: Indices) -> None:
    """Fill found (N, MOST_BLADES, 2) with the other two corners of the faces around the start of each spoke.

    On a crease or a boundary a vertex must stay there: it gets the edges that lead along it, each as twice
    the same corner. Rows that are not needed hold -1; faces beyond the eighth are left out.
    """
    for i in range(len(spokes)):
        found[i] = -1
        if not walk(surface, spokes[i], ring):  # crowded: along the spoke
            found[i, 0] = surface.vert[following(spokes[i])]
            continue
        faces, rim, many = ring.size[0], ring.size[1], 0
        for k in range(rim):
            edge = rim > faces and (k == 0 or k == faces)
            if many < MOST_BLADES and (edge or (k < faces and surface.tagged[ring.leaving[k]] > 0)):
                found[i, many] = ring.vertex[k]
                many += 1
        for k in range(min(MOST_BLADES, faces) if many == 0 else 0):
            found[i, k, 0] = ring.vertex[k]
            found[i, k, 1] = ring.vertex[k + 1]
