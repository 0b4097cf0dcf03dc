"""Replay births, the splits of edges that refined a surface, in their order and on the same half-edges."""

from __future__ import annotations

import numba
import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Indices
from flowsculpt.pipeline.kernels import kernel
from flowsculpt.pipeline.mesh.kernels.halfedge import (
    LEAN,
    MESH_ARRAYS,
    MeshArrays,
    following,
    preceding,
)
from flowsculpt.pipeline.resample.kernels.split import split_edge

_TABLE = numba.int32[:, ::1]


@kernel(numba.int64(MESH_ARRAYS, numba.int64, numba.int64), **LEAN)
def _between(mesh: MeshArrays, start: int, b: int) -> int:
    """Return the half-edge to vertex b from the start of half-edge `start`; -1 where there is none."""
    vert, twin = mesh.vert, mesh.twin
    k = start
    while True:
        if vert[following(k)] == b:
            return k
        k = twin[preceding(k)]
        if k < 0 or k == start:
            break
    k = start
    while k >= 0 and twin[k] >= 0:  # the fan is open: on to its other side
        k = following(twin[k])
        if k == start:
            break
        if vert[following(k)] == b:
            return k
    return -1


@kernel(numba.int64(MESH_ARRAYS, numba.int64[::1], _TABLE, _TABLE))
def replay_births(mesh: MeshArrays, sizes: AnyArray, births: Indices, opposite: Indices) -> int:
    """Split the edges of births (N, 2), parents a and b of each; return how many of them were edges.

    opposite  (N, 2) receives the corners opposite each edge, c left of a→b and d right of it; -1 at a
              boundary

    The arrays must have room. Positions and attributes of the new vertices are left to the caller. It ends at
    the first birth whose parents are not the ends of an edge.
    """
    vert, twin = mesh.vert, mesh.twin
    leaving = np.full(sizes[0] + len(births), -1, np.int32)  # a half-edge of each vertex
    for h in range(3 * sizes[1]):
        leaving[vert[h]] = h
    for i in range(len(births)):
        a, b = births[i, 0], births[i, 1]
        h = _between(mesh, leaving[a], b)
        if h < 0:
            return i
        middle, first, back = sizes[0], sizes[1], twin[h]
        opposite[i, 0], opposite[i, 1] = vert[preceding(h)], -1
        if back >= 0:
            opposite[i, 1] = vert[preceding(back)]
        sizes[0] = middle + 1
        sizes[1] = split_edge(mesh, h, middle, first)
        for k in range(3 * (h // 3), 3 * (h // 3) + 3):
            leaving[vert[k]] = k
        if back >= 0:
            for k in range(3 * (back // 3), 3 * (back // 3) + 3):
                leaving[vert[k]] = k
        for k in range(3 * first, 3 * sizes[1]):
            leaving[vert[k]] = k
    return len(births)
