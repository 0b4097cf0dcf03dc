"""The state of a resample pass as its kernels take it: limits, changes, work lists, and the ring of a vertex.

A work list is an int32 array whose first entry counts the items after it. Pushing onto a full list does
nothing; a list that must not lose items has room for all that it could hold.

A ring is the faces and spokes around a vertex, laid out in rows, as every local decision reads them. Spoke
i runs from the centre to `vertex[i]`; face i lies between spokes i and i + 1. A closed ring has as many faces
as spokes, and repeats its first spoke after the last; an open ring has one spoke more. Coordinates lie in
rows of floats, one coordinate a row, so that a processor computes several faces at once. It computes as many
as it has lanes; entries after the last face are ignored.

No step may turn a face over, neither now nor, where vertices have positions at rest, there: the surface would
return pleated. A collapse may turn one over at rest if its edge would otherwise stay too short. Where the
flow asks for it, no face may oppose its normals: look against the mean of those carried with its corners.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Floats, Indices, Points, Vectors
from flowsculpt.pipeline.kernels import kernel
from flowsculpt.pipeline.mesh.kernels.halfedge import (
    BYTES,
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


class Limits(NamedTuple):
    """The thresholds of one frame.

    The limit of an edge is the geometric mean of the limits at its two ends, which needs no root: kernels
    compare squared lengths.
    """

    max_edge_length: float  # scene units; where limits vary, the largest of all
    min_edge_length: float  # scene units; where limits vary, the smallest of all
    hard_cosine: float  # cosine of hard_angle
    merges_at_midpoint: bool = True  # two soft ends merge halfway, or else at one of them
    field_column: int = -1  # in `MeshArrays.attributes`: `Thresholds.fields`, if they vary; else -1
    longest_share: float = 1.0  # of a triangle's longest side in its summed squared sides; above it is obtuse
    rest_column: int = -1  # in `MeshArrays.attributes`: position at rest; -1 if there is none
    rest_normal_column: int = -1  # in `MeshArrays.attributes`: normal at rest; -1 if there is none
    normal_column: int = -1  # in `MeshArrays.attributes`: normal now, which no face may oppose; -1 if any may
    hard_by_angle: bool = True  # edges beyond hard_angle are hard in this frame; else tagged ones alone
    bends: bool = False  # the numbers of `Thresholds.bends` follow `Thresholds.fields`
    squared_slack: float = 1.0  # factor on the squared maximum for edges that a collapse makes


_FINEST = 1 / 4096  # the factor on squared lengths where the surface bends most
_F, _I, _B = numba.float64, numba.int64, numba.boolean
LIMITS = numba.types.NamedTuple([_F, _F, _F, _B, _I, _F, _I, _I, _I, _B, _B, _F], Limits)
_PAIR = numba.types.UniTuple(numba.float64, 2)
_TRIPLE = numba.types.UniTuple(numba.float64, 3)


@kernel(numba.float64(MATRIX, numba.int64, numba.int64), **LEAN)
def squared_length(points: Points, a: int, b: int) -> float:
    """Return the squared distance between two vertices."""
    u, v = np.uint64(a), np.uint64(b)  # unsigned: a signed index costs a test for negative ones
    x = points[u, 0] - points[v, 0]
    y = points[u, 1] - points[v, 1]
    z = points[u, 2] - points[v, 2]
    return float(x * x + y * y + z * z)


@kernel(numba.float64(MESH_ARRAYS, numba.int64, numba.int64, numba.int64), **LEAN)
def edge_height(mesh: MeshArrays, column: int, a: int, b: int) -> float:
    """Return how far the middle of an edge is off the surface, over how far it may be; 0 if it may bend.

    It is about an eighth of the length times the turn of the normal along the edge (`Thresholds.bends`).
    """
    limits, bend = mesh.attributes, 0.0
    for k in range(3 if limits.shape[1] > column + 3 else 0):
        turn = limits[b, column + 3 + k] - limits[a, column + 3 + k]
        bend += turn * (mesh.points[b, k] - mesh.points[a, k])
    return abs(bend)


@kernel(_PAIR(MESH_ARRAYS, numba.int64, numba.int64, numba.int64), **LEAN)
def varying_limits(mesh: MeshArrays, column: int, a: int, b: int) -> tuple[float, float]:
    """Return the largest and the smallest squared length of an edge, by the limits of its vertices.

    Where the edge is too high, both are lower by the factor that brings its middle near to the surface.
    """
    limits = mesh.attributes
    longest, shortest = limits[a, column] * limits[b, column], limits[a, column + 1] * limits[b, column + 1]
    too_long, length = edge_height(mesh, column, a, b) * longest, squared_length(mesh.points, a, b)
    if too_long <= length:
        return longest, shortest
    lower = max(_FINEST, length / too_long)
    return lower * longest, lower * shortest


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


@kernel(numba.boolean(MESH_ARRAYS, LIMITS, numba.int64, numba.int64, numba.int64), **LEAN)
def opposes_normals(mesh: MeshArrays, limits: Limits, a: int, b: int, c: int) -> bool:
    """Tell whether triangle abc opposes its normals; False where any face may."""
    if limits.normal_column < 0:
        return False
    normals, n = mesh.attributes, np.uint64(limits.normal_column)
    i, j, k = np.uint64(a), np.uint64(b), np.uint64(c)
    x, y, z = area_vector(mesh.points, a, b, c)
    along = x * (normals[i, n] + normals[j, n] + normals[k, n])
    along += y * (normals[i, n + _ONE] + normals[j, n + _ONE] + normals[k, n + _ONE])
    along += z * (normals[i, n + _TWO] + normals[j, n + _TWO] + normals[k, n + _TWO])
    return bool(along < 0.0)


@kernel(numba.boolean(MESH_ARRAYS, RING, numba.int64, numba.int64, LIMITS), **LEAN)
def would_oppose(mesh: MeshArrays, ring: Ring, centre: int, other: int, limits: Limits) -> bool:
    """Tell whether a face of the ring would come to oppose its normals if its centre merged into `other`."""
    for i in range(ring.size[0] if limits.normal_column >= 0 else 0):
        b, c = ring.vertex[i], ring.vertex[i + 1]
        if b == other or c == other or opposes_normals(mesh, limits, centre, b, c):
            continue
        if opposes_normals(mesh, limits, other, b, c):
            return True
    return False


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
