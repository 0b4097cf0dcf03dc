"""Which edges are out of the bracket, and how far the lengths reach: of all edges once, then of what changed.

Lengths are summed up by blocks of faces, so that a frame that touches a tenth of the surface counts
little more than that tenth again.
"""

from __future__ import annotations

import numba
import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices, Points
from pipeline.kernels import kernel
from pipeline.mesh._kernels_halfedge import BYTES, INTS, LEAN, MATRIX, SURFACE, VECTOR, Surface, following
from pipeline.resample._kernels_lists import AS_IT_WAS, bracket, push, squared

BLOCK = 16
_PAIR = numba.types.UniTuple(numba.float64, 2)
_TRIPLE = numba.types.UniTuple(numba.float64, 3)


@kernel(_TRIPLE(SURFACE, numba.int64), **LEAN)
def _sides(surface: Surface, f: int) -> tuple[float, float, float]:
    """Squared lengths of the three edges of a face that is there."""
    points, vert = surface.points, surface.vert
    a, b, c = vert[3 * f], vert[3 * f + 1], vert[3 * f + 2]
    return squared(points, a, b), squared(points, b, c), squared(points, c, a)


@kernel(_PAIR(numba.float64, numba.float64, numba.float64), **LEAN)
def _least_and_most(x: float, y: float, z: float) -> tuple[float, float]:
    """Without branches, unlike `min` and `max`, which care for nan."""
    least, most = x if x < y else y, x if x > y else y
    return z if z < least else least, z if z > most else most


@kernel(_PAIR(numba.float64, numba.float64, numba.float64, numba.float64), **LEAN)
def _wider(low: float, high: float, small: float, large: float) -> tuple[float, float]:
    return small if small < low else low, large if large > high else high


@kernel(numba.int64(SURFACE, numba.int64, numba.float64, VECTOR, INTS, INTS), **LEAN)
def _list(surface: Surface, h: int, length: float, limits: Floats, longs: Indices, shorts: Indices) -> int:
    """List the edge of h if it is out of the bracket and its twin does not do it; answers 1 if it is out."""
    most, least = bracket(surface, limits, surface.vert[h], surface.vert[following(h)])
    if least <= length <= most:
        return 0
    if surface.twin[h] < h:
        push(longs if length > most else shorts, h)
    return 1


@kernel(numba.float64(SURFACE, numba.int64, VECTOR, INTS, INTS, INTS, MATRIX), **LEAN)
def scan(
    surface: Surface,
    faces: int,
    limits: Floats,
    longs: Indices,
    shorts: Indices,
    obtuse: Indices,
    extents: Points,
) -> float:
    """List every edge out of the bracket once; answers a sum that is finite where all lengths are.

    `obtuse` lists the edges that face a corner much wider than a right angle. `extents` (blocks, 2) gets the
    smallest and largest of each block, over the faces within the bracket. No face may be missing. Faces
    are visited in order and only edges out of the bracket look at their twins, so the pass costs little
    more than reading the mesh.
    """
    most, least, total, bluntness = limits[0], limits[1], 0.0, limits[5]
    if limits[4] >= 0:
        most, least = 0.0, np.inf  # every edge has its own bracket to be compared with
    for block in range(len(extents)):
        low, high = np.inf, 0.0
        for f in range(BLOCK * block, min(BLOCK * (block + 1), faces)):
            ab, bc, ca = _sides(surface, f)
            small, large = _least_and_most(ab, bc, ca)
            total += ab + bc + ca
            if large > bluntness * (ab + bc + ca):
                push(obtuse, 3 * f if large == ab else (3 * f + 1 if large == bc else 3 * f + 2))
            out = 0
            if large > most or small < least:
                out += _list(surface, 3 * f, ab, limits, longs, shorts)
                out += _list(surface, 3 * f + 1, bc, limits, longs, shorts)
                out += _list(surface, 3 * f + 2, ca, limits, longs, shorts)
            if out == 0:
                low, high = _wider(low, high, small, large)
        extents[block, 0], extents[block, 1] = low, high
    return total


@kernel((SURFACE, numba.int64, VECTOR, BYTES, INTS, INTS, INTS), **LEAN)
def look_again(
    surface: Surface,
    faces: int,
    limits: Floats,
    marks: AnyArray,
    before: Indices,
    longs: Indices,
    shorts: Indices,
) -> None:
    """List every edge out of the bracket once, as `scan` would, by looking at the marked faces only.

    Beside them only edges that stood in the list of short ones `before` can be out of the bracket.
    """
    vert, twin = surface.vert, surface.twin
    for i in range(1, before[0] + 1):
        h = before[i]
        if marks[h // 3] or (twin[h] >= 0 and marks[twin[h] // 3]):
            continue
        push(shorts, h)
    for f in range(faces):
        if marks[f] == AS_IT_WAS or vert[3 * f] < 0:
            continue
        for h in range(3 * f, 3 * f + 3):
            a, b = vert[h], vert[following(h)]
            length, (most, least) = squared(surface.points, a, b), bracket(surface, limits, a, b)
            if least <= length <= most:
                continue
            back = twin[h]
            if back > h and marks[back // 3]:
                continue
            push(longs if length > most else shorts, h)


@kernel(_PAIR(SURFACE, numba.int64, BYTES, INTS, MATRIX), **LEAN)
def extent(
    surface: Surface, faces: int, marks: AnyArray, shorts: Indices, extents: Points
) -> tuple[float, float]:
    """The smallest and largest squared length now.

    Looked at anew are the marked faces and those beside `shorts`, which `scan` left out, and of all the
    others only blocks that reach farther than what was seen so far.
    """
    low, high = np.inf, 0.0
    for f in range(faces):
        if marks[f] != AS_IT_WAS:
            low, high = _wider(low, high, *_least_and_most(*_sides(surface, f)))
    for i in range(1, shorts[0] + 1):
        low, high = _wider(low, high, *_least_and_most(*_sides(surface, shorts[i] // 3)))
        back = surface.twin[shorts[i]]
        if back >= 0:
            low, high = _wider(low, high, *_least_and_most(*_sides(surface, back // 3)))
    for block in range(len(extents)):
        if extents[block, 0] >= low and extents[block, 1] <= high:
            continue
        for f in range(BLOCK * block, min(BLOCK * (block + 1), faces)):
            if marks[f] == AS_IT_WAS:
                low, high = _wider(low, high, *_least_and_most(*_sides(surface, f)))
    return low, high
