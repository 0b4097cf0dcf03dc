"""Which edges are out of the bracket, and how far the lengths reach: of all edges once, then of what changed.

The first look only finds the odd faces, those with an edge out of the bracket or a wide corner. It takes no
branches, and works in chunks of faces, which threads may share: what is found does not depend on who looked.
Lengths are summed up by blocks of faces, so that a frame that touches a tenth of the surface counts
little more than that tenth again.
"""

from __future__ import annotations

import numba
import numpy as np

from pipeline.arrays import Floats, Indices, Points
from pipeline.kernels import kernel
from pipeline.mesh._kernels_halfedge import INTS, LEAN, MATRIX, SURFACE, VECTOR, Surface, following
from pipeline.resample._kernels_lists import (
    AS_IT_WAS,
    CHANGES,
    FRESH,
    Changes,
    bracket,
    enlist,
    push,
    squared,
)

BLOCK = 16
CHUNK = 1 << 15  # faces; a multiple of BLOCK
_PAIR = numba.types.UniTuple(numba.float64, 2)
_TRIPLE = numba.types.UniTuple(numba.float64, 3)


@kernel(_TRIPLE(SURFACE, numba.int64), **LEAN)
def _sides(surface: Surface, f: int) -> tuple[float, float, float]:
    """Squared lengths of the three edges of a face that is there."""
    points, vert = surface.points, surface.vert
    h = np.uint64(3 * f)
    a, b, c = vert[h], vert[h + np.uint64(1)], vert[h + np.uint64(2)]
    return squared(points, a, b), squared(points, b, c), squared(points, c, a)


@kernel(_PAIR(numba.float64, numba.float64, numba.float64), **LEAN)
def _least_and_most(x: float, y: float, z: float) -> tuple[float, float]:
    """Without branches, unlike `min` and `max`, which care for nan."""
    least, most = x if x < y else y, x if x > y else y
    return z if z < least else least, z if z > most else most


@kernel(_PAIR(numba.float64, numba.float64, numba.float64, numba.float64), **LEAN)
def _wider(low: float, high: float, small: float, large: float) -> tuple[float, float]:
    return small if small < low else low, large if large > high else high


@kernel(numba.boolean(SURFACE, numba.int64, numba.float64, VECTOR), **LEAN)
def _is_out(surface: Surface, h: int, length: float, limits: Floats) -> bool:
    """Whether the edge of h is out of its own bracket, where each has one."""
    most, least = bracket(surface, limits, surface.vert[h], surface.vert[following(h)])
    return bool((length > most) | (length < least))


@kernel(numba.float64(SURFACE, numba.int64, numba.int64, VECTOR, INTS, INTS, MATRIX), **LEAN)
def _find_odd(
    surface: Surface, chunk: int, faces: int, limits: Floats, odd: Indices, counts: Indices, extents: Points
) -> float:
    """The part of `find_odd` for one chunk."""
    most, least, blunt, active = limits[0], limits[1], limits[5], limits[4] >= 0
    first, last = CHUNK * chunk, min(CHUNK * (chunk + 1), faces)
    start = first + chunk  # every chunk has an entry to spare, since the next is written before it is known
    found, total = 0, 0.0
    for block in range(first // BLOCK, -(-last // BLOCK)):
        low, high = np.inf, 0.0
        for f in range(BLOCK * block, min(BLOCK * (block + 1), last)):
            ab, bc, ca = _sides(surface, f)
            small, large = _least_and_most(ab, bc, ca)
            around = ab + bc + ca
            total += around
            out = (large > most) | (small < least)
            if active:
                out = _is_out(surface, 3 * f, ab, limits) | _is_out(surface, 3 * f + 1, bc, limits)
                out |= _is_out(surface, 3 * f + 2, ca, limits)
            odd[np.uint64(start + found)] = f
            found += out | (large > blunt * around)
            low, high = _wider(low, high, np.inf if out else small, 0.0 if out else large)
        extents[block, 0], extents[block, 1] = low, high
    counts[chunk] = found
    return total


@kernel(numba.float64(SURFACE, numba.int64, VECTOR, INTS, INTS, MATRIX))
def find_odd(
    surface: Surface, faces: int, limits: Floats, odd: Indices, counts: Indices, extents: Points
) -> float:
    """Find the faces with an edge out of the bracket or a corner much wider than a right angle.

    Answers a sum that is finite where all lengths are. Chunk c writes its `counts[c]` faces into `odd` from
    (CHUNK + 1) c on. `extents` (blocks, 2) gets the smallest and largest squared length of each block, over
    the faces within the bracket. No face may be missing.
    """
    total = 0.0
    for chunk in range(len(counts)):
        total += _find_odd(surface, chunk, faces, limits, odd, counts, extents)
    return total


@kernel(numba.float64(SURFACE, numba.int64, VECTOR, INTS, INTS, MATRIX), parallel=True)
def find_odd_together(
    surface: Surface, faces: int, limits: Floats, odd: Indices, counts: Indices, extents: Points
) -> float:
    """The same by several threads."""
    totals = np.empty(len(counts))
    for chunk in numba.prange(len(counts)):
        totals[chunk] = _find_odd(surface, chunk, faces, limits, odd, counts, extents)
    return float(totals.sum())


@kernel((SURFACE, VECTOR, INTS, INTS, INTS, INTS, CHANGES))
def list_odd(
    surface: Surface,
    limits: Floats,
    odd: Indices,
    counts: Indices,
    longs: Indices,
    obtuse: Indices,
    changes: Changes,
) -> None:
    """List every edge of the odd faces that is out of the bracket, once, and those that face wide corners."""
    vert, twin = surface.vert, surface.twin
    for chunk in range(len(counts)):
        start = (CHUNK + 1) * chunk
        for i in range(start, start + counts[chunk]):
            f = odd[i]
            ab, bc, ca = _sides(surface, f)
            large = max(ab, bc, ca)
            if large > limits[5] * (ab + bc + ca):
                push(obtuse, 3 * f if large == ab else (3 * f + 1 if large == bc else 3 * f + 2))
            for h in range(3 * f, 3 * f + 3):
                length = ab if h == 3 * f else (bc if h == 3 * f + 1 else ca)
                most, least = bracket(surface, limits, vert[h], vert[following(h)])
                if (length > most or length < least) and twin[h] < h:
                    if length > most:
                        push(longs, h)
                    else:
                        enlist(changes, h)


@kernel((SURFACE, VECTOR, CHANGES, INTS))
def list_long(surface: Surface, limits: Floats, changes: Changes, longs: Indices) -> None:
    """List the edges of FRESH faces that are too long, each once."""
    vert, twin, fresh = surface.vert, surface.twin, changes.fresh
    for i in range(1, fresh[0] + 1):
        if vert[3 * fresh[i]] < 0:
            continue
        for h in range(3 * fresh[i], 3 * fresh[i] + 3):
            a, b = vert[h], vert[following(h)]
            first = twin[h] < h or changes.marks[twin[h] // 3] != FRESH
            if first and squared(surface.points, a, b) > bracket(surface, limits, a, b)[0]:
                push(longs, h)


@kernel(_PAIR(SURFACE, INTS, numba.int64, numba.int64), **LEAN)
def _reach(surface: Surface, listed: Indices, first: int, last: int) -> tuple[float, float]:
    """The smallest and largest squared length of the faces listed from `first` to before `last`."""
    low, high = np.inf, 0.0
    for i in range(first, last):
        if surface.vert[3 * listed[i]] >= 0:
            low, high = _wider(low, high, *_least_and_most(*_sides(surface, listed[i])))
    return low, high


@kernel(_PAIR(SURFACE, numba.int64, CHANGES, MATRIX))
def extent(surface: Surface, faces: int, changes: Changes, extents: Points) -> tuple[float, float]:
    """The smallest and largest squared length now, before the holes are filled.

    Looked at anew are the changed faces and those beside edges in `shorts`, which `find_odd` left out, and of
    all the others only blocks that reach farther than what was seen so far. `faces` is how many there were.
    """
    low, high = _reach(surface, changes.changed, 1, changes.changed[0] + 1)
    for i in range(1, changes.shorts[0] + 1):
        h = changes.shorts[i]
        low, high = _wider(low, high, *_least_and_most(*_sides(surface, h // 3)))
        back = surface.twin[h]
        if back >= 0:
            low, high = _wider(low, high, *_least_and_most(*_sides(surface, back // 3)))
    for block in range(len(extents)):
        if extents[block, 0] >= low and extents[block, 1] <= high:
            continue
        for f in range(BLOCK * block, min(BLOCK * (block + 1), faces)):
            if changes.marks[f] == AS_IT_WAS:
                low, high = _wider(low, high, *_least_and_most(*_sides(surface, f)))
    return low, high
