"""Split long edges with their two faces, and place the new vertices (Figure D; P8, P24, P25, P37).

Their places may lie on curved patches over the split edges: on a surface that is smooth between creases. It
is that of now or, with exact placement, the one at rest.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Floats, Indices, Points, Vectors
from flowsculpt.pipeline.kernels import kernel
from flowsculpt.pipeline.mesh.kernels.halfedge import (
    BYTES,
    INTS,
    LEAN,
    LEAN_CALLS,
    MATRIX,
    MESH_ARRAYS,
    VECTOR,
    MeshArrays,
    following,
    join,
    preceding,
)
from flowsculpt.pipeline.resample.kernels.pass_state import (
    CHANGES,
    LIMITS,
    ONLY_TAGGED,
    RING,
    Changes,
    Limits,
    Ring,
    area_vector,
    classify_edge,
    collect_ring,
    folds,
    length_limits,
    measure_faces,
    move_at_rest,
    push,
    squared_length,
    touch,
)

BIRTH_HALFEDGE = 2  # index of the half-edge that leaves the new vertex
BIRTH_SIZE = 3  # numbers recorded for each new vertex: parents a and b, half-edge vertex→b
_CLASSES = 4


@kernel((MESH_ARRAYS, numba.int64, numba.int64, numba.int64), **LEAN)
def _split_face(mesh: MeshArrays, h: int, middle: int, face: int) -> None:
    """Cut the face of h: a→b along the line from `middle` to its third corner c.

    `face` becomes (middle, b, c). Half-edge b→c moves to the new face; its old place holds the line from
    `middle` to c.
    """
    vert, twin, tagged = mesh.vert, mesh.twin, mesh.tagged
    onward, new = following(h), 3 * face
    tagged[new], tagged[new + 1], tagged[new + 2] = tagged[h], tagged[onward], 0
    tagged[onward] = 0
    vert[new], vert[new + 1], vert[new + 2] = middle, vert[onward], vert[preceding(h)]
    vert[onward] = middle
    join(twin, new + 1, twin[onward])
    join(twin, onward, new + 2)


@kernel(numba.int64(MESH_ARRAYS, numba.int64, numba.int64, numba.int64), **LEAN)
def split_edge(mesh: MeshArrays, h: int, middle: int, faces: int) -> int:
    """Insert vertex `middle` into the edge of h and cut its faces; return the new number of faces."""
    twin = mesh.twin
    back, new = twin[h], 3 * faces
    _split_face(mesh, h, middle, faces)
    if back < 0:
        twin[new] = -1
        return faces + 1
    _split_face(mesh, back, middle, faces + 1)
    join(twin, h, new + 3)
    join(twin, back, new)
    return faces + 2


@kernel((MESH_ARRAYS, numba.int64, numba.int64, numba.int64), **LEAN)
def _interpolate(mesh: MeshArrays, middle: int, a: int, b: int) -> None:
    """Set position and attributes of vertex `middle` from its parents a and b."""
    points, attributes, blends = mesh.points, mesh.attributes, mesh.blends
    for k in range(3):
        points[middle, k] = 0.5 * (points[a, k] + points[b, k])
    for k in range(attributes.shape[1]):
        mixes = blends[k] > 0
        attributes[middle, k] = 0.5 * (attributes[a, k] + attributes[b, k]) if mixes else attributes[a, k]


@kernel(INTS(MESH_ARRAYS, INTS, LIMITS, INTS))
def longest_edges_first(mesh: MeshArrays, long_edges: Indices, limits: Limits, remaining: Indices) -> Indices:
    """Return the edges of this pass, longest first in a few classes; edges below 1/√2 of the longest wait.

    No new edge is longer than √(1 - 1/8) of the longest one, so splitting ends, and thin triangles are cut
    across rather than along.
    """
    excess = np.empty(long_edges[0])  # squared length over the square of the longest allowed
    longest = 0.0
    for i in range(long_edges[0]):
        a, b = mesh.vert[long_edges[i + 1]], mesh.vert[following(long_edges[i + 1])]
        excess[i] = squared_length(mesh.points, a, b) / length_limits(mesh, limits, a, b)[0]
        longest = max(longest, excess[i])
    bar = max(1.0, 0.5 * longest)
    start = np.zeros(_CLASSES + 1, np.int32)
    rank = np.empty(long_edges[0], np.int32)
    for i in range(long_edges[0]):
        rank[i] = -1
        if excess[i] > bar:
            rank[i] = max(0, min(_CLASSES - 1, int((2.0 - excess[i] / bar) * _CLASSES)))
            start[rank[i] + 1] += 1
        elif excess[i] > 1.0:
            push(remaining, long_edges[i + 1])
    for c in range(_CLASSES):
        start[c + 1] += start[c]
    order = np.empty(start[_CLASSES], np.int32)
    for i in range(long_edges[0]):
        if rank[i] >= 0:
            order[start[rank[i]]] = long_edges[i + 1]
            start[rank[i]] += 1
    return order


@kernel((MESH_ARRAYS, numba.int64[::1], LIMITS, INTS, INTS, INTS, CHANGES), **LEAN)
def split_edges(
    mesh: MeshArrays,
    sizes: Indices,
    limits: Limits,
    order: Indices,
    remaining: Indices,
    births: Indices,
    changes: Changes,
) -> None:
    """Split the edges of `order` that are long, each once; edges that are long afterwards go to `remaining`.

    New vertices lie at the midpoints of their parents. `births` records three numbers for each, so that a
    placement can move all of them before the next pass: its parents a and b, and the half-edge vertex→b. The
    arrays must have room for as many vertices, and twice as many faces, as `order` has entries.
    """
    vert, twin = mesh.vert, mesh.twin
    fresh = sizes[0]
    for h in order:
        a, b = vert[h], vert[following(h)]
        if a >= fresh or b >= fresh:
            continue
        if squared_length(mesh.points, a, b) <= length_limits(mesh, limits, a, b)[0]:
            continue
        middle, first = sizes[0], sizes[1]
        back = twin[h]
        _interpolate(mesh, middle, a, b)
        sizes[0] = middle + 1
        sizes[1] = split_edge(mesh, h, middle, first)
        push(births, a)
        push(births, b)
        push(births, 3 * first)
        classify_edge(mesh, h, limits, remaining, changes)
        for g in range(first, sizes[1]):
            touch(changes, g)
            for i in range(3):
                classify_edge(mesh, 3 * g + i, limits, remaining, changes)
        touch(changes, h // 3)
        if back >= 0:
            touch(changes, back // 3)


MAX_SPOKES_OF_NEW = 12  # two of its own edge, two medians, and those of neighbours split in the same pass
_SWEEPS = 3
_MAX_TURN_COSINE = -0.5  # around a place known to be right faces may turn by 120 degrees
_TABLE = numba.int32[:, ::1]


@kernel(numba.int64(MESH_ARRAYS, INTS, RING, MATRIX, MATRIX, LIMITS, BYTES))
def place_vertices(
    mesh: MeshArrays,
    spokes: Indices,
    ring: Ring,
    places: Points,
    goals: Points,
    limits: Limits,
    placed: AnyArray,
) -> int:
    """Move the starts of `spokes` to their places, except where a face would fold; return the number moved.

    Where vertices have rest positions, these become `goals`, and no face may turn over at rest either.
    Refused vertices are tried again after the others have moved, since those may have been in the way.
    """
    done = 0
    for _ in range(_SWEEPS):
        before = done
        for i in range(len(spokes)):
            middle = mesh.vert[spokes[i]]
            if placed[i] or not collect_ring(mesh, spokes[i], ring):
                continue
            measure_faces(mesh, middle, ring)
            for k in range(3):
                ring.place[k] = places[i, k]
            if folds(mesh.points, ring, -1, ring.place, _MAX_TURN_COSINE):
                continue
            if not move_at_rest(mesh.attributes, ring, middle, goals, i, limits):
                continue
            for k in range(3):
                mesh.points[middle, k] = places[i, k]
            placed[i] = 1
            done += 1
        if done == before:
            break
    return done


@kernel(numba.int64(MESH_ARRAYS, numba.int64, numba.int64), **LEAN)
def incoming(mesh: MeshArrays, new: int, a: int) -> int:
    """Return the half-edge a→vertex, given the half-edge from that vertex to its other parent.

    If its face was cut again in the same pass, it has moved in the table since the vertex was made.
    """
    k = preceding(new)
    while mesh.vert[k] != a:
        k = preceding(mesh.twin[k])
    return int(k)


@kernel((MESH_ARRAYS, _TABLE, LIMITS, INTS, INTS, CHANGES))
def classify_around(
    mesh: MeshArrays, births: Indices, limits: Limits, listed: Indices, long_edges: Indices, changes: Changes
) -> None:
    """List in `long_edges` those of `listed`, and the edges at the new vertices that are too long now.

    Queues edges that became short.
    """
    twin = mesh.twin
    for i in range(1, listed[0] + 1):
        push(long_edges, listed[i])
    for i in range(len(births)):
        first = k = births[i, BIRTH_HALFEDGE]
        while True:
            classify_edge(mesh, k, limits, long_edges, changes)
            k = twin[preceding(k)]
            if k < 0 or k == first:
                break
        if k < 0:  # on a boundary: the edge that no spoke has reached
            h = incoming(mesh, first, births[i, 0])
            classify_edge(mesh, h, limits, long_edges, changes)


class Midpoints(NamedTuple):
    """Places of the new vertices of a round on a smooth surface.

    places   (N, 3)
    normals  (N, 3) unit; zero on creases
    scratch  (7,)
    """

    places: Points
    normals: Vectors
    scratch: Floats


_MIDPOINTS = numba.types.NamedTuple([MATRIX, MATRIX, VECTOR], Midpoints)
_CREASE = 1  # the bit of a tag; the surface does not bend at seams
_LEAST_COSINE = 0.5  # a crease that turns by more than 60 degrees has a corner there
_MOST_RISE = 0.342  # of an edge, along the normal at an end: sine of 20 degrees; with more the end is a tip
_LEVEL = 1e-9  # the most that normals differ, and that edges rise by their length, in a plane
_LONGEST = 6.0  # times as long as its faces are wide an edge is taken for
_LEAST_RISE = 0.1  # with less an end is no tip
_MOST_UNEVEN = 3.0  # an end that rises so many times as much as the other, on a crease, is a tip


@kernel(numba.boolean(MESH_ARRAYS, numba.int64, numba.float64), **LEAN)
def _is_hard(mesh: MeshArrays, h: int, cosine: float) -> bool:
    """Tell whether the edge of h is a crease, a boundary, or turns by more than an angle, by its cosine."""
    back = mesh.twin[h]
    if back < 0 or mesh.tagged[h] & _CREASE:
        return True
    if cosine <= -1.0:
        return False
    vert, points = mesh.vert, mesh.points
    a, b = vert[h], vert[following(h)]
    mx, my, mz = area_vector(points, a, b, vert[preceding(h)])
    nx, ny, nz = area_vector(points, b, a, vert[preceding(back)])
    dot = mx * nx + my * ny + mz * nz
    both = (mx * mx + my * my + mz * mz) * (nx * nx + ny * ny + nz * nz)
    return bool(dot * abs(dot) < cosine * abs(cosine) * both)


@kernel((MESH_ARRAYS, numba.int64, VECTOR, numba.int64), **LEAN)
def _add_face_normal(mesh: MeshArrays, h: int, total: Floats, at: int) -> None:
    """Add the unit normal of the face of h, weighted by its angle at the start of h, to `total[at:]`."""
    vert, points = mesh.vert, mesh.points
    a, b, c = vert[h], vert[following(h)], vert[preceding(h)]
    x, y, z = area_vector(points, a, b, c)
    area = math.sqrt(x * x + y * y + z * z)
    if area == 0.0:
        return
    dot = 0.0
    for k in range(3):
        dot += (points[b, k] - points[a, k]) * (points[c, k] - points[a, k])
    weight = math.atan2(area, dot) / area
    total[at] += weight * x
    total[at + 1] += weight * y
    total[at + 2] += weight * z


@kernel(numba.boolean(MESH_ARRAYS, numba.int64, numba.float64, VECTOR, numba.int64), **LEAN_CALLS)
def side_normal(mesh: MeshArrays, h: int, cosine: float, out: Floats, at: int) -> bool:
    """Write the unit normal of the smooth surface at the start of h, up to the next creases, into `out[at:]`.

    The edge of h must be soft. Returns whether all edges around are.
    """
    twin = mesh.twin
    out[at] = out[at + 1] = out[at + 2] = 0.0
    k, whole = h, False
    while True:
        _add_face_normal(mesh, k, out, at)
        if _is_hard(mesh, preceding(k), cosine):
            break
        k = twin[preceding(k)]
        if k == h:
            whole = True
            break
    k = h
    while not whole and not _is_hard(mesh, k, cosine):
        k = following(twin[k])
        _add_face_normal(mesh, k, out, at)
    length = math.sqrt(out[at] ** 2 + out[at + 1] ** 2 + out[at + 2] ** 2)
    if length > 0.0:
        for i in range(3):
            out[at + i] /= length
    return whole


@kernel(numba.int64(MESH_ARRAYS, numba.int64, numba.int64, numba.float64), **LEAN_CALLS)
def _next_along_crease(mesh: MeshArrays, h: int, before: int, cosine: float) -> int:
    """Return the vertex where the crease from `before` continues beyond the start of h; -1 at its end."""
    vert, twin = mesh.vert, mesh.twin
    onward, count, k = -1, 0, h
    while True:
        if vert[following(k)] != before and _is_hard(mesh, k, cosine):
            onward, count = vert[following(k)], count + 1
        back = preceding(k)
        k = twin[back]
        if k < 0 and vert[back] != before:
            onward, count = vert[back], count + 1
        if k < 0 or k == h:
            break
    while k < 0 and twin[h] >= 0:  # the fan is open: on to its other side
        h = following(twin[h])
        if vert[following(h)] != before and _is_hard(mesh, h, cosine):
            onward, count = vert[following(h)], count + 1
    return onward if count == 1 else -1


@kernel(numba.boolean(MESH_ARRAYS, numba.int64, numba.int64, numba.int64, numba.int64, VECTOR), **LEAN)
def _tangent(mesh: MeshArrays, v: int, to: int, beyond: int, at: int, out: Floats) -> bool:
    """Write the unit tangent at v of the circle through `beyond`, v, `to` to `out[at:]`; False at a corner.

    The tangent is the mean of the two chords, each weighted by the length of the other. `out[6]` holds the
    first vertex of this pass: if `beyond` is such a vertex, it is the midpoint of the chord.
    """
    if beyond < 0:
        return False
    points = mesh.points
    p, q = math.sqrt(squared_length(points, v, beyond)), math.sqrt(squared_length(points, to, v))
    whole = 2.0 * p if beyond >= out[6] else p
    if p == 0.0 or q == 0.0:
        return False
    turn, length = 0.0, 0.0
    for k in range(3):
        one, two = (points[v, k] - points[beyond, k]) / p, (points[to, k] - points[v, k]) / q
        turn += one * two
        out[at + k] = q * one + whole * two
        length += out[at + k] * out[at + k]
    if turn < _LEAST_COSINE:
        return False
    for k in range(3):
        out[at + k] /= math.sqrt(length)
    return True


@kernel((MESH_ARRAYS, numba.int64, numba.int64, numba.float64, _MIDPOINTS, numba.int64), **LEAN)
def _bend_crease(mesh: MeshArrays, h: int, new: int, cosine: float, middles: Midpoints, i: int) -> None:
    """Move place i from the midpoint of a crease's edge onto the crease's curve (cubic Hermite).

    Where the crease begins or ends at a corner, the curve is taken for a circle.
    """
    vert, points, places, scratch = mesh.vert, mesh.points, middles.places, middles.scratch
    a, middle, b = vert[h], vert[new], vert[following(new)]
    begins = _tangent(mesh, a, b, _next_along_crease(mesh, h, middle, cosine), 0, scratch)
    ends = _tangent(mesh, b, a, _next_along_crease(mesh, following(new), middle, cosine), 3, scratch)
    length = math.sqrt(squared_length(points, a, b))
    if not (begins or ends) or length == 0.0:
        return
    along, known = 0.0, 0 if begins else 3
    for k in range(3):
        along += scratch[known + k] * (points[b, k] - points[a, k]) / length
    for k in range(3):
        mirrored = scratch[known + k] - 2.0 * along * (points[b, k] - points[a, k]) / length
        start, end = scratch[k] if begins else mirrored, scratch[3 + k] if ends else mirrored
        places[i, k] += 0.125 * length * (start + end)


@kernel(numba.float64(MATRIX, *[numba.int64] * 2, numba.float64, *[numba.int64] * 2), **LEAN)
def _face_width(points: Points, a: int, b: int, length: float, c: int, d: int) -> float:
    """Return how far the nearer of two vertices is from the line through a and b, `length` apart."""
    if length == 0.0:
        return 0.0
    x, y, z = area_vector(points, a, b, c)
    u, v, w = area_vector(points, a, b, d)
    return math.sqrt(min(x * x + y * y + z * z, u * u + v * v + w * w)) / length


@kernel((MESH_ARRAYS, numba.int64, numba.int64, numba.float64, _MIDPOINTS, numba.int64), **LEAN)
def _bend_patch(mesh: MeshArrays, h: int, new: int, cosine: float, middles: Midpoints, i: int) -> None:
    """Move place i from the midpoint of a soft edge onto the cubic normal to the surface at both ends.

    A tip, such as that of a cone, has no tangent plane: the curve leaves it along the edge. Otherwise long
    faces around it would bulge, and a cone would gain up to a third of its volume. An end is a tip if its
    normal leans far along the edge, or much more than the normal at the other end, if that lies on a crease
    or the edge is long for the width of its faces.

    Source: Vlachos, Peters, Boyd & Mitchell, *Curved PN Triangles* (2001), the border curve at one half.
    """
    points, vert = mesh.points, mesh.vert
    places, normals, scratch = middles
    a, b = vert[h], vert[following(new)]
    a_is_smooth = side_normal(mesh, h, cosine, scratch, 0)
    b_is_smooth = side_normal(mesh, mesh.twin[new], cosine, scratch, 3)
    rise, fall, norm = 0.0, 0.0, 0.0
    for k in range(3):
        rise += (points[b, k] - points[a, k]) * scratch[k]
        fall += (points[a, k] - points[b, k]) * scratch[3 + k]
    length, up, down = math.sqrt(squared_length(points, a, b)), abs(rise), abs(fall)
    width = _face_width(points, a, b, length, vert[preceding(h)], vert[preceding(mesh.twin[new])])
    reach, most = min(length, _LONGEST * width), _MOST_RISE * length
    least, is_long = _LEAST_RISE * reach, reach < length
    from_a, from_b = up > most, down > most
    uneven_a = up > max(least, _MOST_UNEVEN * (0.0 if is_long and from_b else down))
    uneven_b = down > max(least, _MOST_UNEVEN * (0.0 if is_long and from_a else up))
    a_is_tip = from_a or (uneven_a and (is_long or not b_is_smooth))
    b_is_tip = from_b or (uneven_b and (is_long or not a_is_smooth))
    for k in range(3):
        if a_is_tip:
            scratch[k] = 0.0
        if b_is_tip:
            scratch[3 + k] = 0.0
        normals[i, k] = scratch[k] + scratch[3 + k]
        norm += normals[i, k] ** 2
    for k in range(3):
        places[i, k] -= 0.125 * (rise * scratch[k] + fall * scratch[3 + k])
        normals[i, k] /= math.sqrt(norm) if norm > 0.0 else 1.0


@kernel((MESH_ARRAYS, numba.int64, numba.int64, numba.float64, _MIDPOINTS, numba.int64), **LEAN)
def set_curved_midpoint(
    mesh: MeshArrays, h: int, new: int, cosine: float, middles: Midpoints, i: int
) -> None:
    """Set the place and the normal of the new vertex of the edge that h is the first half of."""
    a, b = mesh.vert[h], mesh.vert[following(new)]
    for k in range(3):
        middles.places[i, k] = 0.5 * (mesh.points[a, k] + mesh.points[b, k])
        middles.normals[i, k] = 0.0
    if _is_hard(mesh, h, cosine):
        _bend_crease(mesh, h, new, cosine, middles, i)
    else:
        _bend_patch(mesh, h, new, cosine, middles, i)


@kernel((MESH_ARRAYS, _TABLE, numba.float64, _MIDPOINTS))
def curved_midpoints(mesh: MeshArrays, births: Indices, cosine: float, middles: Midpoints) -> None:
    """Compute positions and normals of the new vertices of `births` (N, BIRTH_SIZE) on a smooth surface.

    Soft edges bend with the normals at their ends, which stop at creases. Crease edges bend with the crease.
    Flat faces and straight creases stay exact. With a cosine of -1 only tagged edges and boundaries are
    creases.
    """
    if len(births):
        middles.scratch[6] = mesh.vert[births[0, BIRTH_HALFEDGE]]
    for i in range(len(births)):
        new = births[i, BIRTH_HALFEDGE]
        h = incoming(mesh, new, births[i, 0])
        set_curved_midpoint(mesh, h, new, cosine, middles, i)


@kernel((MESH_ARRAYS, numba.int64, numba.int64, RING, MATRIX), **LEAN)
def _copy_ring_at_rest(mesh: MeshArrays, spoke: int, column: int, ring: Ring, rest: Points) -> None:
    """Copy the rest positions, `column` on, of the start of a spoke and of its ring into `rest` (V, 3)."""
    attributes, v = mesh.attributes, mesh.vert[spoke]
    if not collect_ring(mesh, spoke, ring):
        return
    for k in range(3):
        rest[v, k] = attributes[v, column + k]
    for j in range(ring.size[1]):
        v = ring.vertex[j]
        for k in range(3):
            rest[v, k] = attributes[v, column + k]


@kernel(numba.boolean(MATRIX, numba.int64, numba.int64, numba.int64, numba.int64), **LEAN)
def _is_level(attributes: Points, column: int, normal_column: int, a: int, b: int) -> bool:
    """Tell whether two vertices have the same unit normal at rest, and lie in the plane across it."""
    leaning, height, length, size = 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        along = attributes[b, column + k] - attributes[a, column + k]
        normal = attributes[a, normal_column + k]
        leaning += (attributes[b, normal_column + k] - normal) ** 2
        height += normal * along
        length += along * along
        size += normal * normal
    is_across = height * height <= _LEVEL * _LEVEL * length
    return bool(is_across and leaning <= _LEVEL * _LEVEL and abs(size - 1.0) <= _LEVEL)


@kernel((MESH_ARRAYS, _TABLE, numba.int64, numba.int64, RING, MATRIX, _MIDPOINTS, VECTOR))
def rest_midpoints(
    mesh: MeshArrays,
    births: Indices,
    column: int,
    normal_column: int,
    ring: Ring,
    rest: Points,
    middles: Midpoints,
    sizes: Floats,
) -> None:
    """Compute what `curved_midpoints` does on the surface at rest, where only tagged edges are creases.

    column, normal_column  first columns of the rest position and the rest normal; a new vertex gets its
                           normal, since a split leaves the mean of both ends, which leans at creases
    rest                   (V, 3) scratch for rest positions
    sizes                  (N,) receives the length of each edge
    """
    attributes, vert = mesh.attributes, mesh.vert
    places, normals, scratch = middles
    at_rest = MeshArrays(rest, attributes, mesh.blends, vert, mesh.twin, mesh.tagged)
    if len(births):
        scratch[6] = vert[births[0, BIRTH_HALFEDGE]]
    for i in range(len(births)):
        a, b, new = births[i, 0], births[i, 1], births[i, BIRTH_HALFEDGE]
        h = incoming(mesh, new, a)
        middle, squares, known = vert[new], 0.0, 0.0
        is_hard = mesh.twin[h] < 0 or mesh.tagged[h] & _CREASE
        if not is_hard and _is_level(attributes, column, normal_column, a, b):
            for k in range(3):
                places[i, k] = 0.5 * (attributes[a, column + k] + attributes[b, column + k])
                normals[i, k] = attributes[a, normal_column + k]
        else:
            _copy_ring_at_rest(mesh, h, column, ring, rest)
            _copy_ring_at_rest(mesh, following(new), column, ring, rest)
            set_curved_midpoint(at_rest, h, new, ONLY_TAGGED, middles, i)
        for k in range(3):
            squares += (attributes[b, column + k] - attributes[a, column + k]) ** 2
            known += abs(normals[i, k])
        sizes[i] = math.sqrt(squares)
        for k in range(3):
            if known > 0.0:
                attributes[middle, normal_column + k] = normals[i, k]
