"""Collapse short edges one by one where they may, and alternate with edge flips (Figure E; P9, P27-P33).

No collapse loses a crease or a tendril.
"""

from __future__ import annotations

import numba
import numpy as np

from flowsculpt.pipeline.arrays import Floats, Indices, Points
from flowsculpt.pipeline.kernels import kernel
from flowsculpt.pipeline.mesh.kernels.halfedge import (
    INTS,
    LEAN,
    LEAN_CALLS,
    MATRIX,
    MESH_ARRAYS,
    VECTOR,
    MeshArrays,
    following,
    join,
    preceding,
)
from flowsculpt.pipeline.resample.kernels.flip import flip_fresh
from flowsculpt.pipeline.resample.kernels.pass_state import (
    CHANGED,
    CHANGES,
    FOLDED,
    FRESH,
    LIMITS,
    MAX_SPOKES,
    MAX_TURN_COSINE,
    NX,
    NY,
    NZ,
    QUEUED,
    REFUSED,
    RING,
    STRETCHED,
    UNLISTED,
    Changes,
    Limits,
    Ring,
    collect_ring,
    corner_cosine,
    enqueue,
    hard_cosine,
    is_short,
    length_limits,
    measure_ring,
    move_fault,
    push,
    squared_length,
    touch,
    would_flip,
    would_oppose,
)


@kernel(numba.float64(MATRIX, numba.int64, numba.int64, RING), **LEAN)
def swept_volume(points: Points, centre: int, to: int, ring: Ring) -> float:
    """Return six times the volume that a ring sweeps when its centre moves to vertex `to`."""
    total, rows = 0.0, ring.rows
    x = points[to, 0] - points[centre, 0]
    y = points[to, 1] - points[centre, 1]
    z = points[to, 2] - points[centre, 2]
    for j in range(1, ring.size[0] + 1):
        i = np.uint64(j)
        total += x * rows[NX + i] + y * rows[NY + i] + z * rows[NZ + i]
    return abs(total)


@kernel(numba.float64(numba.float64, numba.float64, numba.float64, numba.float64, numba.float64), **LEAN)
def _nearer_by(aa: float, ab: float, bb: float, ap: float, bp: float) -> float:
    """Return |p - o|² - d², where d is the distance from point p to a triangle with corner o.

    Arguments: scalar products of the sides a and b, which leave o, with each other and with p - o.
    """
    det = aa * bb - ab * ab
    s, t = bb * ap - ab * bp, aa * bp - ab * ap
    if s >= 0.0 and t >= 0.0 and s + t <= det and det > 0.0:
        return (s * ap + t * bp) / det
    best = 0.0
    if aa > 0.0:
        u = min(1.0, max(0.0, ap / aa))
        best = max(best, u * (2.0 * ap - u * aa))
    if bb > 0.0:
        u = min(1.0, max(0.0, bp / bb))
        best = max(best, u * (2.0 * bp - u * bb))
    cc = aa - 2.0 * ab + bb
    if cc > 0.0:
        u = min(1.0, max(0.0, (bp - ab - ap + aa) / cc))
        best = max(best, 2.0 * ap - aa + u * (2.0 * (bp - ab - ap + aa) - u * cc))
    return best


@kernel(numba.float64(MATRIX, RING, numba.int64, numba.int64), **LEAN)
def removal_distance(points: Points, ring: Ring, centre: int, to: int) -> float:
    """Return the squared distance from a ring's centre to the faces left after it merges into vertex `to`."""
    away, best = squared_length(points, centre, to), 0.0
    for i in range(ring.size[0]):
        b, c = ring.vertex[i], ring.vertex[i + 1]
        if b == to or c == to:
            continue
        aa, bb, ab, ap, bp = 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(3):
            origin = points[to, k]
            u, v, w = points[b, k] - origin, points[c, k] - origin, points[centre, k] - origin
            aa += u * u
            bb += v * v
            ab += u * v
            ap += u * w
            bp += v * w
        best = max(best, _nearer_by(aa, ab, bb, ap, bp))
    return away - best


REASONS = ("link", "boundary", "feature", "too_long", "fold", "shape", "crowded")
LINK, BOUNDARY, FEATURE, TOO_LONG, FOLD, SHAPE, CROWDED = range(7)
NONE = -1

AT_START, AT_END, AT_MIDDLE = 0, 1, 2
_MAX_REMOVAL = 0.05  # distance of a removed vertex from the faces left, in maximum edge lengths
_STRAIGHT = 0.9962  # cosine of 5 degrees: a crease that bends less is a straight line


@kernel(numba.boolean(RING, RING), **LEAN)
def _rings_meet(near: Ring, far: Ring) -> bool:
    """Tell whether the closed rings of an edge's two ends share more than the two corners opposite the edge.

    Each ring begins with the other end, so the opposite corners are its second and last vertices. Two rings
    of three faces are those of a tetrahedron.
    """
    shared = bool(near.size[1] == 3 and far.size[1] == 3)
    for i in range(2, near.size[1] - 1):
        for j in range(2, far.size[1] - 1):
            shared |= bool(near.vertex[i] == far.vertex[j])
    return shared


@kernel(numba.int64(MESH_ARRAYS, numba.int64, RING, RING), **LEAN)
def _link_fault(mesh: MeshArrays, h: int, near: Ring, far: Ring) -> int:
    """Return LINK or BOUNDARY if a collapse of h breaks the link condition, else NONE.

    The two ends of an edge may share only the corners opposite it (Dey et al. 1999).
    """
    vert, twin = mesh.vert, mesh.twin
    if near.size[1] == near.size[0] and far.size[1] == far.size[0]:
        return LINK if _rings_meet(near, far) else NONE
    back = twin[h]
    if back >= 0 and near.size[1] > near.size[0] and far.size[1] > far.size[0]:
        return BOUNDARY
    shared = 0
    for i in range(near.size[1]):
        for j in range(far.size[1]):
            shared += near.vertex[i] == far.vertex[j]
    if shared != (1 if back < 0 else 2):
        return LINK
    sides = 1 if back < 0 else 2
    for side in range(sides):
        k = h if side == 0 else back
        one, two = twin[following(k)], twin[preceding(k)]
        if one < 0 and two < 0:
            return BOUNDARY
        if one >= 0 and two >= 0 and vert[preceding(one)] == vert[preceding(two)]:
            return LINK
    return NONE


@kernel(numba.float64(MATRIX, numba.int64, numba.int64, numba.int64, RING), **LEAN)
def _turn_cosine(rows: Points, column: int, centre: int, other: int, ring: Ring) -> float:
    """Return the cosine of the turn that a crease makes at `centre`, from `other` to its other hard spoke.

    Positions are `rows` from `column` on.
    """
    for i in range(ring.size[1]):
        v = ring.vertex[i]
        if ring.hard[i] and v != other:
            dot, before, after = 0.0, 0.0, 0.0
            for k in range(column, column + 3):
                one, two = rows[centre, k] - rows[v, k], rows[other, k] - rows[centre, k]
                dot += one * two
                before += one * one
                after += two * two
            return dot / np.sqrt(before * after) if before * after > 0 else 1.0
    return -1.0


@kernel(numba.int64(MESH_ARRAYS, numba.int64, RING, LIMITS), **LEAN)
def _rank(mesh: MeshArrays, centre: int, ring: Ring, limits: Limits) -> int:
    """Return the number of hard edges at a vertex, and 3 where a crease has a corner.

    There it turns by more than the hard angle: now, or at rest if edges are hard by what they are at rest.
    """
    if ring.size[2] != 2:
        return int(ring.size[2])
    other = -1
    for i in range(ring.size[1]):
        if ring.hard[i]:
            other = ring.vertex[i]
    if limits.hard_by_angle:
        turn = _turn_cosine(mesh.points, 0, centre, other, ring)
    else:
        turn = _turn_cosine(mesh.attributes, limits.rest_column, centre, other, ring)
    return 3 if turn < corner_cosine(mesh, limits, centre) else 2


@kernel(numba.types.UniTuple(numba.int64, 3)(MESH_ARRAYS, numba.int64, RING, RING, LIMITS), **LEAN)
def _collapse_positions(
    mesh: MeshArrays, h: int, near: Ring, far: Ring, limits: Limits
) -> tuple[int, int, int]:
    """Return the positions allowed for the merged vertex, best first, filled up with NONE.

    The end with more hard edges keeps its position (P30). On a tie soft ends take the midpoint (P27), or with
    exact placement the end that sweeps less volume. Two vertices of one crease take the midpoint where the
    crease is straight, else the end with the sharper turn. Corners never merge, and two creases never merge
    across the soft surface between them, which keeps a tendril alive (P32).
    """
    a, b = mesh.vert[h], mesh.vert[following(h)]
    midpoints = limits.merges_at_midpoint
    mine, theirs = _rank(mesh, a, near, limits), _rank(mesh, b, far, limits)
    if mine >= 2 and theirs >= 2:
        hard = False
        for i in range(near.size[1]):
            hard = hard or (near.vertex[i] == b and near.hard[i] > 0)
        if not hard or (mine >= 3 and theirs >= 3):
            return NONE, NONE, NONE
    if mine > theirs:
        return AT_START, NONE, NONE
    if theirs > mine:
        return AT_END, NONE, NONE
    if mine < 2 and midpoints:
        return AT_MIDDLE, AT_START, AT_END
    if mine < 2:
        at_start, at_end = swept_volume(mesh.points, b, a, far), swept_volume(mesh.points, a, b, near)
        return (AT_START, AT_END, NONE) if at_start <= at_end else (AT_END, AT_START, NONE)
    one, two = _turn_cosine(mesh.points, 0, a, b, near), _turn_cosine(mesh.points, 0, b, a, far)
    if one > _STRAIGHT and two > _STRAIGHT:
        return (AT_MIDDLE, AT_START, AT_END) if midpoints else (AT_START, AT_END, NONE)
    if one <= two:
        return AT_START, AT_END if one > _STRAIGHT else NONE, NONE
    return AT_END, AT_START if two > _STRAIGHT else NONE, NONE


@kernel(numba.int64(MESH_ARRAYS, RING, numba.int64, numba.int64, VECTOR, LIMITS), **LEAN_CALLS)
def _collapse_fault(
    mesh: MeshArrays, ring: Ring, centre: int, other: int, place: Floats, limits: Limits
) -> int:
    """Return TOO_LONG or FOLD if the ring's centre may not merge with `other` at `place`, else NONE."""
    points = mesh.points
    max_squared = limits.squared_slack * (limits.max_edge_length * limits.max_edge_length)
    if limits.field_column >= 0:
        max_squared = np.inf
        for i in range(ring.size[1]):
            v = ring.vertex[i]
            x, y, z = points[v, 0] - place[0], points[v, 1] - place[1], points[v, 2] - place[2]
            if v != other and x * x + y * y + z * z > limits.squared_slack * min(
                length_limits(mesh, limits, centre, v)[0], length_limits(mesh, limits, other, v)[0]
            ):
                return TOO_LONG
    strain = move_fault(ring, other, place, max_squared, MAX_TURN_COSINE)
    return TOO_LONG if strain == STRETCHED else (FOLD if strain == FOLDED else NONE)


@kernel((MATRIX, numba.int64, numba.int64, numba.int64, VECTOR), **LEAN)
def _set_position(points: Points, a: int, b: int, where: int, place: Floats) -> None:
    """Write the position AT_START (a), AT_END (b) or AT_MIDDLE into `place`."""
    for k in range(3):
        if where == AT_START:
            place[k] = points[a, k]
        elif where == AT_END:
            place[k] = points[b, k]
        else:
            place[k] = 0.5 * (points[a, k] + points[b, k])


@kernel(numba.boolean(MESH_ARRAYS, numba.int64, numba.int64, numba.int64, RING, RING, LIMITS), **LEAN)
def _would_flip_at_rest(
    mesh: MeshArrays, a: int, b: int, where: int, near: Ring, far: Ring, limits: Limits
) -> bool:
    """Tell whether merging a and b would turn a face over at rest; False without rest positions."""
    if limits.rest_column < 0:
        return False
    if where == AT_START:
        return would_flip(mesh.attributes, far, b, a, limits)
    return would_flip(mesh.attributes, near, a, b, limits)


@kernel(numba.types.UniTuple(numba.int64, 2)(MESH_ARRAYS, numba.int64, RING, RING, LIMITS), **LEAN_CALLS)
def can_collapse(mesh: MeshArrays, h: int, near: Ring, far: Ring, limits: Limits) -> tuple[int, int]:
    """Return (position of the merged vertex, NONE) if the edge of h may collapse, else (NONE, the reason).

    Fills `near` and `far` with the rings of the edge's start and end, and `near.place` with the position.
    """
    vert, twin, points = mesh.vert, mesh.twin, mesh.points
    a, b = vert[h], vert[following(h)]
    leaving = twin[h] if twin[h] >= 0 else following(h)
    if not (collect_ring(mesh, h, near) and collect_ring(mesh, leaving, far)):
        return NONE, CROWDED
    fault = _link_fault(mesh, h, near, far)
    if fault != NONE:
        return NONE, fault
    measure_ring(mesh, a, near, hard_cosine(mesh, limits, a))
    measure_ring(mesh, b, far, hard_cosine(mesh, limits, b))
    reason, second = FEATURE, NONE
    for where in _collapse_positions(mesh, h, near, far, limits):
        if where == NONE:
            break
        _set_position(points, a, b, where, near.place)
        fault = NONE
        if where != AT_START:
            fault = _collapse_fault(mesh, near, a, b, near.place, limits)
        if fault == NONE and where != AT_END:
            fault = _collapse_fault(mesh, far, b, a, near.place, limits)
        if fault == NONE and not limits.merges_at_midpoint:  # keep the exact surface's shape
            if where == AT_START:
                removed, opposes = removal_distance(points, far, b, a), would_oppose(mesh, far, b, a, limits)
            else:
                removed, opposes = (
                    removal_distance(points, near, a, b),
                    would_oppose(mesh, near, a, b, limits),
                )
            if removed > _MAX_REMOVAL * _MAX_REMOVAL * length_limits(mesh, limits, a, b)[0]:
                fault = SHAPE
            elif opposes:
                fault = FOLD
        if fault == NONE and not _would_flip_at_rest(mesh, a, b, where, near, far, limits):
            return where, NONE
        if fault == NONE and second == NONE:
            second = where  # a face that turns over at rest is better than an edge too short
        elif reason == FEATURE:
            reason = fault
    if second != NONE:
        _set_position(points, a, b, second, near.place)
        return second, NONE
    return NONE, reason


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


@kernel((MESH_ARRAYS, numba.int64, RING, numba.boolean, LIMITS, CHANGES), **LEAN_CALLS)
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


@kernel(_PAIR(MESH_ARRAYS, LIMITS, RINGS, CHANGES, _DEAD, INTS, INTS, numba.boolean))
def collapse_and_flip(
    mesh: MeshArrays,
    limits: Limits,
    rings: tuple[Ring, Ring],
    changes: Changes,
    dead: tuple[Indices, Indices],
    obtuse_edges: Indices,
    stack: Indices,
    flips_too: bool,
) -> tuple[int, int]:
    """Collapse queued edges, flip badly shaped ones and requeue refused ones, until none can collapse.

    Without `flips_too` the queued edges are only tried once. One kernel does both, since the operations are
    inlined, and compile for seconds.

    Returns the numbers of collapses and flips. Afterwards every short edge stands in `changes.short_edges`
    with its reason. The loop ends because every round but the last removes a vertex. `dead` receives the
    removed faces and vertices.
    """
    collapses = flips = 0
    while True:
        done = collapse_queued(mesh, limits, rings, changes, dead[0], dead[1])
        collapses += done
        if not flips_too:
            return collapses, flips
        flips += flip_fresh(mesh, limits, changes, obtuse_edges, stack)
        if requeue_refused(mesh, changes) == 0:
            return collapses, flips
