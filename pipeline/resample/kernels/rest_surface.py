"""Move vertices on the surface at rest: to the point now closest to a goal, or into the middle of their ring.

The latter relaxes the vertices of badly shaped triangles that gain by moving within the surface (P36).
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
    MATRIX,
    MESH_ARRAYS,
    VECTOR,
    MeshArrays,
    following,
)
from flowsculpt.pipeline.resample.kernels.pass_state import (
    CHANGES,
    LIMITS,
    MAX_TURN_COSINE,
    RING,
    Changes,
    Limits,
    Ring,
    collect_ring,
    folds,
    hard_cosine,
    length_limits,
    measure_faces,
    measure_ring,
    move_at_rest,
    push,
    squared_length,
    touch,
)

MAX_OPPOSITE = 8
LATTICE = 5 * MAX_OPPOSITE
"""The most first guesses around a vertex: five on each face."""

_MAX_STEP = 1 / 6  # of one round, in sides of the triangle
_NEARLY_PARALLEL = 1e-12  # squared sine of the angle between two vectors that no plane is taken to hold
_CORNER_PAIRS = numba.int32[:, :, ::1]
_CORNERS = numba.float64[:, :, :, ::1]


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


class RestRings(NamedTuple):
    """The rings of vertices at rest.

    spokes   (N,) a half-edge that leaves each vertex
    centre   (N, 3) the vertices
    corners  (N, K, 2, 3) the other corners of the surrounding faces, nan where there are fewer than K; on a
             crease its two edges, each as twice the same corner
    normals  (N, 3) unit, zero on creases
    middle   (N, 3) the mean of the corners
    sizes    (N,) the length of one spoke, scene units
    """

    spokes: Indices
    centre: Points
    corners: Points
    normals: Vectors
    middle: Points
    sizes: Floats


_RINGS = numba.types.NamedTuple([INTS, MATRIX, _CORNERS, MATRIX, MATRIX, VECTOR], RestRings)


@kernel((MESH_ARRAYS, numba.int64, numba.int64, _CORNER_PAIRS, _RINGS))
def measure_at_rest(
    mesh: MeshArrays, column: int, normal_column: int, opposite: Indices, rings: RestRings
) -> None:
    """Fill all arrays of rings except their spokes, given the `opposite_corners` of their vertices.

    column, normal_column  the first columns of the rest position and the rest normal
    """
    attributes, (spokes, centre, corners, normals, middle, sizes) = mesh.attributes, rings
    for i in range(len(spokes)):
        vertex = mesh.vert[spokes[i]]
        many, squares, length = 0, 0.0, 0.0
        is_line = opposite[i, 0, 0] == opposite[i, 0, 1]
        for k in range(3):
            centre[i, k] = attributes[vertex, column + k]
            normals[i, k] = 0.0 if is_line else attributes[vertex, normal_column + k]
            squares += normals[i, k] ** 2
            middle[i, k] = 0.0
        for j in range(MAX_OPPOSITE):
            for side in range(2):
                v = opposite[i, j, side]
                for k in range(3):
                    corners[i, j, side, k] = attributes[v, column + k] if v >= 0 else np.nan
                    middle[i, k] += corners[i, j, side, k] if v >= 0 else 0.0
                many += v >= 0
        for k in range(3):
            middle[i, k] /= many
            normals[i, k] /= math.sqrt(squares) if squares > 0.0 else 1.0
            length += (corners[i, 0, 0, k] - centre[i, k]) ** 2
        sizes[i] = math.sqrt(length)


@kernel((MATRIX, numba.int64, MATRIX, numba.int64, VECTOR, VECTOR, numba.float64, numba.float64), **LEAN)
def _mix(
    lattice: Points, row: int, centre: Points, i: int, b: Floats, c: Floats, at_b: float, at_c: float
) -> None:
    """Write the point of the triangle centre[i], b, c with these barycentric coordinates into the lattice."""
    for k in range(3):
        lattice[row, k] = (1.0 - at_b - at_c) * centre[i, k] + (at_b * b[k] + at_c * c[k])


@kernel(numba.int64(MATRIX, _CORNERS, MATRIX, numba.int64[::1]))
def place_lattice(centre: Points, corners: Points, lattice: Points, starts: AnyArray) -> int:
    """Fill `lattice` with first guesses around each vertex: thirds of each spoke and the middle of each face.

    centre, corners  as in `RestRings`
    starts           (N + 1,) receives the first row of each vertex, and at last the number of rows

    Returns that number. A spoke that two faces share gets its points once.
    """
    row, third = 0, 1.0 / 3.0
    for i in range(len(centre)):
        starts[i], many = row, 0
        while many < MAX_OPPOSITE and not np.isnan(corners[i, many, 0, 0]):
            many += 1
        for j in range(many):
            b, c, beyond = corners[i, j, 0], corners[i, j, 1], corners[i, (j + 1) % many, 0]
            is_line = shared = True
            for k in range(3):
                is_line &= b[k] == c[k]
                shared &= c[k] == beyond[k]
            for share in (third, 2.0 * third):
                _mix(lattice, row, centre, i, b, c, share, 0.0)
                row += 1
            if not is_line:
                _mix(lattice, row, centre, i, b, c, third, third)
                row += 1
            for share in (third, 2.0 * third):
                if not (is_line or shared):
                    _mix(lattice, row, centre, i, b, c, 0.0, share)
                    row += 1
    starts[len(centre)] = row
    return row


@kernel(numba.float64(MATRIX, numba.int64, MATRIX, numba.int64), **LEAN)
def _squared_distance(one: Points, i: int, other: Points, j: int) -> float:
    """Return the squared distance between two points."""
    total = 0.0
    for k in range(3):
        total += (one[i, k] - other[j, k]) ** 2
    return total


@kernel((numba.int64[::1], MATRIX, MATRIX, MATRIX, MATRIX, MATRIX))
def choose_nearest(
    starts: AnyArray, candidates: Points, carried: Points, goals: Points, nearest_rest: Points, places: Points
) -> None:
    """Set the candidate, at rest and carried, that is closest to each vertex's goal; the first of equals.

    starts  (N + 1,) rows of the candidates (M, 3) of each vertex
    """
    for i in range(len(goals)):
        best = starts[i]
        for row in range(starts[i] + 1, starts[i + 1]):
            if _squared_distance(carried, row, goals, i) < _squared_distance(carried, best, goals, i):
                best = row
        for k in range(3):
            nearest_rest[i, k], places[i, k] = candidates[best, k], carried[best, k]


@kernel((MATRIX, _CORNERS, numba.float64[:, :, ::1]))
def tangent_frames(centre: Points, corners: Points, frames: Vectors) -> None:
    """Fill `frames` (N, 2, 3): two vectors in the plane of the faces around each vertex, zero on lines.

    They are at right angles, and as long as the first spoke is in that plane.
    """
    normal = np.empty(3)
    for i in range(len(centre)):
        normal[:] = 0.0
        for j in range(MAX_OPPOSITE):
            for k in range(3):
                u, v = (k + 1) % 3, (k + 2) % 3
                one = (corners[i, j, 0, u] - centre[i, u]) * (corners[i, j, 1, v] - centre[i, v])
                other = (corners[i, j, 0, v] - centre[i, v]) * (corners[i, j, 1, u] - centre[i, u])
                normal[k] += 0.0 if np.isnan(one - other) else one - other
        length = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
        for k in range(3):
            normal[k] /= length if length > 0.0 else 1.0
            frames[i, 0, k] = corners[i, 0, 0, k] - centre[i, k]
        for one, other in ((1, 0), (0, 1)):  # across = normal × spoke; along = across × normal
            sign = 1.0 if one == 1 else -1.0
            x, y, z = frames[i, other, 0], frames[i, other, 1], frames[i, other, 2]
            frames[i, one, 0] = sign * (normal[1] * z - normal[2] * y)
            frames[i, one, 1] = sign * (normal[2] * x - normal[0] * z)
            frames[i, one, 2] = sign * (normal[0] * y - normal[1] * x)


@kernel((MATRIX, numba.float64[:, :, ::1], numba.float64, MATRIX))
def step_aside(points: Points, frames: Vectors, step: float, beside: Points) -> None:
    """Fill `beside` (2N, 3): each point moved along the first vector of its frame, then along the second."""
    for side in range(2):
        for i in range(len(points)):
            for k in range(3):
                beside[side * len(points) + i, k] = points[i, k] + step * frames[i, side, k]


@kernel((MATRIX, MATRIX, MATRIX, MATRIX, numba.float64, numba.float64[:, :, ::1], MATRIX))
def step_to_goals(
    nearest_rest: Points,
    places: Points,
    beside: Points,
    goals: Points,
    step: float,
    frames: Vectors,
    new_rest: Points,
) -> None:
    """Fill `new_rest` (N, 3): the points at rest after one Gauss-Newton step towards the goals.

    beside  (2N, 3) the points of `step_aside`, carried
    step    that they are from theirs, in vectors of the frames
    """
    many = len(places)
    for i in range(many):
        aa, ab, bb, ag, bg = 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(3):
            a, b = (beside[i, k] - places[i, k]) / step, (beside[many + i, k] - places[i, k]) / step
            gap = goals[i, k] - places[i, k]
            aa, ab, bb, ag, bg = aa + a * a, ab + a * b, bb + b * b, ag + a * gap, bg + b * gap
        det, u, v = aa * bb - ab * ab, 0.0, 0.0
        if det > _NEARLY_PARALLEL * aa * bb:
            u, v = (bb * ag - ab * bg) / det, (aa * bg - ab * ag) / det
        size = math.sqrt(u * u + v * v)
        scale = min(1.0, _MAX_STEP / size) if size > 0.0 else 1.0
        for k in range(3):
            new_rest[i, k] = nearest_rest[i, k] + scale * (u * frames[i, 0, k] + v * frames[i, 1, k])


@kernel((MATRIX, MATRIX, MATRIX, MATRIX, MATRIX))
def keep_nearer(
    new_rest: Points, new_places: Points, goals: Points, nearest_rest: Points, places: Points
) -> None:
    """Set those of the new points, at rest and carried, that are closer to the goals than the ones so far."""
    for i in range(len(goals)):
        if _squared_distance(new_places, i, goals, i) < _squared_distance(places, i, goals, i):
            for k in range(3):
                nearest_rest[i, k], places[i, k] = new_rest[i, k], new_places[i, k]


_LEAST_GAIN = 1e-3  # of roundness
_FLAT = 1e-9  # largest distance of a flat ring from its plane, relative to its spokes


@kernel(numba.float64(numba.float64, numba.float64, numba.float64), **LEAN)
def roundness(ab: float, bc: float, ca: float) -> float:
    """Return twice the inradius over the circumradius, from squared sides: 1 if equilateral, 0 if flat."""
    a, b, c = math.sqrt(bc), math.sqrt(ca), math.sqrt(ab)
    return (b + c - a) * (c + a - b) * (a + b - c) / (a * b * c) if a * b * c > 0.0 else 0.0


@kernel((MESH_ARRAYS, numba.float64, CHANGES, BYTES, INTS))
def list_poor_vertices(
    mesh: MeshArrays, min_roundness: float, changes: Changes, seen: AnyArray, spokes: Indices
) -> None:
    """List a half-edge from every vertex of changed faces with a roundness below `min_roundness`, each once.

    `seen` (V,) must be zero.
    """
    vert, points, changed = mesh.vert, mesh.points, changes.changed
    for i in range(1, changed[0] + 1):
        f = changed[i]
        if vert[3 * f] < 0:
            continue
        a, b, c = vert[3 * f], vert[3 * f + 1], vert[3 * f + 2]
        ab, bc, ca = squared_length(points, a, b), squared_length(points, b, c), squared_length(points, c, a)
        if roundness(ab, bc, ca) >= min_roundness:
            continue
        for h in range(3 * f, 3 * f + 3):
            if not seen[vert[h]]:
                seen[vert[h]] = 1
                push(spokes, h)


@kernel(numba.boolean(MATRIX, numba.int64, numba.int64, RING, VECTOR), **LEAN)
def _rest_plane(attributes: Points, column: int, centre: int, ring: Ring, normal: Floats) -> bool:
    """Write the unit normal of a closed ring at rest; return whether the ring is flat there."""
    faces = ring.size[0]
    normal[0] = normal[1] = normal[2] = 0.0
    for i in range(faces):
        b, c = ring.vertex[i], ring.vertex[i + 1]
        for k in range(3):
            u, v = column + (k + 1) % 3, column + (k + 2) % 3
            one = (attributes[b, u] - attributes[centre, u]) * (attributes[c, v] - attributes[centre, v])
            normal[k] += one - (attributes[b, v] - attributes[centre, v]) * (
                attributes[c, u] - attributes[centre, u]
            )
    length = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    if length == 0.0:
        return False
    flat = True
    for k in range(3):
        normal[k] /= length
    for i in range(faces):
        height, reach = 0.0, 0.0
        for k in range(3):
            away = attributes[ring.vertex[i], column + k] - attributes[centre, column + k]
            height += normal[k] * away
            reach += away * away
        flat = flat and height * height <= _FLAT * _FLAT * reach
    return flat


@kernel(numba.float64(MESH_ARRAYS, numba.int64, RING, VECTOR, LIMITS), **LEAN)
def _worst_roundness(mesh: MeshArrays, centre: int, ring: Ring, place: Floats, limits: Limits) -> float:
    """Return the worst roundness around a vertex placed at `place`; -1 if an edge would leave its limits."""
    points, spokes = mesh.points, ring.size[1]
    worst = 1.0
    for i in range(spokes):
        b, c = ring.vertex[i], ring.vertex[i + 1]
        max_squared, min_squared = length_limits(mesh, limits, centre, b)
        near, far = 0.0, 0.0
        for k in range(3):
            near += (points[b, k] - place[k]) ** 2
            far += (points[c, k] - place[k]) ** 2
        if near > max_squared or near < min_squared:
            return -1.0
        worst = min(worst, roundness(near, squared_length(points, b, c), far))
    return worst


@kernel((MESH_ARRAYS, numba.int64, numba.int64, RING, VECTOR, MATRIX, numba.int64), **LEAN)
def _predict_place(
    mesh: MeshArrays, column: int, centre: int, ring: Ring, normal: Floats, goals: Points, i: int
) -> None:
    """Write to `ring.place` where `goals[i]` at rest is about now: in the plane of the face that it lies in.

    normal  (3,) of the ring at rest; areas of triangles are taken along it
    """
    attributes, points = mesh.attributes, mesh.points
    inmost = -math.inf
    for j in range(ring.size[0]):
        b, c = ring.vertex[j], ring.vertex[j + 1]
        whole, at_b, at_c = 0.0, 0.0, 0.0
        for k in range(3):
            u, v = (k + 1) % 3, (k + 2) % 3
            b1, b2 = attributes[b, column + u], attributes[b, column + v]
            c1, c2 = attributes[c, column + u], attributes[c, column + v]
            o1, o2 = attributes[centre, column + u], attributes[centre, column + v]
            b1, b2, c1, c2 = b1 - o1, b2 - o2, c1 - o1, c2 - o2
            g1, g2 = goals[i, u] - o1, goals[i, v] - o2
            whole += normal[k] * (b1 * c2 - b2 * c1)
            at_b += normal[k] * (g1 * c2 - g2 * c1)
            at_c += normal[k] * (b1 * g2 - b2 * g1)
        if whole <= 0.0 or min(at_b, at_c) <= inmost * whole:
            continue
        inmost = min(at_b, at_c) / whole
        for k in range(3):
            along_b, along_c = points[b, k] - points[centre, k], points[c, k] - points[centre, k]
            ring.place[k] = points[centre, k] + (at_b * along_b + at_c * along_c) / whole


@kernel(numba.int64(MESH_ARRAYS, INTS, LIMITS, RING, numba.boolean, MATRIX, MATRIX, VECTOR))
def relax_goals(
    mesh: MeshArrays,
    spokes: Indices,
    limits: Limits,
    ring: Ring,
    anywhere: bool,
    places: Points,
    normals: Vectors,
    sizes: Floats,
) -> int:
    """Compute rest positions in the middle of the neighbours of `spokes`' starts; return how many are kept.

    Drops from the list vertices on hard edges and, unless `anywhere`, those whose ring is not flat at rest,
    because the middle then lies off the surface. Drops also those that would gain less than _LEAST_GAIN where
    `_predict_place` puts them: to carry a point takes far longer than to judge it.

    places, normals  (N, 3) and sizes (N,) receive for each its place, the unit normal of its ring, and the
                     length of its spoke, all at rest
    """
    attributes, column, kept = mesh.attributes, limits.rest_column, 0
    place = ring.place
    for i in range(1, spokes[0] + 1):
        h = spokes[i]
        v = mesh.vert[h]
        if not collect_ring(mesh, h, ring) or ring.size[0] < ring.size[1]:
            continue
        measure_ring(mesh, v, ring, hard_cosine(mesh, limits, v))
        flat = _rest_plane(attributes, column, v, ring, normals[kept])
        if ring.size[2] > 0 or not (flat or anywhere):
            continue
        other, sizes[kept] = mesh.vert[following(h)], 0.0
        for k in range(3):
            sizes[kept] += (attributes[other, column + k] - attributes[v, column + k]) ** 2
            places[kept, k], place[k] = 0.0, mesh.points[v, k]
            for j in range(ring.size[1]):
                places[kept, k] += attributes[ring.vertex[j], column + k] / ring.size[1]
        sizes[kept] = math.sqrt(sizes[kept])
        wanted = _worst_roundness(mesh, v, ring, place, limits) + _LEAST_GAIN
        _predict_place(mesh, column, v, ring, normals[kept], places, kept)
        if _worst_roundness(mesh, v, ring, place, limits) < max(wanted, 0.0):
            continue
        if folds(mesh.points, ring, -1, place, MAX_TURN_COSINE):
            continue
        kept += 1
        spokes[kept] = h
    spokes[0] = kept
    return kept


@kernel(numba.int64(MESH_ARRAYS, INTS, MATRIX, MATRIX, LIMITS, RING, CHANGES, BYTES))
def relax_vertices(
    mesh: MeshArrays,
    spokes: Indices,
    places: Points,
    goals: Points,
    limits: Limits,
    ring: Ring,
    changes: Changes,
    moved: AnyArray,
) -> int:
    """Move the starts of `spokes` to their places, one by one, where the worst triangle around improves.

    Their rest positions become `goals`. A vertex stays where a face would fold, would turn over at rest, or
    an edge would leave its limits. `moved` flags the vertices that moved; their number is returned.
    """
    done = 0
    for i in range(spokes[0]):
        h = spokes[i + 1]
        v = mesh.vert[h]
        collect_ring(mesh, h, ring)
        measure_faces(mesh, v, ring)
        for k in range(3):
            ring.place[k] = mesh.points[v, k]
        before = _worst_roundness(mesh, v, ring, ring.place, limits)
        for k in range(3):
            ring.place[k] = places[i, k]
        moved[i] = 0
        gains = _worst_roundness(mesh, v, ring, ring.place, limits) > before
        if not gains or folds(mesh.points, ring, -1, ring.place, MAX_TURN_COSINE):
            continue
        if not move_at_rest(mesh.attributes, ring, v, goals, i, limits):
            continue
        for k in range(3):
            mesh.points[v, k] = places[i, k]
        for j in range(ring.size[0]):
            touch(changes, ring.leaving[j] // 3)
        moved[i] = 1
        done += 1
    return done
