"""Work lists of the resampling kernels, and the record of what a pass has changed.

A work list is an int32 array whose first entry counts the items after it. Pushing onto a full list does
nothing; a list that must not lose items has room for all that it could hold.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from pipeline.arrays import AnyArray, Indices
from pipeline.kernels import kernel
from pipeline.mesh.kernels.halfedge import BYTES, INTS, LEAN, MESH_ARRAYS, MeshArrays, after
from pipeline.resample.kernels.limits import LIMITS, Limits, length_limits, squared_length

UNCHANGED, CHANGED, FRESH = 0, 1, 2
"""States of a face: not changed in this pass, changed, or changed since refused edges were last requeued."""

UNLISTED, QUEUED, REFUSED = 0, 1, 2
"""States of a half-edge: not in `short_edges`, in it and queued, or in it and refused (plus the reason)."""


class Changes(NamedTuple):
    """The faces that a pass has changed, and the short edges that it has not collapsed.

    Every short edge stands in `short_edges` by one of its half-edges or both. A refused edge waits there
    until a face at one of its ends changes: nothing else can make it collapsible.
    """

    face_states: AnyArray  # (F,) uint8: UNCHANGED, CHANGED or FRESH
    changed: Indices  # work list of changed faces, each once
    fresh: Indices  # work list of FRESH faces, each once
    edge_states: AnyArray  # (3F,) uint8: UNLISTED, QUEUED, or REFUSED + the reason
    short_edges: Indices  # work list of half-edges


CHANGES = numba.types.NamedTuple([BYTES, INTS, INTS, BYTES, INTS], Changes)


@kernel((INTS, numba.int64), **LEAN)
def push(items: Indices, item: int) -> None:
    """Append an item to a work list, unless the list is full."""
    n = items[0] + 1
    if n < len(items):
        items[np.uint64(n)] = item
        items[0] = n


@kernel((CHANGES, numba.int64), **LEAN)
def touch(changes: Changes, f: int) -> None:
    """Record that a face has changed."""
    states, i = changes.face_states, np.uint64(f)
    if states[i] == FRESH:
        return
    if states[i] == UNCHANGED:
        push(changes.changed, f)
    states[i] = FRESH
    push(changes.fresh, f)


@kernel((CHANGES, numba.int64), **LEAN)
def enqueue(changes: Changes, h: int) -> None:
    """Queue the edge of half-edge h for a collapse, unless it is listed already."""
    i = np.uint64(h)
    if changes.edge_states[i] == UNLISTED:
        changes.edge_states[i] = QUEUED
        push(changes.short_edges, h)


@kernel((MESH_ARRAYS, numba.int64, LIMITS, INTS, CHANGES), **LEAN)
def classify_edge(mesh: MeshArrays, h: int, limits: Limits, long_edges: Indices, changes: Changes) -> None:
    """List a new or moved edge among the long or the short edges if it is outside its limits."""
    k = np.uint64(h)
    a, b = mesh.vert[k], mesh.vert[after(k)]
    length = squared_length(mesh.points, a, b)
    max_squared, min_squared = length_limits(mesh, limits, a, b)
    if length > max_squared:
        push(long_edges, h)
    elif length < min_squared:
        enqueue(changes, h)
