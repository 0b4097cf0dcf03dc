"""Relax the vertices of badly shaped triangles (P36): those that gain by moving within the surface."""

from __future__ import annotations

import math

import numba

from pipeline.arrays import AnyArray, Floats, Indices, Points, Vectors
from pipeline.kernels import kernel
from pipeline.mesh.kernels.halfedge import (
    BYTES,
    INTS,
    LEAN,
    MATRIX,
    MESH_ARRAYS,
    VECTOR,
    MeshArrays,
    following,
)
from pipeline.resample.kernels.pass_state import (
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
