"""Scans of all edges: those outside their limits, the range of lengths, curvature along them, gradation.

Edges outside their limits are searched in all faces once, then in changed ones. The first search only flags
faces with an edge outside its limits or a wide corner. It takes no branches and works in chunks of faces,
which threads may share without influence on the result. Lengths are summarised by blocks of faces, so that a
second look costs little more than the changed part of the surface.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from flowsculpt.pipeline.arrays import Faces, Floats, Indices, Points, Vectors
from flowsculpt.pipeline.kernels import kernel
from flowsculpt.pipeline.mesh.kernels.halfedge import (
    INTS,
    LEAN,
    MATRIX,
    MESH_ARRAYS,
    VECTOR,
    MeshArrays,
    following,
)
from flowsculpt.pipeline.resample.kernels.pass_state import (
    CHANGES,
    FRESH,
    LIMITS,
    UNCHANGED,
    Changes,
    Limits,
    enqueue,
    length_limits,
    push,
    squared_length,
    varying_limits,
)

BLOCK = 16
CHUNK = 1 << 15  # faces; a multiple of BLOCK
FACES = numba.int32[:, ::1]
_PAIR = numba.types.UniTuple(numba.float64, 2)
_TRIPLE = numba.types.UniTuple(numba.float64, 3)


@kernel(_TRIPLE(MESH_ARRAYS, numba.int64), **LEAN)
def _squared_sides(mesh: MeshArrays, f: int) -> tuple[float, float, float]:
    """Return the squared lengths of the three edges of face f."""
    points, vert = mesh.points, mesh.vert
    h = np.uint64(3 * f)
    a, b, c = vert[h], vert[h + np.uint64(1)], vert[h + np.uint64(2)]
    return squared_length(points, a, b), squared_length(points, b, c), squared_length(points, c, a)


@kernel(_PAIR(numba.float64, numba.float64, numba.float64), **LEAN)
def _min_max(x: float, y: float, z: float) -> tuple[float, float]:
    """Return the smallest and largest of three numbers without branches; `min` and `max` branch for nan."""
    min_squared, max_squared = x if x < y else y, x if x > y else y
    return z if z < min_squared else min_squared, z if z > max_squared else max_squared


@kernel(_PAIR(numba.float64, numba.float64, numba.float64, numba.float64), **LEAN)
def _widened(low: float, high: float, small: float, large: float) -> tuple[float, float]:
    """Return the range low..high extended by small and large."""
    return small if small < low else low, large if large > high else high


@kernel(numba.boolean(MESH_ARRAYS, numba.int64, numba.float64, numba.int64), **LEAN)
def _is_outside(mesh: MeshArrays, h: int, length: float, column: int) -> bool:
    """Tell whether the edge of h, of that squared length, is outside the limits of its vertices."""
    max_squared, min_squared = varying_limits(mesh, column, mesh.vert[h], mesh.vert[following(h)])
    return bool((length > max_squared) | (length < min_squared))


@kernel(numba.float64(MESH_ARRAYS, numba.int64, numba.int64, LIMITS, INTS, INTS, MATRIX), **LEAN)
def _flag_chunk(
    mesh: MeshArrays,
    chunk: int,
    faces: int,
    limits: Limits,
    flagged: Indices,
    counts: Indices,
    block_ranges: Points,
) -> float:
    """Run `flag_faces` on one chunk."""
    max_squared = limits.max_edge_length * limits.max_edge_length
    min_squared = limits.min_edge_length * limits.min_edge_length
    longest_share, column = limits.longest_share, limits.field_column
    first, last = CHUNK * chunk, min(CHUNK * (chunk + 1), faces)
    start = first + chunk  # each chunk has a spare entry: the next one is written before it counts
    count, total = 0, 0.0
    for block in range(first // BLOCK, -(-last // BLOCK)):
        low, high = np.inf, 0.0
        for f in range(BLOCK * block, min(BLOCK * (block + 1), last)):
            ab, bc, ca = _squared_sides(mesh, f)
            small, large = _min_max(ab, bc, ca)
            total_squared = ab + bc + ca
            total += total_squared
            out = (large > max_squared) | (small < min_squared)
            if column >= 0:  # the test stays out of `_is_outside`, or each edge pays for it
                out = _is_outside(mesh, 3 * f, ab, column) | _is_outside(mesh, 3 * f + 1, bc, column)
                out |= _is_outside(mesh, 3 * f + 2, ca, column)
            flagged[np.uint64(start + count)] = f
            count += out | (large > longest_share * total_squared)
            low, high = _widened(low, high, np.inf if out else small, 0.0 if out else large)
        block_ranges[block, 0], block_ranges[block, 1] = low, high
    counts[chunk] = count
    return total


@kernel(numba.float64(MESH_ARRAYS, numba.int64, LIMITS, INTS, INTS, MATRIX))
def flag_faces(
    mesh: MeshArrays, faces: int, limits: Limits, flagged: Indices, counts: Indices, block_ranges: Points
) -> float:
    """Flag faces with an edge outside its limits or a corner much wider than a right angle.

    Returns a sum that is finite if all lengths are. Chunk c writes its `counts[c]` faces into `flagged` from
    (CHUNK + 1) c on. `block_ranges` (blocks, 2) receives the smallest and largest squared length of each
    block, over the faces within limits. No face may be removed.
    """
    total = 0.0
    for chunk in range(len(counts)):
        total += _flag_chunk(mesh, chunk, faces, limits, flagged, counts, block_ranges)
    return total


@kernel(numba.float64(MESH_ARRAYS, numba.int64, LIMITS, INTS, INTS, MATRIX), parallel=True)
def flag_faces_parallel(
    mesh: MeshArrays, faces: int, limits: Limits, flagged: Indices, counts: Indices, block_ranges: Points
) -> float:
    """Run `flag_faces` on several threads."""
    totals = np.empty(len(counts))
    for chunk in numba.prange(len(counts)):
        totals[chunk] = _flag_chunk(mesh, chunk, faces, limits, flagged, counts, block_ranges)
    return float(totals.sum())


@kernel((MESH_ARRAYS, LIMITS, INTS, INTS, INTS, INTS, CHANGES))
def list_flagged_edges(
    mesh: MeshArrays,
    limits: Limits,
    flagged: Indices,
    counts: Indices,
    long_edges: Indices,
    obtuse_edges: Indices,
    changes: Changes,
) -> None:
    """List each edge of the flagged faces outside its limits once, and the edges opposite wide corners."""
    vert, twin = mesh.vert, mesh.twin
    for chunk in range(len(counts)):
        start = (CHUNK + 1) * chunk
        for i in range(start, start + counts[chunk]):
            f = flagged[i]
            ab, bc, ca = _squared_sides(mesh, f)
            large = max(ab, bc, ca)
            if large > limits.longest_share * (ab + bc + ca):
                push(obtuse_edges, 3 * f if large == ab else (3 * f + 1 if large == bc else 3 * f + 2))
            for h in range(3 * f, 3 * f + 3):
                length = ab if h == 3 * f else (bc if h == 3 * f + 1 else ca)
                max_squared, min_squared = length_limits(mesh, limits, vert[h], vert[following(h)])
                if (length > max_squared or length < min_squared) and twin[h] < h:
                    if length > max_squared:
                        push(long_edges, h)
                    else:
                        enqueue(changes, h)


@kernel((MESH_ARRAYS, LIMITS, CHANGES, INTS))
def list_long_edges(mesh: MeshArrays, limits: Limits, changes: Changes, long_edges: Indices) -> None:
    """List the edges of FRESH faces that are too long, each once."""
    vert, twin, fresh = mesh.vert, mesh.twin, changes.fresh
    for i in range(1, fresh[0] + 1):
        if vert[3 * fresh[i]] < 0:
            continue
        for h in range(3 * fresh[i], 3 * fresh[i] + 3):
            a, b = vert[h], vert[following(h)]
            first = twin[h] < h or changes.face_states[twin[h] // 3] != FRESH
            if first and squared_length(mesh.points, a, b) > length_limits(mesh, limits, a, b)[0]:
                push(long_edges, h)


@kernel(_PAIR(MESH_ARRAYS, numba.int64, CHANGES, MATRIX))
def length_range(mesh: MeshArrays, faces: int, changes: Changes, block_ranges: Points) -> tuple[float, float]:
    """Return the smallest and largest squared length now, before the arrays are compacted.

    Measures the changed faces and those of `short_edges`, which `flag_faces` left out of its ranges, and of
    the other faces only blocks that reach beyond the range so far. `faces` is their number before the pass.
    """
    low, high = np.inf, 0.0
    for i in range(1, changes.changed[0] + 1):
        if mesh.vert[3 * changes.changed[i]] >= 0:
            low, high = _widened(low, high, *_min_max(*_squared_sides(mesh, changes.changed[i])))
    for i in range(1, changes.short_edges[0] + 1):
        h = changes.short_edges[i]
        low, high = _widened(low, high, *_min_max(*_squared_sides(mesh, h // 3)))
        back = mesh.twin[h]
        if back >= 0:
            low, high = _widened(low, high, *_min_max(*_squared_sides(mesh, back // 3)))
    for block in range(len(block_ranges)):
        if block_ranges[block, 0] >= low and block_ranges[block, 1] <= high:
            continue
        for f in range(BLOCK * block, min(BLOCK * (block + 1), faces)):
            if changes.face_states[f] == UNCHANGED:
                low, high = _widened(low, high, *_min_max(*_squared_sides(mesh, f)))
    return low, high


@kernel((MATRIX, FACES, MATRIX, numba.float64, VECTOR))
def edge_curvature(
    points: Points, faces: Faces, normals: Vectors, shortest: float, curvature: Floats
) -> None:
    """Compute the largest curvature, in 1 / scene unit, along the edges at every vertex.

    Two unit normals differ by 2 sin(θ/2), and so do the ends of a chord that turns by θ on a unit circle:
    their quotient is the exact curvature of the circle through both. Edges below `shortest` count as that
    long, so that noise in their normals does not pass for curvature.
    """
    curvature[:] = 0.0
    for f in range(len(faces)):
        for i in range(3):
            a, b = faces[f, i], faces[f, (i + 1) % 3]
            length = max(math.sqrt(squared_length(points, a, b)), shortest)
            bent = math.sqrt(squared_length(normals, a, b)) / length
            curvature[a] = max(curvature[a], bent)
            curvature[b] = max(curvature[b], bent)


@kernel(numba.boolean(VECTOR, numba.int64, numba.int64, numba.float64))
def _lower_longer(lengths: Floats, a: int, b: int, rise: float) -> bool:
    """Lower the longer of two lengths to the other plus `rise`, if it is above; return whether it was."""
    if lengths[a] > lengths[b] + rise:
        lengths[a] = lengths[b] + rise
    elif lengths[b] > lengths[a] + rise:
        lengths[b] = lengths[a] + rise
    else:
        return False
    return True


@kernel(numba.int64(MATRIX, FACES, numba.float64, VECTOR))
def limit_gradation(points: Points, faces: Faces, slope: float, lengths: Floats) -> int:
    """Lower lengths until they differ by at most slope × distance along every edge; return the sweeps taken.

    Each length becomes the least, over all paths along edges, of the length at the path's start plus
    slope × the path's length. Rounding keeps the order of sums, so the order of sweeps changes no bit. Sweeps
    alternate in direction, since vertices lie in memory much as they lie on the surface.
    """
    last = len(faces) - 1
    rises = np.empty((len(faces), 3))
    for f in range(len(faces)):
        for i in range(3):
            rises[f, i] = slope * math.sqrt(squared_length(points, faces[f, i], faces[f, (i + 1) % 3]))
    sweeps, changed = 0, True
    while changed:
        changed = False
        for j in range(len(faces)):
            f = j if sweeps % 2 == 0 else last - j
            for i in range(3):
                if _lower_longer(lengths, faces[f, i], faces[f, (i + 1) % 3], rises[f, i]):
                    changed = True
        sweeps += 1
    return sweeps
