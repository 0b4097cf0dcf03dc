"""Untangle the surface at rest: flip edges of faces that look inwards there, where fewer then do."""

from __future__ import annotations

import numba
import numpy as np

from pipeline.arrays import Indices
from pipeline.kernels import kernel
from pipeline.mesh.kernels.halfedge import INTS, LEAN, MESH_ARRAYS, MeshArrays, after, before
from pipeline.resample.kernels.flip import are_adjacent, flip_and_touch, folds_by_flip, inverted_by_flip
from pipeline.resample.kernels.limits import (
    CHANGES,
    LIMITS,
    Changes,
    Limits,
    length_limits,
    squared_length,
)
from pipeline.resample.kernels.ring import MAX_TURN_COSINE, is_inverted

_PAIR = numba.types.UniTuple(numba.int64, 2)


@kernel(numba.boolean(MESH_ARRAYS, numba.int64, LIMITS), **LEAN)
def can_untangle(mesh: MeshArrays, h: int, limits: Limits) -> bool:
    """Tell whether fewer faces look inwards at rest once the edge of h is flipped.

    The edge must be soft, the new one within its length limits, and no face may fold now: none turns by more
    than the angle of MAX_TURN_COSINE from the mean of both.
    """
    points, vert, twin = mesh.points, mesh.vert, mesh.twin
    i = np.uint64(h)
    if twin[i] < 0 or mesh.tagged[i]:
        return False
    a, b, c, d = vert[i], vert[after(i)], vert[before(i)], vert[before(np.uint64(twin[i]))]
    if inverted_by_flip(mesh.attributes, limits, a, b, c, d) >= 0:
        return False
    crossing, (max_squared, min_squared) = squared_length(points, c, d), length_limits(mesh, limits, c, d)
    if crossing > max_squared or crossing < min_squared:
        return False
    if folds_by_flip(points, a, b, c, d, MAX_TURN_COSINE):
        return False
    return not are_adjacent(mesh, before(i), d)


@kernel(numba.boolean(MESH_ARRAYS, numba.int64, LIMITS), **LEAN)
def _looks_inwards(mesh: MeshArrays, f: int, limits: Limits) -> bool:
    """Tell whether a face exists and does not face outwards at rest."""
    vert, i = mesh.vert, np.uint64(3 * f)
    a = vert[i]
    return a >= 0 and is_inverted(mesh.attributes, limits, a, vert[i + np.uint64(1)], vert[i + np.uint64(2)])


@kernel(numba.boolean(MESH_ARRAYS, numba.int64, LIMITS, CHANGES), **LEAN)
def _untangle_face(mesh: MeshArrays, f: int, limits: Limits, changes: Changes) -> bool:
    """Flip the first edge of a face with which fewer faces then look inwards; return whether there is one."""
    for h in range(3 * f, 3 * f + 3):
        if can_untangle(mesh, h, limits):
            flip_and_touch(mesh, h, changes)
            return True
    return False


@kernel(_PAIR(MESH_ARRAYS, numba.int64, LIMITS, CHANGES))
def untangle(mesh: MeshArrays, faces: int, limits: Limits, changes: Changes) -> tuple[int, int]:
    """Flip an edge of each face that looks inwards at rest, where fewer then do.

    Looks at all faces, since a face that has not changed may by now be able to. Returns how many edges were
    flipped, and for how many faces none was.
    """
    flips, left = 0, 0
    for f in range(faces):
        if _looks_inwards(mesh, f, limits):
            if _untangle_face(mesh, f, limits, changes):
                flips += 1
            else:
                left += 1
    return flips, left


@kernel(_PAIR(MESH_ARRAYS, INTS, LIMITS, CHANGES))
def untangle_listed(mesh: MeshArrays, faces: Indices, limits: Limits, changes: Changes) -> tuple[int, int]:
    """Do what `untangle` does, for the faces of a list in ascending order."""
    flips, left = 0, 0
    for f in faces:
        if _looks_inwards(mesh, f, limits):
            if _untangle_face(mesh, f, limits, changes):
                flips += 1
            else:
                left += 1
    return flips, left


@kernel(numba.int64(MESH_ARRAYS, LIMITS, CHANGES))
def count_tangled(mesh: MeshArrays, limits: Limits, changes: Changes) -> int:
    """Return how many of the faces that have changed look inwards at rest."""
    count = 0
    for i in range(1, changes.changed[0] + 1):
        count += _looks_inwards(mesh, changes.changed[i], limits)
    return count
