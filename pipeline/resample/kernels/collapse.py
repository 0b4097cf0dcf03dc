"""Collapse short edges one by one (Figure E; P9, P27), and alternate with edge flips."""

from __future__ import annotations

import numba

from pipeline.arrays import Floats, Indices
from pipeline.kernels import kernel
from pipeline.mesh.kernels.halfedge import (
    INTS,
    LEAN,
    MESH_ARRAYS,
    VECTOR,
    MeshArrays,
    following,
    join,
    preceding,
)
from pipeline.resample.kernels.can_collapse import AT_END, AT_MIDDLE, LINK, NONE, can_collapse
from pipeline.resample.kernels.flip import flip_fresh
from pipeline.resample.kernels.limits import (
    CHANGED,
    CHANGES,
    FRESH,
    LIMITS,
    QUEUED,
    REFUSED,
    UNLISTED,
    Changes,
    Limits,
    enqueue,
    is_short,
    length_limits,
    push,
    squared_length,
    touch,
)
from pipeline.resample.kernels.ring import MAX_SPOKES, RING, Ring

RINGS = numba.types.UniTuple(RING, 2)


@kernel(numba.int64(MESH_ARRAYS, numba.int64), **LEAN)
def _valence_three_edge(mesh: MeshArrays, h: int) -> int:
    """Return the shortest edge to a vertex of valence three that stands on the edge of h, or NONE.

    While such a vertex exists, the link condition forbids the sides of its base, because both ends share the
    third corner of the base. Its own edges need not be short, so it would stay for ever. The half-edge
    returned ends at the vertex.
    """
    points, vert, twin = mesh.points, mesh.vert, mesh.twin
    for side in range(2):
        k = h if side == 0 else twin[h]
        if k < 0:
            continue
        first = best = following(k)  # ends at the corner opposite the edge
        tip, spoke = vert[following(first)], first
        for _ in range(3):
            spoke = preceding(twin[spoke]) if spoke >= 0 and twin[spoke] >= 0 else NONE
            shortest = squared_length(points, vert[best], tip)
            if spoke >= 0 and squared_length(points, vert[spoke], tip) < shortest:
                best = spoke
        if spoke == first:
            return best
    return NONE


@kernel((MESH_ARRAYS, numba.int64, INTS), **LEAN)
def _remove_face(mesh: MeshArrays, h: int, dead_faces: Indices) -> None:
    """Remove the face of h, whose edge has shrunk to a point, and join its other two sides."""
    vert, twin, tagged = mesh.vert, mesh.twin, mesh.tagged
    one, two = twin[following(h)], twin[preceding(h)]
    join(twin, one, two)
    join(twin, two, one)
    hard = tagged[following(h)] | tagged[preceding(h)]
    if one >= 0:
        tagged[one] = hard
    if two >= 0:
        tagged[two] = hard
    f = h // 3
    vert[3 * f] = vert[3 * f + 1] = vert[3 * f + 2] = -1
    push(dead_faces, f)


@kernel((MESH_ARRAYS, numba.int64, RING, numba.int64, VECTOR, INTS), **LEAN)
def collapse_edge(
    mesh: MeshArrays, h: int, far: Ring, where: int, place: Floats, dead_faces: Indices
) -> None:
    """Merge the end of h into its start, which moves to `place`. `can_collapse` must have allowed it."""
    points, attributes, blends, vert, twin, _ = mesh
    a, b, back = vert[h], vert[following(h)], twin[h]
    for k in range(3):
        points[a, k] = place[k]
    for k in range(attributes.shape[1]):
        if where == AT_END:
            attributes[a, k] = attributes[b, k]
        elif where == AT_MIDDLE and blends[k] > 0:
            attributes[a, k] = 0.5 * (attributes[a, k] + attributes[b, k])
    for i in range(far.size[0]):
        vert[far.leaving[i]] = a
    _remove_face(mesh, h, dead_faces)
    if back >= 0:
        _remove_face(mesh, back, dead_faces)


@kernel((MESH_ARRAYS, numba.int64, RING, numba.boolean, LIMITS, CHANGES), **LEAN)
def _enqueue_around(
    mesh: MeshArrays, centre: int, ring: Ring, opened: bool, limits: Limits, changes: Changes
) -> None:
    """After a collapse, touch the faces of a ring and queue those of its remaining spokes that are short.

    `centre` is the merged vertex; `opened` tells whether it lies on a boundary.
    """
    for i in range(ring.size[0]):
        h, v = ring.leaving[i], ring.vertex[i]
        touch(changes, h // 3)
        if mesh.vert[h] < 0:
            continue
        if squared_length(mesh.points, centre, v) < length_limits(mesh, limits, centre, v)[1]:
            enqueue(changes, h)
        if opened and mesh.twin[preceding(h)] < 0 and is_short(mesh, preceding(h), limits):
            enqueue(changes, preceding(h))


@kernel(numba.boolean(MESH_ARRAYS, numba.int64, LIMITS, CHANGES), **LEAN)
def _is_still_short(mesh: MeshArrays, h: int, limits: Limits, changes: Changes) -> bool:
    """Tell whether a listed edge exists, is short, and is not listed by its twin."""
    if mesh.vert[h] < 0 or not is_short(mesh, h, limits):
        return False
    back = mesh.twin[h]
    return bool(back < 0 or changes.edge_states[back] == UNLISTED)


@kernel(numba.int64(MESH_ARRAYS, LIMITS, RINGS, CHANGES, INTS, INTS), **LEAN)
def collapse_queued(
    mesh: MeshArrays,
    limits: Limits,
    rings: tuple[Ring, Ring],
    changes: Changes,
    dead_faces: Indices,
    dead_vertices: Indices,
) -> int:
    """Collapse the queued edges that may collapse; return the number of collapses.

    Edges that become short join the list while it is worked through; refused ones stay in it. Where only a
    vertex of valence three forbids a side of its base, one of its edges collapses first.
    """
    (near, far), short_edges, edge_states = rings, changes.short_edges, changes.edge_states
    done, kept, at = 0, 0, 0
    while at < short_edges[0]:
        at += 1
        h = short_edges[at]
        where, reason = NONE, NONE
        if edge_states[h] == QUEUED:
            edge_states[h] = UNLISTED
            if not _is_still_short(mesh, h, limits, changes):
                continue
            where, reason = can_collapse(mesh, h, near, far, limits)
            edge_states[h] = REFUSED + reason if where == NONE else UNLISTED
            tip_edge = _valence_three_edge(mesh, h) if reason == LINK else NONE
            if tip_edge != NONE:
                where, _ = can_collapse(mesh, tip_edge, near, far, limits)
            if tip_edge != NONE and where != NONE:  # collapse it first, then test this edge again
                edge_states[h] = QUEUED
                h, at = tip_edge, at - 1
        if where == NONE:
            kept += 1
            short_edges[kept] = h
            continue
        kept_end = mesh.vert[h]
        opened = near.size[1] > near.size[0] or far.size[1] > far.size[0]
        push(dead_vertices, mesh.vert[following(h)])
        collapse_edge(mesh, h, far, where, near.place, dead_faces)
        done += 1
        _enqueue_around(mesh, kept_end, near, opened, limits, changes)
        _enqueue_around(mesh, kept_end, far, opened, limits, changes)
        if short_edges[0] + 4 * MAX_SPOKES > len(short_edges):  # close the gap of the processed ones
            for i in range(at + 1, short_edges[0] + 1):
                short_edges[kept + i - at] = short_edges[i]
            short_edges[0] -= at - kept
            at = kept
    short_edges[0] = kept
    return done


@kernel(numba.boolean(MESH_ARRAYS, numba.int64, CHANGES), **LEAN)
def _has_fresh_face(mesh: MeshArrays, h: int, changes: Changes) -> bool:
    """Tell whether any face at the start of h is FRESH."""
    twin, face_states = mesh.twin, changes.face_states
    k = h
    while True:
        if face_states[k // 3] == FRESH:
            return True
        k = twin[preceding(k)]
        if k == h:
            return False
        if k < 0:
            break
    k = twin[h]  # the fan is open: walk its other side
    while k >= 0:
        if face_states[k // 3] == FRESH:
            return True
        k = twin[following(k)]
    return False


@kernel(numba.int64(MESH_ARRAYS, CHANGES), **LEAN)
def requeue_refused(mesh: MeshArrays, changes: Changes) -> int:
    """Queue refused edges again if a face at one of their ends has changed; return how many are queued.

    Afterwards no face is FRESH.
    """
    short_edges, edge_states, fresh = changes.short_edges, changes.edge_states, changes.fresh
    queued = 0
    for i in range(1, short_edges[0] + 1):
        h = short_edges[i]
        gone = mesh.vert[h] < 0
        if gone or _has_fresh_face(mesh, h, changes) or _has_fresh_face(mesh, following(h), changes):
            edge_states[h] = QUEUED
        queued += edge_states[h] == QUEUED
    for i in range(1, fresh[0] + 1):
        changes.face_states[fresh[i]] = CHANGED
    fresh[0] = 0
    return queued


_DEAD = numba.types.UniTuple(INTS, 2)
_PAIR = numba.types.UniTuple(numba.int64, 2)


@kernel(_PAIR(MESH_ARRAYS, LIMITS, RINGS, CHANGES, _DEAD, INTS, INTS))
def collapse_and_flip(
    mesh: MeshArrays,
    limits: Limits,
    rings: tuple[Ring, Ring],
    changes: Changes,
    dead: tuple[Indices, Indices],
    obtuse_edges: Indices,
    stack: Indices,
) -> tuple[int, int]:
    """Collapse queued edges, flip badly shaped ones and requeue refused ones, until none can collapse.

    Returns the numbers of collapses and flips. Afterwards every short edge stands in `changes.short_edges`
    with its reason. The loop ends because every round but the last removes a vertex. `dead` receives the
    removed faces and vertices.
    """
    collapses = flips = 0
    while True:
        done = collapse_queued(mesh, limits, rings, changes, dead[0], dead[1])
        collapses += done
        flips += flip_fresh(mesh, limits, changes, obtuse_edges, stack)
        if requeue_refused(mesh, changes) == 0:
            return collapses, flips
