"""Triangles of bad shape: finding their vertices, and moving these within the surface (P36)."""

from __future__ import annotations

import math

import numba

from pipeline.arrays import AnyArray, Floats, Indices, Points, Vectors
from pipeline.kernels import kernel
from pipeline.mesh._kernels_halfedge import BYTES, INTS, LEAN, MATRIX, SURFACE, VECTOR, Surface
from pipeline.resample._kernels_lists import CHANGES, Changes, bracket, hard_cosine, push, squared, touch
from pipeline.resample._kernels_rest import moved_at_rest
from pipeline.resample._kernels_ring import RING, UPRIGHT, Ring, folds, walk, weigh

_FLAT = 1e-9  # how far a ring may leave its plane, in its own lengths, and still count as flat


@kernel(numba.float64(numba.float64, numba.float64, numba.float64), **LEAN)
def roundness(ab: float, bc: float, ca: float) -> float:
    """Twice the inradius over the circumradius, from squared sides: 1 if equilateral, 0 if flat."""
    a, b, c = math.sqrt(bc), math.sqrt(ca), math.sqrt(ab)
    return (b + c - a) * (c + a - b) * (a + b - c) / (a * b * c) if a * b * c > 0.0 else 0.0


@kernel((SURFACE, numba.float64, CHANGES, BYTES, INTS))
def list_poor(surface: Surface, least: float, changes: Changes, seen: AnyArray, spokes: Indices) -> None:
    """List a half-edge from every vertex of changed faces whose roundness is below `least`, each once.

    `seen` (V,) is zero at first.
    """
    vert, points, changed = surface.vert, surface.points, changes.changed
    for i in range(1, changed[0] + 1):
        f = changed[i]
        if vert[3 * f] < 0:
            continue
        a, b, c = vert[3 * f], vert[3 * f + 1], vert[3 * f + 2]
        if roundness(squared(points, a, b), squared(points, b, c), squared(points, c, a)) >= least:
            continue
        for h in range(3 * f, 3 * f + 3):
            if not seen[vert[h]]:
                seen[vert[h]] = 1
                push(spokes, h)


@kernel(numba.boolean(MATRIX, numba.int64, numba.int64, RING, VECTOR), **LEAN)
def _plane(carried: Points, column: int, centre: int, ring: Ring, normal: Floats) -> bool:
    """The unit normal of a closed ring at rest, and whether all of it lies in one plane."""
    faces = ring.size[0]
    normal[0] = normal[1] = normal[2] = 0.0
    for i in range(faces):
        b, c = ring.vertex[i], ring.vertex[i + 1]
        for k in range(3):
            u, v = column + (k + 1) % 3, column + (k + 2) % 3
            one = (carried[b, u] - carried[centre, u]) * (carried[c, v] - carried[centre, v])
            normal[k] += one - (carried[b, v] - carried[centre, v]) * (carried[c, u] - carried[centre, u])
    length = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    if length == 0.0:
        return False
    flat = True
    for k in range(3):
        normal[k] /= length
    for i in range(faces):
        height, reach = 0.0, 0.0
        for k in range(3):
            away = carried[ring.vertex[i], column + k] - carried[centre, column + k]
            height += normal[k] * away
            reach += away * away
        flat = flat and height * height <= _FLAT * _FLAT * reach
    return flat


@kernel(numba.int64(SURFACE, INTS, VECTOR, RING, numba.boolean, MATRIX, MATRIX))
def relaxed(
    surface: Surface,
    spokes: Indices,
    limits: Floats,
    ring: Ring,
    anywhere: bool,
    places: Points,
    normals: Vectors,
) -> int:
    """Where the vertices of `spokes` would lie at rest in the middle of their neighbours; answers how many.

    Left out, and taken off the list, are vertices on hard edges and, unless `anywhere`, those whose
    surroundings at rest are not flat, since the middle is then not on the surface.
    """
    carried, column, kept = surface.carried, int(limits[7]), 0
    for i in range(1, spokes[0] + 1):
        h = spokes[i]
        v = surface.vert[h]
        if not walk(surface, h, ring) or ring.size[0] < ring.size[1]:
            continue
        weigh(surface, v, ring, hard_cosine(surface, limits, v))
        flat = _plane(carried, column, v, ring, ring.place)
        if ring.size[2] > 0 or not (flat or anywhere):
            continue
        for k in range(3):
            normals[kept, k] = ring.place[k]
            places[kept, k] = 0.0
            for j in range(ring.size[1]):
                places[kept, k] += carried[ring.vertex[j], column + k] / ring.size[1]
        kept += 1
        spokes[kept] = h
    spokes[0] = kept
    return kept


@kernel(numba.float64(SURFACE, numba.int64, RING, VECTOR, VECTOR), **LEAN)
def _worst(surface: Surface, centre: int, ring: Ring, place: Floats, limits: Floats) -> float:
    """The worst roundness around a vertex if it lay at `place`; -1 where an edge would leave the bracket."""
    points, spokes = surface.points, ring.size[1]
    worst = 1.0
    for i in range(spokes):
        b, c = ring.vertex[i], ring.vertex[i + 1]
        most, least = bracket(surface, limits, centre, b)
        near, far = 0.0, 0.0
        for k in range(3):
            near += (points[b, k] - place[k]) ** 2
            far += (points[c, k] - place[k]) ** 2
        if near > most or near < least:
            return -1.0
        worst = min(worst, roundness(near, squared(points, b, c), far))
    return worst


@kernel(numba.int64(SURFACE, INTS, MATRIX, MATRIX, VECTOR, RING, CHANGES, BYTES))
def adopt(
    surface: Surface,
    spokes: Indices,
    places: Points,
    goals: Points,
    limits: Floats,
    ring: Ring,
    changes: Changes,
    adopted: AnyArray,
) -> int:
    """Move the vertices of `spokes` to their places, one by one, where the worst triangle around gains.

    At rest they move to their goals. None goes where a face would fold, or turn over at rest, or an edge
    leave the bracket. `adopted` tells which went.
    """
    done = 0
    for i in range(spokes[0]):
        h = spokes[i + 1]
        v = surface.vert[h]
        walk(surface, h, ring)
        weigh(surface, v, ring, limits[2])
        for k in range(3):
            ring.place[k] = surface.points[v, k]
        before = _worst(surface, v, ring, ring.place, limits)
        for k in range(3):
            ring.place[k] = places[i, k]
        adopted[i] = 0
        gains = _worst(surface, v, ring, ring.place, limits) > before
        if not gains or folds(surface.points, ring, -1, ring.place, UPRIGHT):
            continue
        if not moved_at_rest(surface.carried, ring, v, goals, i, limits):
            continue
        for k in range(3):
            surface.points[v, k] = places[i, k]
        for j in range(ring.size[0]):
            touch(changes, ring.leaving[j] // 3)
        adopted[i] = 1
        done += 1
    return done
