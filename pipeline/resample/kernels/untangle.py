"""Untangle the surface at rest: flip edges of faces that look inwards there, where fewer then do."""

from __future__ import annotations

import numba
import numpy as np

from pipeline.kernels import kernel
from pipeline.mesh.kernels.halfedge import LEAN, MESH_ARRAYS, MeshArrays, after, before
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


@kernel(numba.int64(MESH_ARRAYS, numba.int64, LIMITS, CHANGES))
def untangle(mesh: MeshArrays, faces: int, limits: Limits, changes: Changes) -> int:
    """Flip an edge of each face that looks inwards at rest, where fewer then do; return the flips done.

    Looks at all faces, since a face that has not changed may by now be able to.
    """
    vert, attributes, flips = mesh.vert, mesh.attributes, 0
    for f in range(faces):
        h = 3 * f
        i = np.uint64(h)
        a = vert[i]
        if a < 0 or not is_inverted(attributes, limits, a, vert[i + np.uint64(1)], vert[i + np.uint64(2)]):
            continue
        for k in range(h, h + 3):
            if can_untangle(mesh, k, limits):
                flip_and_touch(mesh, k, changes)
                flips += 1
                break
    return flips
