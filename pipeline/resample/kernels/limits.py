"""Limits and changes of one resample pass, as its kernels take them, and the measures compared with limits.

A work list is an int32 array whose first entry counts the items after it. Pushing onto a full list does
nothing; a list that must not lose items has room for all that it could hold.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from pipeline.arrays import AnyArray, Indices, Points
from pipeline.kernels import kernel
from pipeline.mesh.kernels.halfedge import BYTES, INTS, LEAN, MATRIX, MESH_ARRAYS, MeshArrays, after


class Limits(NamedTuple):
    """The thresholds of one frame.

    The limit of an edge is the geometric mean of the limits at its two ends, which needs no root: kernels
    compare squared lengths.
    """

    max_edge_length: float  # scene units; where limits vary, the largest of all
    min_edge_length: float  # scene units; where limits vary, the smallest of all
    hard_cosine: float  # cosine of hard_angle
    merges_at_midpoint: bool = True  # two soft ends merge halfway, or else at one of them
    field_column: int = -1  # in `MeshArrays.attributes`: maximum, minimum and cosine, if they vary; else -1
    longest_share: float = 1.0  # of a triangle's longest side in its summed squared sides; above it is obtuse
    squared_slack: float = 1.0  # factor on the squared maximum for edges that a collapse makes
    rest_column: int = -1  # in `MeshArrays.attributes`: position at rest; -1 if there is none
    rest_normal_column: int = -1  # in `MeshArrays.attributes`: normal at rest; -1 if there is none
    hard_by_angle: bool = True  # edges beyond hard_angle are hard in this frame; else tagged ones alone


_F, _I = numba.float64, numba.int64
LIMITS = numba.types.NamedTuple([_F, _F, _F, numba.boolean, _I, _F, _F, _I, _I, numba.boolean], Limits)
_PAIR = numba.types.UniTuple(numba.float64, 2)
_TRIPLE = numba.types.UniTuple(numba.float64, 3)


@kernel(_PAIR(MESH_ARRAYS, numba.int64, numba.int64, numba.int64), **LEAN)
def varying_limits(mesh: MeshArrays, column: int, a: int, b: int) -> tuple[float, float]:
    """Return the largest and the smallest squared length of an edge, by the limits of its vertices."""
    limits = mesh.attributes
    return limits[a, column] * limits[b, column], limits[a, column + 1] * limits[b, column + 1]


@kernel(_PAIR(MESH_ARRAYS, LIMITS, numba.int64, numba.int64), **LEAN)
def length_limits(mesh: MeshArrays, limits: Limits, a: int, b: int) -> tuple[float, float]:
    """Return the largest and the smallest squared length that an edge between a and b may have."""
    if limits.field_column >= 0:
        return varying_limits(mesh, limits.field_column, a, b)
    longest, shortest = limits.max_edge_length, limits.min_edge_length
    return longest * longest, shortest * shortest


ONLY_TAGGED = -2.0
"""The cosine that makes no edge hard by its angle, and none by a rounding error."""


@kernel(numba.float64(MESH_ARRAYS, LIMITS, numba.int64), **LEAN)
def corner_cosine(mesh: MeshArrays, limits: Limits, v: int) -> float:
    """Return the cosine of the turn above which a crease has a corner at vertex v."""
    column = limits.field_column
    return float(limits.hard_cosine if column < 0 else mesh.attributes[v, column + 2])


@kernel(numba.float64(MESH_ARRAYS, LIMITS, numba.int64), **LEAN)
def hard_cosine(mesh: MeshArrays, limits: Limits, v: int) -> float:
    """Return the cosine of the angle above which an edge at vertex v is hard."""
    return corner_cosine(mesh, limits, v) if limits.hard_by_angle else ONLY_TAGGED


@kernel(numba.float64(MATRIX, numba.int64, numba.int64), **LEAN)
def squared_length(points: Points, a: int, b: int) -> float:
    """Return the squared distance between two vertices."""
    u, v = np.uint64(a), np.uint64(b)  # unsigned: a signed index costs a test for negative ones
    x = points[u, 0] - points[v, 0]
    y = points[u, 1] - points[v, 1]
    z = points[u, 2] - points[v, 2]
    return float(x * x + y * y + z * z)


@kernel(numba.boolean(MESH_ARRAYS, numba.int64, LIMITS), **LEAN)
def is_short(mesh: MeshArrays, h: int, limits: Limits) -> bool:
    """Tell whether the edge of half-edge h is shorter than its minimum."""
    k = np.uint64(h)
    a, b = mesh.vert[k], mesh.vert[after(k)]
    return bool(squared_length(mesh.points, a, b) < length_limits(mesh, limits, a, b)[1])


@kernel(_TRIPLE(MATRIX, numba.int64, numba.int64, numba.int64), **LEAN)
def area_vector(points: Points, a: int, b: int, c: int) -> tuple[float, float, float]:
    """Return the normal of triangle abc, with twice its area as length."""
    i, j, k = np.uint64(a), np.uint64(b), np.uint64(c)
    ux, uy, uz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    vx, vy, vz = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1], points[k, 2] - points[i, 2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


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


def work_list(room: int) -> Indices:
    """Return an empty work list with room for that many items."""
    items = np.empty(room + 1, np.int32)
    items[0] = 0
    return items


def items_of(items: Indices) -> Indices:
    """Return the items of a work list."""
    return items[1 : 1 + items[0]]
