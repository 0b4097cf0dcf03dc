"""Flip soft edges: where angles improve (P36), and where fewer faces then look the wrong way.

Creases and the shape of the surface stay.
"""

from __future__ import annotations

import numba
import numpy as np

from flowsculpt.pipeline.arrays import Indices, Points
from flowsculpt.pipeline.kernels import kernel
from flowsculpt.pipeline.mesh.kernels.halfedge import (
    INTS,
    LEAN,
    LEAN_CALLS,
    MATRIX,
    MESH_ARRAYS,
    MeshArrays,
    after,
    before,
    following,
    join,
    preceding,
)
from flowsculpt.pipeline.resample.kernels.pass_state import (
    CHANGES,
    FRESH,
    LIMITS,
    MAX_TURN_COSINE,
    UNLISTED,
    Changes,
    Limits,
    area_vector,
    edge_height,
    enqueue,
    hard_cosine,
    is_inverted,
    is_short,
    length_limits,
    opposes_normals,
    push,
    squared_length,
    touch,
)

_PAIR = numba.types.UniTuple(numba.int64, 2)
_GAIN = 0.1  # cot α + cot β must be below -_GAIN: a flip must be worth the change of the surface
MAX_STACK = 128  # edges to test around one flip and those that follow from it; each flip adds four
_HIGH = 0.3  # over the height that an edge may have: from here on heights decide, where edges may not bend
_WIDE = 1.7  # minus the cotangent of 150 degrees: heights make no corner wider
_LOWER = 0.8  # by at least this factor the other diagonal must then be lower
_FLAT = 0.94  # cosine of 20 degrees: the largest angle between the two faces before and after


@kernel(numba.float64(MATRIX, numba.int64, numba.int64, numba.int64), **LEAN)
def _corner_dot(points: Points, apex: int, a: int, b: int) -> float:
    """Return the scalar product of a triangle's two sides at `apex`; negative where the angle is obtuse."""
    i, j, k = np.uint64(apex), np.uint64(a), np.uint64(b)
    x = (points[j, 0] - points[i, 0]) * (points[k, 0] - points[i, 0])
    y = (points[j, 1] - points[i, 1]) * (points[k, 1] - points[i, 1])
    z = (points[j, 2] - points[i, 2]) * (points[k, 2] - points[i, 2])
    return float(x + y + z)


@kernel(numba.boolean(MATRIX, numba.int64, numba.int64, numba.int64), **LEAN)
def _is_wide(points: Points, apex: int, a: int, b: int) -> bool:
    """Tell whether a triangle's corner at `apex` is wider than the angle of _WIDE."""
    dot, (x, y, z) = _corner_dot(points, apex, a, b), area_vector(points, apex, a, b)
    return bool(dot < 0 and dot * dot > _WIDE * _WIDE * (x * x + y * y + z * z))


@kernel(numba.boolean(MESH_ARRAYS, numba.uint64, numba.int64), **LEAN)
def are_adjacent(mesh: MeshArrays, h: np.uint64, other: int) -> bool:
    """Tell whether an edge joins the start c of h, a side of a triangle, with vertex `other` outside it.

    The corners before and after c are known, so the walk around c begins beyond one and ends at the other.
    """
    vert, twin = mesh.vert, mesh.twin
    a = vert[after(h)]
    k = twin[before(h)]
    while k >= 0:
        back = before(np.uint64(k))
        if vert[back] == other:
            return True
        if vert[back] == a:
            return False
        k = twin[back]
    k = twin[h]  # the fan is open: walk its other side
    while k >= 0:
        onward = after(np.uint64(k))
        if vert[after(onward)] == other:
            return True
        k = twin[onward]
    return False


@kernel(numba.boolean(numba.float64, numba.float64, numba.float64, numba.float64), **LEAN)
def turns_beyond(dot: float, cosine: float, m: float, n: float) -> bool:
    """Tell whether vectors with squared lengths m and n enclose more than the acute angle of that cosine."""
    return bool(dot < 0 or dot * dot < cosine * cosine * m * n)


@kernel(_PAIR(MESH_ARRAYS, LIMITS, numba.int64, numba.int64, numba.int64, numba.int64), **LEAN)
def wrong_by_flip(mesh: MeshArrays, limits: Limits, a: int, b: int, c: int, d: int) -> tuple[int, int]:
    """Return how many more faces look inwards at rest, and oppose their normals, once an edge is flipped.

    The edge is ab, between c and d.
    """
    at_rest, attributes = 0, mesh.attributes
    if limits.rest_column >= 0:
        at_rest += is_inverted(attributes, limits, a, d, c) + is_inverted(attributes, limits, b, c, d)
        at_rest -= is_inverted(attributes, limits, a, b, c) + is_inverted(attributes, limits, b, a, d)
    now = opposes_normals(mesh, limits, a, d, c) + opposes_normals(mesh, limits, b, c, d)
    now -= opposes_normals(mesh, limits, a, b, c) + opposes_normals(mesh, limits, b, a, d)
    return at_rest, now


@kernel(numba.boolean(MATRIX, numba.int64, numba.int64, numba.int64, numba.int64, numba.float64), **LEAN)
def folds_by_flip(points: Points, a: int, b: int, c: int, d: int, cosine: float) -> bool:
    """Tell whether a face turns beyond an angle, given by its cosine, from the mean of the faces before once
    the edge ab, between c and d, is flipped."""
    mx, my, mz = area_vector(points, a, b, c)
    nx, ny, nz = area_vector(points, b, a, d)
    px, py, pz = area_vector(points, a, d, c)
    qx, qy, qz = area_vector(points, b, c, d)
    sx, sy, sz = mx + nx, my + ny, mz + nz
    p, q, s = px * px + py * py + pz * pz, qx * qx + qy * qy + qz * qz, sx * sx + sy * sy + sz * sz
    ps, qs = px * sx + py * sy + pz * sz, qx * sx + qy * sy + qz * sz
    return turns_beyond(ps, cosine, p, s) or turns_beyond(qs, cosine, q, s)


@kernel(numba.boolean(MESH_ARRAYS, numba.int64, LIMITS), **LEAN)
def should_flip(mesh: MeshArrays, h: int, limits: Limits) -> bool:
    """Tell whether the edge of h is soft, not Delaunay, and its other diagonal legal on the same surface.

    Where one of the two is high over the surface, and edges may not bend, the other must be lower instead.
    """
    points, vert, twin = mesh.points, mesh.vert, mesh.twin
    i = np.uint64(h)
    k = np.uint64(twin[i])
    a, b, c, d = vert[i], vert[after(i)], vert[before(i)], vert[before(k)]
    at_c, at_d = _corner_dot(points, c, a, b), _corner_dot(points, d, a, b)
    now = edge_height(mesh, limits.field_column, a, b) if limits.bends else 0.0
    then = edge_height(mesh, limits.field_column, c, d) if limits.bends else 0.0
    is_high = max(now, then) > _HIGH and not (_is_wide(points, c, a, b) or _is_wide(points, d, a, b))
    if mesh.tagged[i] or (then > _LOWER * now if is_high else at_c >= 0 and at_d >= 0):
        return False
    mx, my, mz = area_vector(points, a, b, c)
    nx, ny, nz = area_vector(points, b, a, d)
    m, n = mx * mx + my * my + mz * mz, nx * nx + ny * ny + nz * nz
    root_m, root_n = np.sqrt(m), np.sqrt(n)
    gains = is_high or at_c * root_n + at_d * root_m <= -_GAIN * root_m * root_n
    if m == 0 or n == 0 or not gains:
        return False
    if turns_beyond(mx * nx + my * ny + mz * nz, max(_FLAT, hard_cosine(mesh, limits, a)), m, n):
        return False
    crossing, (max_squared, min_squared) = squared_length(points, c, d), length_limits(mesh, limits, c, d)
    if crossing > max_squared or crossing < min_squared or folds_by_flip(points, a, b, c, d, _FLAT):
        return False
    if is_high and (_is_wide(points, a, c, d) or _is_wide(points, b, c, d)):
        return False
    return not (max(wrong_by_flip(mesh, limits, a, b, c, d)) > 0 or are_adjacent(mesh, before(i), d))


@kernel((MESH_ARRAYS, numba.int64), **LEAN)
def flip_edge(mesh: MeshArrays, h: int) -> None:
    """Flip the edge of h: a→b between c and d becomes d→c. Half-edges c→a and d→b keep their places."""
    vert, twin, tagged = mesh.vert, mesh.twin, mesh.tagged
    back = twin[h]
    i, j = np.uint64(h), np.uint64(back)
    i1, j1 = after(i), after(j)
    c, d = vert[after(i1)], vert[after(j1)]
    beside, beyond = twin[j1], twin[i1]
    vert[i1], vert[j1] = d, c
    tagged[i], tagged[j] = tagged[j1], tagged[i1]
    tagged[i1] = tagged[j1] = 0
    join(twin, h, beside)
    join(twin, back, beyond)
    twin[i1], twin[j1] = j1, i1


@kernel(numba.int64(MESH_ARRAYS, numba.int64), **LEAN)
def _facing_obtuse(mesh: MeshArrays, f: int) -> int:
    """Return the half-edge of face f opposite its obtuse corner; -1 where all corners are acute."""
    points, vert = mesh.points, mesh.vert
    h = 3 * f
    i = np.uint64(h)
    a, b, c = vert[i], vert[i + np.uint64(1)], vert[i + np.uint64(2)]
    if _corner_dot(points, c, a, b) < 0:
        return h
    if _corner_dot(points, a, b, c) < 0:
        return h + 1
    return h + 2 if _corner_dot(points, b, c, a) < 0 else -1


@kernel((MESH_ARRAYS, numba.int64, CHANGES), **LEAN)
def flip_and_touch(mesh: MeshArrays, h: int, changes: Changes) -> None:
    """Flip the edge of h, touch its faces, and keep listed edges listed under their new half-edges."""
    k = mesh.twin[h]
    beside, beyond = following(k), following(h)
    flip_edge(mesh, h)
    touch(changes, h // 3)
    touch(changes, k // 3)
    if changes.edge_states[beside] != UNLISTED:
        enqueue(changes, h)
    if changes.edge_states[beyond] != UNLISTED:
        enqueue(changes, k)


@kernel(numba.int64(MESH_ARRAYS, numba.int64, LIMITS, CHANGES, INTS), **LEAN_CALLS)
def _flip_from(mesh: MeshArrays, h: int, limits: Limits, changes: Changes, stack: Indices) -> int:
    """Flip the edge of h if it should flip, then the four edges around, and so on; return the flips done.

    On a curved surface flips might repeat for ever, so the walk ends when `stack` is full.
    """
    twin = mesh.twin
    stack[0], stack[1] = 1, h
    flips, at = 0, 1
    while at <= stack[0]:
        h = stack[np.uint64(at)]
        k = twin[np.uint64(h)]
        at += 1
        if k >= 0 and should_flip(mesh, h, limits):
            flip_and_touch(mesh, h, changes)
            flips += 1
            push(stack, h)
            push(stack, preceding(h))
            push(stack, k)
            push(stack, preceding(k))
    return flips


@kernel(numba.int64(MESH_ARRAYS, LIMITS, CHANGES, INTS, INTS), **LEAN)
def flip_fresh(
    mesh: MeshArrays, limits: Limits, changes: Changes, obtuse_edges: Indices, stack: Indices
) -> int:
    """Flip edges of `obtuse_edges` and of FRESH faces where they should flip, and then around each flip.

    Unless edges may not bend, only one opposite an obtuse corner can be worth a flip, and a face has at most
    one: each FRESH face tests it, and so do its neighbours. Empties `obtuse_edges`; `stack` is scratch.
    """
    vert, twin, fresh, face_states = mesh.vert, mesh.twin, changes.fresh, changes.face_states
    flips = 0
    before = int(fresh[0])
    for i in range(1, obtuse_edges[0] + 1):
        if vert[obtuse_edges[i]] >= 0:
            flips += _flip_from(mesh, obtuse_edges[i], limits, changes, stack)
    obtuse_edges[0] = 0
    for i in range(1, before + 1):
        f = fresh[i]
        if vert[np.uint64(3 * f)] < 0:
            continue
        for h in range(3 * f, 3 * f + 3):
            k = twin[np.uint64(h)]
            if k < 0 or (face_states[np.uint64(k) // np.uint64(3)] == FRESH and not limits.bends):
                continue
            if limits.bends or _facing_obtuse(mesh, k // 3) == k:
                flips += _flip_from(mesh, k, limits, changes, stack)
        h = _facing_obtuse(mesh, f)
        if h >= 0:
            flips += _flip_from(mesh, h, limits, changes, stack)
    return flips


@kernel(numba.boolean(MESH_ARRAYS, numba.int64, LIMITS), **LEAN)
def can_untangle(mesh: MeshArrays, h: int, limits: Limits) -> bool:
    """Tell whether fewer faces look inwards at rest, or oppose their normals, once the edge of h is flipped.

    The edge must be soft, the new one within its length limits, and no face may fold now: none turns by more
    than the angle of MAX_TURN_COSINE from the mean of both. A face that opposes its normals is folded: to
    mend it, faces may turn by any angle, and the new edge may be short.
    """
    points, vert, twin = mesh.points, mesh.vert, mesh.twin
    i = np.uint64(h)
    if twin[i] < 0 or mesh.tagged[i]:
        return False
    a, b, c, d = vert[i], vert[after(i)], vert[before(i)], vert[before(np.uint64(twin[i]))]
    at_rest, now = wrong_by_flip(mesh, limits, a, b, c, d)
    if max(at_rest, now) > 0 or at_rest + now == 0:
        return False
    crossing, (max_squared, min_squared) = squared_length(points, c, d), length_limits(mesh, limits, c, d)
    if crossing > max_squared:
        return False
    if now == 0 and (crossing < min_squared or folds_by_flip(points, a, b, c, d, MAX_TURN_COSINE)):
        return False
    return not are_adjacent(mesh, before(i), d)


@kernel(numba.boolean(MESH_ARRAYS, numba.int64, LIMITS), **LEAN)
def _looks_inwards(mesh: MeshArrays, f: int, limits: Limits) -> bool:
    """Tell whether a face exists and does not face outwards at rest, or opposes its normals now."""
    vert, i = mesh.vert, np.uint64(3 * f)
    a, b, c = vert[i], vert[after(i)], vert[before(i)]
    if a < 0:
        return False
    return is_inverted(mesh.attributes, limits, a, b, c) or opposes_normals(mesh, limits, a, b, c)


@kernel(_PAIR(MESH_ARRAYS, INTS, LIMITS, CHANGES))
def untangle(mesh: MeshArrays, faces: Indices, limits: Limits, changes: Changes) -> tuple[int, int]:
    """Flip an edge of each face that looks inwards at rest or opposes its normals, where fewer then do.

    Returns how many edges were flipped, and for how many faces none was. New edges that are short are queued.
    """
    flips, left = 0, 0
    for f in faces:
        if not _looks_inwards(mesh, f, limits):
            continue
        left += 1
        for h in range(3 * f, 3 * f + 3):
            if can_untangle(mesh, h, limits):
                flip_and_touch(mesh, h, changes)
                if is_short(mesh, h, limits):
                    enqueue(changes, h)
                flips, left = flips + 1, left - 1
                break
    return flips, left


@kernel(numba.int64(MESH_ARRAYS, LIMITS, CHANGES))
def count_tangled(mesh: MeshArrays, limits: Limits, changes: Changes) -> int:
    """Return how many of the faces that have changed look inwards at rest, or oppose their normals."""
    count = 0
    for i in range(1, changes.changed[0] + 1):
        count += _looks_inwards(mesh, changes.changed[i], limits)
    return count
