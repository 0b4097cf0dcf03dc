"""Kernels of the corner table: half-edge ``3f + i`` runs from corner ``i`` of face ``f`` to the next.

`vert[h]` is the start of half-edge h, `twin[h]` the half-edge that runs back along the same edge, or -1 on a
boundary. A removed face has `vert` -1 until the table is compacted.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Floats, Indices
from flowsculpt.pipeline.kernels import kernel, only_read

SOUND, CROWDED, DISAGREEING = 0, 1, 2
_BLOCK, _PART = 48, 48 << 12  # half-edges in one block, and per thread

LEAN: dict[str, Any] = {"_nrt": False, "error_model": "numpy", "forceinline": True}
"""Options for kernels that allocate nothing.

Without numba's run-time system no call counts references to its arrays, which costs small helpers several
times their own work.
"""

LEAN_CALLS: dict[str, Any] = {**LEAN, "forceinline": False}
"""LEAN for large kernels that others call in several places: each of these would compile them once more."""


class MeshArrays(NamedTuple):
    """The arrays of a half-edge mesh, with room to grow, as kernels take them."""

    points: Floats  # (V, 3)
    attributes: Floats  # (V, K): the vertex attributes, side by side
    blends: Floats  # (K,): 1 where a column mixes its parents' values, 0 where it inherits one of them
    vert: Indices  # (3F,) vertex at the start of each half-edge
    twin: Indices  # (3F,) half-edge back along the same edge, -1 on a boundary
    tagged: AnyArray  # (3F,) uint8: 1 at both half-edges of an edge that is hard whatever its angle


# unsigned: a remainder costs half as much
_ZERO, _ONE, _TWO, _THREE = np.uint64(0), np.uint64(1), np.uint64(2), np.uint64(3)
INTS = numba.int32[::1]
MATRIX = numba.float64[:, ::1]
VECTOR = numba.float64[::1]
BYTES = numba.uint8[::1]
CONST_INTS, CONST_MATRIX, CONST_VECTOR = (only_read(kind) for kind in (INTS, MATRIX, VECTOR))
MESH_ARRAYS = numba.types.NamedTuple([MATRIX, MATRIX, VECTOR, INTS, INTS, BYTES], MeshArrays)


@kernel("int64(int64)", **LEAN)
def following(h: int) -> int:
    """Return the half-edge after h in its face."""
    return h - 2 if np.uint64(h) % _THREE == _TWO else h + 1


@kernel("int64(int64)", **LEAN)
def preceding(h: int) -> int:
    """Return the half-edge before h in its face."""
    return h + 2 if np.uint64(h) % _THREE == _ZERO else h - 1


@kernel("uint64(uint64)", **LEAN)
def after(h: np.uint64) -> np.uint64:
    """Return `following(h)`, unsigned: as an index it needs no test for negative values."""
    return h - _TWO if h % _THREE == _TWO else h + _ONE


@kernel("uint64(uint64)", **LEAN)
def before(h: np.uint64) -> np.uint64:
    """Return `preceding(h)`, unsigned."""
    return h + _TWO if h % _THREE == _ZERO else h - _ONE


@kernel("void(int32[::1], int64, int64)", **LEAN)
def join(twin: Indices, h: int, k: int) -> None:
    """Make h and k each other's twin; either may be -1, the outside."""
    if h >= 0:
        twin[h] = k
    if k >= 0:
        twin[k] = h


@kernel(numba.types.UniTuple(numba.int64, 2)(CONST_INTS, numba.int64, INTS))
def match_twins(vert: Indices, vertices: int, twin: Indices) -> tuple[int, int]:
    """Fill `twin` from `vert`; return (SOUND, -1), or the fault and a half-edge with it.

    CROWDED: an edge has more than two faces. DISAGREEING: its two faces are oriented differently. A counting
    sort puts the half-edges into one bucket per lower vertex, each with its higher one, so that an edge is
    only searched among the few that share that vertex.
    """
    start = np.zeros(vertices + 1, np.int32)
    for h in range(len(vert)):
        start[min(vert[h], vert[following(h)]) + 1] += 1
    for v in range(vertices):
        start[v + 1] += start[v]
    filled = start[:-1].copy()
    bucket, higher = np.empty(len(vert), np.int32), np.empty(len(vert), np.int32)
    for h in range(len(vert)):
        one, other = vert[h], vert[following(h)]
        low = min(one, other)
        bucket[filled[low]], higher[filled[low]] = h, max(one, other)
        filled[low] += 1
        twin[h] = -1
    for low in range(vertices):
        for i in range(start[low], start[low + 1]):
            if higher[i] < 0:
                continue
            mate = -1
            for j in range(i + 1, start[low + 1]):
                if higher[j] == higher[i]:
                    if mate >= 0:
                        return CROWDED, bucket[i]
                    mate = j
            if mate >= 0:
                h, k = bucket[i], bucket[mate]
                if vert[k] == vert[h]:
                    return DISAGREEING, h
                join(twin, h, k)
                higher[mate] = -1
    return SOUND, -1


@kernel("int64(int32[::1], int64)", **LEAN)
def fan_start(twin: Indices, h: int) -> int:
    """Return the most clockwise half-edge that leaves the vertex of h; h itself in a closed fan."""
    k = h
    while twin[k] >= 0:
        k = following(twin[k])
        if k == h:
            break
    return k


@kernel("int64(int32[::1], int32[::1], int64)")
def find_nonmanifold_vertex(vert: Indices, twin: Indices, vertices: int) -> int:
    """Return the first vertex whose corners form more than one fan, or -1."""
    corners = np.zeros(vertices, np.int32)
    for h in range(len(vert)):
        corners[vert[h]] += 1
    for h in range(len(vert)):
        v = vert[h]
        if corners[v] < 0:
            continue
        first = fan_start(twin, h)
        k, reached = first, 0
        while True:
            reached += 1
            k = twin[preceding(k)]
            if k < 0 or k == first:
                break
        if reached < corners[v]:
            return int(v)
        corners[v] = -1
    return -1


@kernel((INTS, numba.int64, numba.int64, numba.int64, INTS), **LEAN)
def _renumber(vert: Indices, first: int, last: int, vertices: int, new_numbers: Indices) -> None:
    """Replace vertices from `vertices` on by their new numbers in vert[first:last].

    Few change, so a whole block is tested first, which takes no branches.
    """
    for start in range(first, last, _BLOCK):
        block = vert[start : min(start + _BLOCK, last)]
        any_moved = False
        for v in block:
            any_moved |= v >= vertices
        if any_moved:
            for i in range(len(block)):
                if block[i] >= vertices:
                    block[i] = new_numbers[block[i] - vertices]


@kernel((INTS, numba.int64, numba.int64, INTS))
def renumber(vert: Indices, halfedges: int, vertices: int, new_numbers: Indices) -> None:
    """Replace the vertices from `vertices` on by their new numbers in all faces."""
    _renumber(vert, 0, halfedges, vertices, new_numbers)


@kernel((INTS, numba.int64, numba.int64, INTS), parallel=True)
def renumber_parallel(vert: Indices, halfedges: int, vertices: int, new_numbers: Indices) -> None:
    """Run `renumber` on several threads."""
    for part in numba.prange(-(-halfedges // _PART)):
        _renumber(vert, _PART * part, min(_PART * (part + 1), halfedges), vertices, new_numbers)


@kernel((INTS, INTS, numba.int64, INTS))
def renumber_listed(vert: Indices, faces: Indices, vertices: int, new_numbers: Indices) -> None:
    """Replace the vertices from `vertices` on by their new numbers in these faces."""
    for f in faces:
        for h in range(3 * f, 3 * f + 3):
            if vert[h] >= vertices:
                vert[h] = new_numbers[vert[h] - vertices]


@kernel(numba.boolean(MESH_ARRAYS, numba.int64[::1], INTS, INTS))
def close_vertex_gaps(mesh: MeshArrays, sizes: Indices, dead_vertices: Indices, new_numbers: Indices) -> bool:
    """Close the gaps of removed vertices by moving the last ones into them; return whether any has moved.

    `sizes` holds the numbers of vertices, removed ones included, and of faces; the first is updated. The list
    must be sorted. `new_numbers`, with an entry for each vertex from the new size on, receives those that the
    faces are to be updated with. The cost depends on the gaps only, not on the mesh.
    """
    points, attributes = mesh.points, mesh.attributes
    vertices = sizes[0] - len(dead_vertices)
    hole, skip = 0, np.searchsorted(dead_vertices, vertices)
    for v in range(vertices, sizes[0]):
        if skip < len(dead_vertices) and dead_vertices[skip] == v:
            skip += 1
            new_numbers[v - vertices] = -1
            continue
        target = dead_vertices[hole]
        hole += 1
        new_numbers[v - vertices] = target
        for k in range(3):
            points[target, k] = points[v, k]
        for k in range(attributes.shape[1]):
            attributes[target, k] = attributes[v, k]
    sizes[0] = vertices
    return hole > 0


@kernel((MESH_ARRAYS, numba.int64[::1], INTS))
def close_face_gaps(mesh: MeshArrays, sizes: Indices, dead_faces: Indices) -> None:
    """Close the gaps of removed faces by moving the last ones into them, and update their number.

    The list must be sorted. The cost depends on the gaps only, not on the mesh.
    """
    vert, twin, tagged = mesh.vert, mesh.twin, mesh.tagged
    faces, last = sizes[1] - len(dead_faces), sizes[1] - 1
    for f in dead_faces:
        while last >= 0 and vert[3 * last] < 0:
            last -= 1
        if f >= faces:
            break
        for i in range(3):
            vert[3 * f + i] = vert[3 * last + i]
            tagged[3 * f + i] = tagged[3 * last + i]
            join(twin, 3 * f + i, twin[3 * last + i])
        last -= 1
    sizes[1] = faces


@kernel(numba.types.Tuple([INTS, INTS, BYTES])(MESH_ARRAYS, INTS, numba.int64[::1]))
def reordered(mesh: MeshArrays, numbers: Indices, face_order: Indices) -> tuple[Indices, Indices, AnyArray]:
    """Return `vert`, `twin` and `tagged` with other numbers of vertices and faces.

    numbers     (V,) the new number of each vertex
    face_order  (F,) the old numbers of the faces, in their new order
    """
    faces = len(face_order)
    new_faces = np.empty(faces, np.int32)
    for f in range(faces):
        new_faces[face_order[f]] = f
    vert, twin = np.empty(3 * faces, np.int32), np.empty(3 * faces, np.int32)
    tagged = np.empty(3 * faces, np.uint8)
    for f in range(faces):
        for i in range(3):
            old = 3 * face_order[f] + i
            back = mesh.twin[old]
            vert[3 * f + i] = numbers[mesh.vert[old]]
            twin[3 * f + i] = -1 if back < 0 else 3 * new_faces[back // 3] + back % 3
            tagged[3 * f + i] = mesh.tagged[old]
    return vert, twin, tagged
