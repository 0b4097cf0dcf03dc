"""The ring of a vertex: its faces and spokes laid out in rows, as every local decision reads them.

Spoke i runs from the centre to `vertex[i]`; face i lies between spokes i and i + 1. A closed ring has as many
faces as spokes, and repeats its first spoke after the last; an open ring has one spoke more. Coordinates lie
in rows of floats, one coordinate a row, so that a processor computes several faces at once. It computes as
many as it has lanes; entries after the last face are ignored.

No step may turn a face over, neither now nor, where vertices have positions at rest, there: the surface would
return pleated.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from pipeline.arrays import Floats, Indices, Points, Vectors
from pipeline.kernels import kernel
from pipeline.mesh.kernels.halfedge import (
    INTS,
    LEAN,
    MATRIX,
    MESH_ARRAYS,
    VECTOR,
    MeshArrays,
    after,
    before,
    fan_start,
)
from pipeline.resample.kernels.limits import LIMITS, Limits

MAX_SPOKES = 512
MAX_TURN_COSINE = 0.2  # a face turns by at most 78 degrees in one step
_THIN = 0.02  # twice the area over the longest side squared; below it a face counts as a sliver
_LANES = 8  # entries computed together; a multiple of any processor's vector length
_ROW = MAX_SPOKES + 3 * _LANES  # floats from one row to the next; no power of two, which caches dislike
_X, _Y, _Z, NX, NY, NZ, _SQUARE = (np.uint64(_ROW * row) for row in range(7))
_ONE, _TWO = np.uint64(1), np.uint64(2)
STRETCHED, FOLDED = 1, 2


class Ring(NamedTuple):
    """Scratch arrays for one vertex and its ring."""

    leaving: Indices  # (MAX_SPOKES,) half-edge of spoke i, in face i
    vertex: Indices  # (MAX_SPOKES + 2 _LANES,) the other end of spoke i
    rows: Floats  # positions of these ends, area vectors of faces (one entry on), their squared lengths
    hard: Indices  # (MAX_SPOKES + _LANES,) 1 where spoke i is a hard edge
    size: Indices  # (3,) faces, spokes, hard spokes
    place: Floats  # (3,) a position to test for the centre

    @property
    def normals(self) -> Vectors:
        """Return the area vectors (faces, 3)."""
        table: Vectors = self.rows.reshape(-1, _ROW)[3:6, 1 : 1 + self.size[0]].T
        return table


def new_ring() -> Ring:
    """Return an empty ring."""
    return Ring(
        np.empty(MAX_SPOKES, np.int32),
        np.zeros(MAX_SPOKES + 2 * _LANES, np.int32),
        np.zeros(7 * _ROW),
        np.zeros(MAX_SPOKES + _LANES, np.int32),
        np.zeros(3, np.int32),
        np.zeros(3),
    )


RING = numba.types.NamedTuple([INTS, INTS, VECTOR, INTS, INTS, VECTOR], Ring)


@kernel((MATRIX, RING, numba.uint64, numba.uint64), **LEAN)
def _set_spoke(points: Points, ring: Ring, i: np.uint64, v: np.uint64) -> None:
    """Write vertex v as the end of spoke i."""
    ring.vertex[i] = v
    rows = ring.rows
    rows[_X + i], rows[_Y + i], rows[_Z + i] = points[v, 0], points[v, 1], points[v, 2]


@kernel(numba.boolean(MESH_ARRAYS, numba.int64, RING), **LEAN)
def collect_ring(mesh: MeshArrays, h: int, ring: Ring) -> bool:
    """Collect spokes and faces around the start of h; return False if there are more than MAX_SPOKES."""
    points, vert, twin, tagged = mesh.points, mesh.vert, mesh.twin, mesh.tagged
    first = np.uint64(h)
    while True:
        n, k = np.uint64(0), first
        _set_spoke(points, ring, n, np.uint64(vert[after(first)]))
        while n < np.uint64(MAX_SPOKES - 1):
            back = before(k)
            ring.leaving[n], ring.hard[n] = k, tagged[k]
            n += _ONE
            _set_spoke(points, ring, n, np.uint64(vert[back]))
            k = np.uint64(twin[back])
            if k == first:
                ring.size[0] = ring.size[1] = n
                return True
            if np.int64(k) < 0:
                break
        if np.int64(k) >= 0:
            return False
        if twin[first] < 0:
            ring.size[0], ring.size[1] = n, n + _ONE
            return True
        first = np.uint64(fan_start(twin, h))  # an open fan: collect it from its other end


@kernel(numba.int64(numba.int64), **LEAN)
def _padded(entries: int) -> int:
    """Return the number of entries rounded up to whole lanes."""
    return (entries + _LANES - 1) & -_LANES


@kernel((MESH_ARRAYS, numba.int64, RING), **LEAN)
def measure_faces(mesh: MeshArrays, centre: int, ring: Ring) -> None:
    """Compute the area vectors of the ring's faces."""
    rows, v = ring.rows, np.uint64(centre)
    x, y, z = mesh.points[v, 0], mesh.points[v, 1], mesh.points[v, 2]
    for lane in range(_padded(ring.size[0])):
        i = np.uint64(lane)
        j = i + _ONE
        ax, ay, az = rows[_X + i] - x, rows[_Y + i] - y, rows[_Z + i] - z
        bx, by, bz = rows[_X + j] - x, rows[_Y + j] - y, rows[_Z + j] - z
        nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        rows[NX + j], rows[NY + j], rows[NZ + j] = nx, ny, nz
        rows[_SQUARE + j] = nx * nx + ny * ny + nz * nz


@kernel((MESH_ARRAYS, numba.int64, RING, numba.float64), **LEAN)
def measure_ring(mesh: MeshArrays, centre: int, ring: Ring, cosine: float) -> None:
    """Compute area vectors and flag hard spokes (P29); tagged edges (P31) and boundaries are hard.

    An edge is hard if its faces enclose more than the angle with that cosine. Faces without area are ignored.
    """
    faces, spokes, rows, hard = ring.size[0], ring.size[1], ring.rows, ring.hard
    measure_faces(mesh, centre, ring)
    last = np.uint64(faces)
    rows[NX], rows[NY], rows[NZ] = rows[NX + last], rows[NY + last], rows[NZ + last]
    rows[_SQUARE] = rows[_SQUARE + last]
    bar, count = cosine * abs(cosine), 0  # squares that keep their signs
    for lane in range(_padded(spokes)):
        i = np.uint64(lane)
        j = i + _ONE
        dot = rows[NX + i] * rows[NX + j] + rows[NY + i] * rows[NY + j] + rows[NZ + i] * rows[NZ + j]
        turned = dot * abs(dot) < bar * (rows[_SQUARE + i] * rows[_SQUARE + j])
        hard[i] = (hard[i] > 0) | turned
    if spokes > faces:
        hard[0] = hard[faces] = 1
    for spoke in range(spokes):
        count += hard[spoke]
    ring.size[2] = count


@kernel(numba.int64(RING, numba.int64, VECTOR, numba.float64, numba.float64), **LEAN)
def move_fault(ring: Ring, other: int, place: Floats, max_squared: float, cosine: float) -> int:
    """Return STRETCHED, else FOLDED, else 0 for a move of the ring's centre to `place`.

    Stretched: the square of a spoke exceeds `max_squared`. Folded: a face turns by more than the angle with
    that cosine, or becomes a sliver. Spokes and faces at vertex `other`, which the centre may merge with, are
    ignored. Needs `measure_faces`.
    """
    faces, spokes, rows, vertex = ring.size[0], ring.size[1], ring.rows, ring.vertex
    x, y, z = place[0], place[1], place[2]
    bar, stretched, folded = cosine * abs(cosine), 0, 0  # squares that keep their signs
    for lane in range(_padded(spokes)):
        i = np.uint64(lane)
        j = i + _ONE
        ax, ay, az = rows[_X + i] - x, rows[_Y + i] - y, rows[_Z + i] - z
        bx, by, bz = rows[_X + j] - x, rows[_Y + j] - y, rows[_Z + j] - z
        cx, cy, cz = rows[_X + j] - rows[_X + i], rows[_Y + j] - rows[_Y + i], rows[_Z + j] - rows[_Z + i]
        nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        dot = nx * rows[NX + j] + ny * rows[NY + j] + nz * rows[NZ + j]
        new, old = nx * nx + ny * ny + nz * nz, rows[_SQUARE + j]
        near, far = ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz
        side = cx * cx + cy * cy + cz * cz
        side = side if side > near else near
        side = side if side > far else far
        turns = (old > 0.0) & (dot * abs(dot) < bar * old * new)
        thin = (new < _THIN * _THIN * side * side) & (new < old)
        keeps_i, keeps_j = vertex[i] != other, vertex[j] != other
        stretched |= (near > max_squared) & keeps_i & (lane < spokes)
        folded |= (turns | thin) & keeps_i & keeps_j & (lane < faces)
    return STRETCHED if stretched else (FOLDED if folded else 0)


@kernel(numba.boolean(MATRIX, RING, numba.int64, VECTOR, numba.float64), **LEAN)
def folds(points: Points, ring: Ring, other: int, place: Floats, cosine: float) -> bool:
    """Tell whether a face of the ring would fold or become a sliver if its centre moved to `place`."""
    return move_fault(ring, other, place, np.inf, cosine) > 0


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
