"""Curved patches over split edges (P37): where their middles lie if the surface is smooth between creases."""

from __future__ import annotations

import math

import numba

from pipeline.arrays import Floats, Indices, Points, Vectors
from pipeline.kernels import kernel
from pipeline.mesh._kernels_halfedge import (
    LEAN,
    MATRIX,
    SURFACE,
    VECTOR,
    Surface,
    following,
    preceding,
)
from pipeline.resample._kernels_lists import area_vector, squared
from pipeline.resample._kernels_ring import RING, Ring, walk
from pipeline.resample._kernels_split import LEAVING

_TABLE = numba.int32[:, ::1]
_LEAST_COSINE = 0.5  # a crease that turns by more than 60 degrees has a corner there


@kernel(numba.boolean(SURFACE, numba.int64, numba.float64), **LEAN)
def _hard(surface: Surface, h: int, cosine: float) -> bool:
    """Whether the edge of h is tagged, a boundary, or turns by more than the angle of that cosine."""
    back = surface.twin[h]
    if back < 0 or surface.tagged[h]:
        return True
    if cosine <= -1.0:
        return False
    vert, points = surface.vert, surface.points
    a, b = vert[h], vert[following(h)]
    mx, my, mz = area_vector(points, a, b, vert[preceding(h)])
    nx, ny, nz = area_vector(points, b, a, vert[preceding(back)])
    dot = mx * nx + my * ny + mz * nz
    both = (mx * mx + my * my + mz * mz) * (nx * nx + ny * ny + nz * nz)
    return bool(dot * abs(dot) < cosine * abs(cosine) * both)


@kernel((SURFACE, numba.int64, VECTOR, numba.int64), **LEAN)
def _add_face(surface: Surface, h: int, total: Floats, at: int) -> None:
    """Add the unit normal of the face of h, times its angle at the start of h."""
    vert, points = surface.vert, surface.points
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


@kernel((SURFACE, numba.int64, numba.float64, VECTOR, numba.int64), **LEAN)
def side_normal(surface: Surface, h: int, cosine: float, out: Floats, at: int) -> None:
    """Unit normal at the start of h of the smooth surface around, up to the next creases, into `out[at:]`.

    The edge of h is soft.
    """
    twin = surface.twin
    out[at] = out[at + 1] = out[at + 2] = 0.0
    k, whole = h, False
    while True:
        _add_face(surface, k, out, at)
        if _hard(surface, preceding(k), cosine):
            break
        k = twin[preceding(k)]
        if k == h:
            whole = True
            break
    k = h
    while not whole and not _hard(surface, k, cosine):
        k = following(twin[k])
        _add_face(surface, k, out, at)
    length = math.sqrt(out[at] ** 2 + out[at + 1] ** 2 + out[at + 2] ** 2)
    if length > 0.0:
        for i in range(3):
            out[at + i] /= length


@kernel(numba.int64(SURFACE, numba.int64, numba.int64, numba.float64), **LEAN)
def _onward(surface: Surface, h: int, before: int, cosine: float) -> int:
    """Where the crease that comes from the vertex `before` goes on beyond the start of h; -1 at its end."""
    vert, twin = surface.vert, surface.twin
    found, many, k = -1, 0, h
    while True:
        if vert[following(k)] != before and _hard(surface, k, cosine):
            found, many = vert[following(k)], many + 1
        back = preceding(k)
        k = twin[back]
        if k < 0 and vert[back] != before:
            found, many = vert[back], many + 1
        if k < 0 or k == h:
            break
    while k < 0 and twin[h] >= 0:  # the fan is open: on to its other side
        h = following(twin[h])
        if vert[following(h)] != before and _hard(surface, h, cosine):
            found, many = vert[following(h)], many + 1
    return found if many == 1 else -1


@kernel(numba.boolean(SURFACE, numba.int64, numba.int64, numba.int64, numba.int64, VECTOR), **LEAN)
def _tangent(surface: Surface, v: int, to: int, beyond: int, at: int, out: Floats) -> bool:
    """Unit tangent at v of the circle through `beyond`, v and `to`, into `out[at:]`; false at a corner.

    It is the mean of the two chords, each weighted by the length of the other. `out[6]` is the first vertex
    of this pass: where the edge to `beyond` has been cut, that is the middle of the chord.
    """
    if beyond < 0:
        return False
    points = surface.points
    p, q = math.sqrt(squared(points, v, beyond)), math.sqrt(squared(points, to, v))
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


@kernel((SURFACE, numba.int64, numba.int64, numba.float64, VECTOR, MATRIX, numba.int64), **LEAN)
def _bend_crease(
    surface: Surface, h: int, new: int, cosine: float, scratch: Floats, places: Points, i: int
) -> None:
    """Move `places[i]`, the middle of a crease's edge, onto the curve of the crease (cubic Hermite).

    Where the crease begins or ends at a corner, the curve is taken for a circle.
    """
    vert, points = surface.vert, surface.points
    a, middle, b = vert[h], vert[new], vert[following(new)]
    begins = _tangent(surface, a, b, _onward(surface, h, middle, cosine), 0, scratch)
    ends = _tangent(surface, b, a, _onward(surface, following(new), middle, cosine), 3, scratch)
    length = math.sqrt(squared(points, a, b))
    if not (begins or ends) or length == 0.0:
        return
    along, known = 0.0, 0 if begins else 3
    for k in range(3):
        along += scratch[known + k] * (points[b, k] - points[a, k]) / length
    for k in range(3):
        mirrored = scratch[known + k] - 2.0 * along * (points[b, k] - points[a, k]) / length
        start, end = scratch[k] if begins else mirrored, scratch[3 + k] if ends else mirrored
        places[i, k] += 0.125 * length * (start + end)


@kernel((SURFACE, numba.int64, numba.int64, numba.float64, VECTOR, MATRIX, MATRIX, numba.int64), **LEAN)
def _bend_patch(
    surface: Surface,
    h: int,
    new: int,
    cosine: float,
    scratch: Floats,
    places: Points,
    normals: Vectors,
    i: int,
) -> None:
    """Move `places[i]`, the middle of a soft edge, onto the cubic that leaves both ends across their normals.

    Source: Vlachos, Peters, Boyd & Mitchell, *Curved PN Triangles* (2001), the border curve at one half.
    """
    points, vert = surface.points, surface.vert
    a, b = vert[h], vert[following(new)]
    side_normal(surface, h, cosine, scratch, 0)
    side_normal(surface, surface.twin[new], cosine, scratch, 3)
    rise, fall, length = 0.0, 0.0, 0.0
    for k in range(3):
        rise += (points[b, k] - points[a, k]) * scratch[k]
        fall += (points[a, k] - points[b, k]) * scratch[3 + k]
        normals[i, k] = scratch[k] + scratch[3 + k]
        length += normals[i, k] ** 2
    for k in range(3):
        places[i, k] -= 0.125 * (rise * scratch[k] + fall * scratch[3 + k])
        normals[i, k] /= math.sqrt(length) if length > 0.0 else 1.0


@kernel(numba.int64(SURFACE, numba.int64, numba.int64), **LEAN)
def arriving(surface: Surface, new: int, a: int) -> int:
    """The half-edge a→vertex, from the one that leaves the vertex for its other parent.

    It may have another place in the table than when it was cut, if its face was cut again in the same pass.
    """
    k = preceding(new)
    while surface.vert[k] != a:
        k = preceding(surface.twin[k])
    return int(k)


@kernel((SURFACE, _TABLE, numba.float64, VECTOR, MATRIX, MATRIX))
def curved_middles(
    surface: Surface, births: Indices, cosine: float, scratch: Floats, places: Points, normals: Vectors
) -> None:
    """Where the new vertices of `births` (N, BIRTH) lie on a smooth surface, and its normals there.

    Soft edges bend with the normals at their ends, which stop at creases; edges of creases bend with the
    crease and have no normal (zero). Flat sides and straight creases stay exactly what they are. With a
    cosine of -1 only tagged edges and boundaries are creases. `scratch` has seven entries.
    """
    if len(births):
        scratch[6] = surface.vert[births[0, LEAVING]]
    for i in range(len(births)):
        a, b, new = births[i, 0], births[i, 1], births[i, LEAVING]
        h = arriving(surface, new, a)
        for k in range(3):
            places[i, k] = 0.5 * (surface.points[a, k] + surface.points[b, k])
            normals[i, k] = 0.0
        if _hard(surface, h, cosine):
            _bend_crease(surface, h, new, cosine, scratch, places, i)
        else:
            _bend_patch(surface, h, new, cosine, scratch, places, normals, i)


@kernel((SURFACE, _TABLE, numba.int64, RING, MATRIX))
def lay_out(surface: Surface, births: Indices, column: int, ring: Ring, rest: Points) -> None:
    """Write into `rest` (V, 3) the places at rest, from `column` on, of all that is around the parents of the
    new vertices of `births`."""
    vert, carried = surface.vert, surface.carried
    for i in range(len(births)):
        new = births[i, LEAVING]
        for spoke in (arriving(surface, new, births[i, 0]), following(new)):
            if not walk(surface, spoke, ring):
                continue
            for k in range(3):
                rest[vert[spoke], k] = carried[vert[spoke], column + k]
            for j in range(ring.size[1]):
                v = ring.vertex[j]
                for k in range(3):
                    rest[v, k] = carried[v, column + k]
