"""Placing the new vertices of a pass nowhere that folds, and what becomes of the edges around them."""

from __future__ import annotations

import numba

from pipeline.arrays import AnyArray, Floats, Indices, Points
from pipeline.kernels import kernel
from pipeline.mesh._kernels_halfedge import (
    BYTES,
    INTS,
    MATRIX,
    SURFACE,
    VECTOR,
    Surface,
    preceding,
)
from pipeline.resample._kernels_lists import CHANGES, Changes, push, sort_out
from pipeline.resample._kernels_patch import arriving
from pipeline.resample._kernels_rest import moved_at_rest
from pipeline.resample._kernels_ring import RING, Ring, folds, walk, weigh_faces
from pipeline.resample._kernels_split import LEAVING

MOST_AROUND = (
    12  # spokes of a new vertex: two of its own edge, two medians, and its neighbours' in the same pass
)
_SWEEPS = 3
_ASTRAY = -0.5  # cosine: around a place that is known to be right, faces may turn by 120 degrees
_TABLE = numba.int32[:, ::1]


@kernel(numba.int64(SURFACE, INTS, RING, MATRIX, MATRIX, VECTOR, BYTES))
def settle(
    surface: Surface,
    spokes: Indices,
    ring: Ring,
    places: Points,
    goals: Points,
    limits: Floats,
    settled: AnyArray,
) -> int:
    """Move the vertices that `spokes` leave to their places, but none where a face would fold; answers how
    many.

    Where vertices have places at rest, these become `goals`, and no face may turn over there either. Refused
    ones are tried again when all others have moved, since it may be those they ran into.
    """
    done = 0
    for _ in range(_SWEEPS):
        before = done
        for i in range(len(spokes)):
            middle = surface.vert[spokes[i]]
            if settled[i] or not walk(surface, spokes[i], ring):
                continue
            weigh_faces(surface, middle, ring)
            for k in range(3):
                ring.place[k] = places[i, k]
            if folds(surface.points, ring, -1, ring.place, _ASTRAY):
                continue
            if not moved_at_rest(surface.carried, ring, middle, goals, i, limits):
                continue
            for k in range(3):
                surface.points[middle, k] = places[i, k]
            settled[i] = 1
            done += 1
        if done == before:
            break
    return done


@kernel((SURFACE, _TABLE, VECTOR, INTS, INTS, CHANGES))
def long_around(
    surface: Surface, births: Indices, limits: Floats, listed: Indices, longs: Indices, changes: Changes
) -> None:
    """List the edges of `listed` and those at the new vertices that are too long, now that they moved.

    Those that became short are enlisted.
    """
    twin = surface.twin
    for i in range(1, listed[0] + 1):
        push(longs, listed[i])
    for i in range(len(births)):
        first = k = births[i, LEAVING]
        while True:
            sort_out(surface, k, limits, longs, changes)
            k = twin[preceding(k)]
            if k < 0 or k == first:
                break
        if k < 0:  # of a boundary's two edges at the vertex, the one that no spoke has led along
            sort_out(surface, arriving(surface, births[i, LEAVING], births[i, 0]), limits, longs, changes)
