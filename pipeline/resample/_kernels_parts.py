"""Tidying a large surface in parts, which threads may share.

Parts are slabs of space between planes across one axis. An edge may collapse in its part if all vertices of
the rings of both its ends lie in the slab, and be turned there if all four corners of its faces do. So what
threads write at the same time are faces of different slabs and vertices that such faces alone meet; faces
between slabs, and the positions of their vertices, stay as they are, and may be read by all. Slabs are
convex: a vertex that moves halfway to another stays in its own. What crosses planes is left for later.

The parts depend on the surface alone, so that the same bits come out whatever the number of threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices
from pipeline.kernels import kernel
from pipeline.mesh._kernels_halfedge import INTS, LEAN, SURFACE, VECTOR, Surface
from pipeline.resample._kernels_collapse import ELSEWHERE, collapse_due, recall
from pipeline.resample._kernels_flip import MOST_AGAIN, flip_fresh
from pipeline.resample._kernels_lists import CHANGES, DUE, REFUSED, Changes, after, push, touch
from pipeline.resample._kernels_ring import blank_ring

PARTS = 4
TABLE = numba.int32[:, ::1]
_COUNTS = numba.int64[:, ::1]
_DEAD = numba.types.UniTuple(INTS, 2)


class Shares(NamedTuple):
    """The work lists of the parts, a row for each."""

    changed: Indices  # (PARTS, …) and so on, like those of `Changes`
    fresh: Indices
    shorts: Indices
    dead_faces: Indices
    dead_vertices: Indices
    obtuse: Indices
    later: Indices  # faces whose edges could not be turned in their part, to be looked at afterwards


SHARES = numba.types.NamedTuple([TABLE] * 7, Shares)


@kernel(numba.int64(SURFACE, VECTOR, numba.int64, numba.int64), **LEAN)
def _part_of(surface: Surface, planes: Floats, axis: int, v: int) -> int:
    """The part in which a vertex lies."""
    x, part = surface.points[np.uint64(v), np.uint64(axis)], 0
    for i in range(1, PARTS):
        part += x >= planes[i]
    return part


@kernel((SURFACE, VECTOR, numba.int64, CHANGES, TABLE))
def deal_faces(surface: Surface, planes: Floats, axis: int, changes: Changes, rows: Indices) -> None:
    """Hand the FRESH faces out to the parts in which their first corners lie, but for dead ones."""
    fresh, kept = changes.fresh, 0
    for i in range(1, fresh[0] + 1):
        f = fresh[i]
        v = surface.vert[np.uint64(3 * f)]
        if v >= 0:
            push(rows[_part_of(surface, planes, axis, v)], f)
        else:
            kept += 1
            fresh[kept] = f
    fresh[0] = kept


@kernel((SURFACE, VECTOR, numba.int64, INTS, TABLE))
def deal(surface: Surface, planes: Floats, axis: int, items: Indices, rows: Indices) -> None:
    """Hand the half-edges of a work list out to the parts; the list keeps what is dead or crosses planes."""
    vert, kept = surface.vert, 0
    for i in range(1, items[0] + 1):
        h = items[i]
        a, b = vert[np.uint64(h)], vert[after(np.uint64(h))]
        part = _part_of(surface, planes, axis, a) if a >= 0 else PARTS
        if part < PARTS and part == _part_of(surface, planes, axis, b):
            push(rows[part], h)
        else:
            kept += 1
            items[kept] = h
    items[0] = kept


@kernel((SURFACE, VECTOR, VECTOR, numba.int64, CHANGES, SHARES, _COUNTS), parallel=True)
def tidy_parts(
    surface: Surface,
    limits: Floats,
    planes: Floats,
    axis: int,
    changes: Changes,
    shares: Shares,
    counts: AnyArray,
) -> None:
    """Collapse and flip once, in every part what belongs to it; `counts` gets how many of either."""
    for part in numba.prange(PARTS):
        slab, again = (
            np.array([float(axis), planes[part], planes[part + 1]]),
            np.empty(MOST_AGAIN + 1, np.int32),
        )
        own = Changes(
            changes.marks, shares.changed[part], shares.fresh[part], changes.notes, shares.shorts[part]
        )
        dead_faces, dead_vertices = shares.dead_faces[part], shares.dead_vertices[part]
        obtuse, later = shares.obtuse[part], shares.later[part]
        rings = (blank_ring(), blank_ring())
        counts[part, 0] = collapse_due(surface, limits, rings, own, dead_faces, dead_vertices, slab)
        counts[part, 1] = flip_fresh(surface, limits, own, obtuse, again, slab, later)


@kernel((INTS, TABLE), **LEAN)
def _append(items: Indices, rows: Indices) -> None:
    """Put the work lists of the parts behind one another."""
    for row in range(PARTS):
        many = items[0]
        for i in range(1, rows[row, 0] + 1):
            items[many + i] = rows[row, i]
        items[0] = many + rows[row, 0]


@kernel((SURFACE, CHANGES, _DEAD, SHARES))
def gather(surface: Surface, changes: Changes, dead: tuple[Indices, Indices], shares: Shares) -> None:
    """Put the lists of the parts together, and make due and FRESH what is still to be looked at."""
    shorts, notes, fresh = changes.shorts, changes.notes, changes.fresh
    _append(changes.changed, shares.changed)
    _append(fresh, shares.fresh)
    _append(shorts, shares.shorts)
    _append(dead[0], shares.dead_faces)
    _append(dead[1], shares.dead_vertices)
    for i in range(1, shorts[0] + 1):
        if notes[shorts[i]] == REFUSED + ELSEWHERE:
            notes[shorts[i]] = DUE
    recall(surface, changes)
    for part in range(PARTS):
        for i in range(1, shares.later[part, 0] + 1):
            if surface.vert[3 * shares.later[part, i]] >= 0:
                touch(changes, shares.later[part, i])
