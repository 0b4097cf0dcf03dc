"""The faces around a vertex at rest, and the search for the point of them that is now closest to a goal."""

from __future__ import annotations

import math

import numba
import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices, Points, Vectors
from pipeline.kernels import kernel
from pipeline.mesh.kernels.halfedge import INTS, LEAN, MATRIX, MESH_ARRAYS, VECTOR, MeshArrays, following
from pipeline.resample.kernels.pass_state import RING, Ring, collect_ring

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


@kernel((MATRIX, INTS, numba.int64, numba.int64, _CORNER_PAIRS, MATRIX, _CORNERS, MATRIX, MATRIX, VECTOR))
def measure_at_rest(
    attributes: Points,
    vertices: Indices,
    column: int,
    normal_column: int,
    opposite: Indices,
    centre: Points,
    corners: Points,
    normals: Vectors,
    middle: Points,
    sizes: Floats,
) -> None:
    """Fill the arrays of `RestRings` for these vertices (N,), given their `opposite_corners`.

    column, normal_column  the first columns of the rest position and the rest normal
    """
    for i in range(len(vertices)):
        many, squares, length = 0, 0.0, 0.0
        is_line = opposite[i, 0, 0] == opposite[i, 0, 1]
        for k in range(3):
            centre[i, k] = attributes[vertices[i], column + k]
            normals[i, k] = 0.0 if is_line else attributes[vertices[i], normal_column + k]
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
