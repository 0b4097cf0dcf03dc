"""Split long edges with their two faces, and move the new vertices (Figure D of the paper; P8, P24, P25)."""

from __future__ import annotations

import numba
import numpy as np

from pipeline.arrays import AnyArray, Indices, Points
from pipeline.kernels import kernel
from pipeline.mesh.kernels.halfedge import (
    BYTES,
    INTS,
    LEAN,
    MATRIX,
    MESH_ARRAYS,
    MeshArrays,
    following,
    join,
    preceding,
)
from pipeline.resample.kernels.limits import (
    CHANGES,
    LIMITS,
    Changes,
    Limits,
    classify_edge,
    length_limits,
    push,
    squared_length,
    touch,
)
from pipeline.resample.kernels.ring import RING, Ring, collect_ring, folds, measure_faces, move_at_rest

BIRTH_HALFEDGE = 2  # index of the half-edge that leaves the new vertex
BIRTH_SIZE = 3  # numbers recorded for each new vertex: parents a and b, half-edge vertex→b
_CLASSES = 4


@kernel((MESH_ARRAYS, numba.int64, numba.int64, numba.int64), **LEAN)
def _split_face(mesh: MeshArrays, h: int, middle: int, face: int) -> None:
    """Cut the face of h: a→b along the line from `middle` to its third corner c.

    `face` becomes (middle, b, c). Half-edge b→c moves to the new face; its old place holds the line from
    `middle` to c.
    """
    vert, twin, tagged = mesh.vert, mesh.twin, mesh.tagged
    onward, new = following(h), 3 * face
    tagged[new], tagged[new + 1], tagged[new + 2] = tagged[h], tagged[onward], 0
    tagged[onward] = 0
    vert[new], vert[new + 1], vert[new + 2] = middle, vert[onward], vert[preceding(h)]
    vert[onward] = middle
    join(twin, new + 1, twin[onward])
    join(twin, onward, new + 2)


@kernel(numba.int64(MESH_ARRAYS, numba.int64, numba.int64, numba.int64), **LEAN)
def split_edge(mesh: MeshArrays, h: int, middle: int, faces: int) -> int:
    """Insert vertex `middle` into the edge of h and cut its faces; return the new number of faces."""
    twin = mesh.twin
    back, new = twin[h], 3 * faces
    _split_face(mesh, h, middle, faces)
    if back < 0:
        twin[new] = -1
        return faces + 1
    _split_face(mesh, back, middle, faces + 1)
    join(twin, h, new + 3)
    join(twin, back, new)
    return faces + 2


@kernel((MESH_ARRAYS, numba.int64, numba.int64, numba.int64), **LEAN)
def _interpolate(mesh: MeshArrays, middle: int, a: int, b: int) -> None:
    """Set position and attributes of vertex `middle` from its parents a and b."""
    points, attributes, blends = mesh.points, mesh.attributes, mesh.blends
    for k in range(3):
        points[middle, k] = 0.5 * (points[a, k] + points[b, k])
    for k in range(attributes.shape[1]):
        mixes = blends[k] > 0
        attributes[middle, k] = 0.5 * (attributes[a, k] + attributes[b, k]) if mixes else attributes[a, k]


@kernel(INTS(MESH_ARRAYS, INTS, LIMITS, INTS))
def longest_edges_first(mesh: MeshArrays, long_edges: Indices, limits: Limits, remaining: Indices) -> Indices:
    """Return the edges of this pass, longest first in a few classes; edges below 1/√2 of the longest wait.

    No new edge is longer than √(1 - 1/8) of the longest one, so splitting ends, and thin triangles are cut
    across rather than along.
    """
    excess = np.empty(long_edges[0])  # squared length over the square of the longest allowed
    longest = 0.0
    for i in range(long_edges[0]):
        a, b = mesh.vert[long_edges[i + 1]], mesh.vert[following(long_edges[i + 1])]
        excess[i] = squared_length(mesh.points, a, b) / length_limits(mesh, limits, a, b)[0]
        longest = max(longest, excess[i])
    bar = max(1.0, 0.5 * longest)
    start = np.zeros(_CLASSES + 1, np.int32)
    rank = np.empty(long_edges[0], np.int32)
    for i in range(long_edges[0]):
        rank[i] = -1
        if excess[i] > bar:
            rank[i] = max(0, min(_CLASSES - 1, int((2.0 - excess[i] / bar) * _CLASSES)))
            start[rank[i] + 1] += 1
        elif excess[i] > 1.0:
            push(remaining, long_edges[i + 1])
    for c in range(_CLASSES):
        start[c + 1] += start[c]
    order = np.empty(start[_CLASSES], np.int32)
    for i in range(long_edges[0]):
        if rank[i] >= 0:
            order[start[rank[i]]] = long_edges[i + 1]
            start[rank[i]] += 1
    return order


@kernel((MESH_ARRAYS, numba.int64[::1], LIMITS, INTS, INTS, INTS, CHANGES), **LEAN)
def split_edges(
    mesh: MeshArrays,
    sizes: Indices,
    limits: Limits,
    order: Indices,
    remaining: Indices,
    births: Indices,
    changes: Changes,
) -> None:
    """Split the edges of `order` that are long, each once; edges that are long afterwards go to `remaining`.

    New vertices lie at the midpoints of their parents. `births` records three numbers for each, so that a
    placement can move all of them before the next pass: its parents a and b, and the half-edge vertex→b. The
    arrays must have room for as many vertices, and twice as many faces, as `order` has entries.
    """
    vert, twin = mesh.vert, mesh.twin
    fresh = sizes[0]
    for h in order:
        a, b = vert[h], vert[following(h)]
        if a >= fresh or b >= fresh:
            continue
        if squared_length(mesh.points, a, b) <= length_limits(mesh, limits, a, b)[0]:
            continue
        middle, first = sizes[0], sizes[1]
        back = twin[h]
        _interpolate(mesh, middle, a, b)
        sizes[0] = middle + 1
        sizes[1] = split_edge(mesh, h, middle, first)
        push(births, a)
        push(births, b)
        push(births, 3 * first)
        classify_edge(mesh, h, limits, remaining, changes)
        for g in range(first, sizes[1]):
            touch(changes, g)
            for i in range(3):
                classify_edge(mesh, 3 * g + i, limits, remaining, changes)
        touch(changes, h // 3)
        if back >= 0:
            touch(changes, back // 3)


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


@kernel(numba.int64(MESH_ARRAYS, numba.int64, numba.int64), **LEAN)
def incoming(mesh: MeshArrays, new: int, a: int) -> int:
    """Return the half-edge a→vertex, given the half-edge from that vertex to its other parent.

    If its face was cut again in the same pass, it has moved in the table since the vertex was made.
    """
    k = preceding(new)
    while mesh.vert[k] != a:
        k = preceding(mesh.twin[k])
    return int(k)


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
