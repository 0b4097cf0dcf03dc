"""Orientation of faces at rest: no step may turn a face over there, or the surface would return pleated."""

from __future__ import annotations

import numba
import numpy as np

from pipeline.arrays import Indices, Points
from pipeline.kernels import kernel
from pipeline.mesh.kernels.halfedge import INTS, LEAN, MATRIX, MESH_ARRAYS, MeshArrays, following
from pipeline.resample.kernels.limits import LIMITS, Limits
from pipeline.resample.kernels.ring import RING, Ring, collect_ring

MAX_OPPOSITE = 8
_CORNER_PAIRS = numba.int32[:, :, ::1]
_ONE, _TWO = np.uint64(1), np.uint64(2)


@kernel(numba.float64(MATRIX, LIMITS, numba.int64, numba.int64, numba.int64), **LEAN)
def rest_orientation(attributes: Points, limits: Limits, a: int, b: int, c: int) -> float:
    """Return a positive number if triangle abc faces outwards at rest, by the rest normals of its corners."""
    i, j, k = np.uint64(a), np.uint64(b), np.uint64(c)
    m, o = np.uint64(limits.rest_column), np.uint64(limits.rest_normal_column)
    x, y, z = attributes[i, m], attributes[i, m + _ONE], attributes[i, m + _TWO]
    ux, uy, uz = attributes[j, m] - x, attributes[j, m + _ONE] - y, attributes[j, m + _TWO] - z
    vx, vy, vz = attributes[k, m] - x, attributes[k, m + _ONE] - y, attributes[k, m + _TWO] - z
    nx = attributes[i, o] + attributes[j, o] + attributes[k, o]
    ny = attributes[i, o + _ONE] + attributes[j, o + _ONE] + attributes[k, o + _ONE]
    nz = attributes[i, o + _TWO] + attributes[j, o + _TWO] + attributes[k, o + _TWO]
    return float((uy * vz - uz * vy) * nx + (uz * vx - ux * vz) * ny + (ux * vy - uy * vx) * nz)


@kernel(numba.boolean(MATRIX, LIMITS, numba.int64, numba.int64, numba.int64), **LEAN)
def is_inverted(attributes: Points, limits: Limits, a: int, b: int, c: int) -> bool:
    """Tell whether triangle abc does not face outwards at rest."""
    return bool(rest_orientation(attributes, limits, a, b, c) <= 0)


@kernel(numba.boolean(MATRIX, RING, numba.int64, numba.int64, LIMITS), **LEAN)
def would_flip(attributes: Points, ring: Ring, centre: int, other: int, limits: Limits) -> bool:
    """Tell whether a face of the ring would turn over at rest if its centre merged into vertex `other`."""
    for i in range(ring.size[0]):
        b, c = ring.vertex[i], ring.vertex[i + 1]
        if b == other or c == other:
            continue
        inverted = is_inverted(attributes, limits, other, b, c)
        if inverted and rest_orientation(attributes, limits, centre, b, c) > 0:
            return True
    return False


@kernel(numba.int64(MATRIX, RING, numba.int64, LIMITS), **LEAN)
def _count_inverted(attributes: Points, ring: Ring, centre: int, limits: Limits) -> int:
    """Return how many faces of the ring face inwards at rest."""
    count = 0
    for i in range(ring.size[0]):
        b, c = ring.vertex[i], ring.vertex[i + 1]
        count += is_inverted(attributes, limits, centre, b, c)
    return count


@kernel(numba.boolean(MATRIX, RING, numba.int64, MATRIX, numba.int64, LIMITS), **LEAN)
def move_at_rest(attributes: Points, ring: Ring, centre: int, goals: Points, i: int, limits: Limits) -> bool:
    """Move the ring's centre to `goals[i]` at rest unless more faces would face inwards; return if it may go.

    Without rest positions it returns True and moves nothing.
    """
    column = limits.rest_column
    if column < 0:
        return True
    before = _count_inverted(attributes, ring, centre, limits)
    x, y, z = attributes[centre, column], attributes[centre, column + 1], attributes[centre, column + 2]
    for k in range(3):
        attributes[centre, column + k] = goals[i, k]
    if _count_inverted(attributes, ring, centre, limits) <= before:
        return True
    attributes[centre, column], attributes[centre, column + 1], attributes[centre, column + 2] = x, y, z
    return False


@kernel(numba.int64(MESH_ARRAYS, numba.int64, numba.int64, INTS))
def list_marked(mesh: MeshArrays, halfedges: int, column: int, spokes: Indices) -> int:
    """List a half-edge from each vertex whose attribute in `column` is not zero; return their number."""
    vert, attributes, count = mesh.vert, mesh.attributes, 0
    for h in range(halfedges):
        v = np.uint64(vert[h])
        if attributes[v, column] == 1.0:
            spokes[count] = h
            count += 1
            attributes[v, column] = 2.0  # seen
    for i in range(count):
        attributes[vert[spokes[i]], column] = 1.0
    return count


@kernel((MESH_ARRAYS, INTS, RING, _CORNER_PAIRS))
def opposite_corners(mesh: MeshArrays, spokes: Indices, ring: Ring, corners: Indices) -> None:
    """Fill `corners` (N, MAX_OPPOSITE, 2): the other two corners of the faces around the start of each spoke.

    A vertex on a crease or a boundary must stay there: it gets the edges along it, each as twice the same
    corner. Unused rows hold -1; faces beyond the eighth are left out.
    """
    for i in range(len(spokes)):
        corners[i] = -1
        if not collect_ring(mesh, spokes[i], ring):  # too many spokes: take the given one
            corners[i, 0] = mesh.vert[following(spokes[i])]
            continue
        faces, rim, many = ring.size[0], ring.size[1], 0
        for k in range(rim):
            edge = rim > faces and (k == 0 or k == faces)
            if many < MAX_OPPOSITE and (edge or (k < faces and mesh.tagged[ring.leaving[k]] > 0)):
                corners[i, many] = ring.vertex[k]
                many += 1
        for k in range(min(MAX_OPPOSITE, faces) if many == 0 else 0):
            corners[i, k, 0] = ring.vertex[k]
            corners[i, k, 1] = ring.vertex[k + 1]
