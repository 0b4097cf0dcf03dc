"""Move new vertices to their places where no face folds, and list the edges then outside their limits."""

from __future__ import annotations

import numba

from pipeline.arrays import AnyArray, Indices, Points
from pipeline.kernels import kernel
from pipeline.mesh.kernels.halfedge import BYTES, INTS, MATRIX, MESH_ARRAYS, MeshArrays, preceding
from pipeline.resample.kernels.curved_patches import incoming
from pipeline.resample.kernels.limits import CHANGES, LIMITS, Changes, Limits, classify_edge, push
from pipeline.resample.kernels.ring import RING, Ring, collect_ring, folds, measure_faces, move_at_rest
from pipeline.resample.kernels.split import BIRTH_HALFEDGE

MAX_SPOKES_OF_NEW = 12  # two of its own edge, two medians, and those of neighbours split in the same pass
_SWEEPS = 3
_MAX_TURN_COSINE = -0.5  # around a place known to be right faces may turn by 120 degrees
_TABLE = numba.int32[:, ::1]


@kernel(numba.int64(MESH_ARRAYS, INTS, RING, MATRIX, MATRIX, LIMITS, BYTES))
def place_vertices(
    mesh: MeshArrays,
    spokes: Indices,
    ring: Ring,
    places: Points,
    goals: Points,
    limits: Limits,
    placed: AnyArray,
) -> int:
    """Move the starts of `spokes` to their places, except where a face would fold; return the number moved.

    Where vertices have rest positions, these become `goals`, and no face may turn over at rest either.
    Refused vertices are tried again after the others have moved, since those may have been in the way.
    """
    done = 0
    for _ in range(_SWEEPS):
        before = done
        for i in range(len(spokes)):
            middle = mesh.vert[spokes[i]]
            if placed[i] or not collect_ring(mesh, spokes[i], ring):
                continue
            measure_faces(mesh, middle, ring)
            for k in range(3):
                ring.place[k] = places[i, k]
            if folds(mesh.points, ring, -1, ring.place, _MAX_TURN_COSINE):
                continue
            if not move_at_rest(mesh.attributes, ring, middle, goals, i, limits):
                continue
            for k in range(3):
                mesh.points[middle, k] = places[i, k]
            placed[i] = 1
            done += 1
        if done == before:
            break
    return done


@kernel((MESH_ARRAYS, _TABLE, LIMITS, INTS, INTS, CHANGES))
def classify_around(
    mesh: MeshArrays, births: Indices, limits: Limits, listed: Indices, long_edges: Indices, changes: Changes
) -> None:
    """List in `long_edges` those of `listed`, and the edges at the new vertices that are too long now.

    Queues edges that became short.
    """
    twin = mesh.twin
    for i in range(1, listed[0] + 1):
        push(long_edges, listed[i])
    for i in range(len(births)):
        first = k = births[i, BIRTH_HALFEDGE]
        while True:
            classify_edge(mesh, k, limits, long_edges, changes)
            k = twin[preceding(k)]
            if k < 0 or k == first:
                break
        if k < 0:  # on a boundary: the edge that no spoke has reached
            h = incoming(mesh, first, births[i, 0])
            classify_edge(mesh, h, limits, long_edges, changes)
