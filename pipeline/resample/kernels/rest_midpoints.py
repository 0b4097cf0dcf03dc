"""Midpoints of split edges on the surface at rest, on curved patches over it where it is not level."""

from __future__ import annotations

import math

import numba

from pipeline.arrays import Floats, Indices, Points, Vectors
from pipeline.kernels import kernel
from pipeline.mesh.kernels.halfedge import LEAN, MATRIX, MESH_ARRAYS, VECTOR, MeshArrays, following
from pipeline.resample.kernels.curved_patches import incoming, set_curved_midpoint
from pipeline.resample.kernels.limits import ONLY_TAGGED
from pipeline.resample.kernels.ring import RING, Ring, collect_ring
from pipeline.resample.kernels.split import BIRTH_HALFEDGE

_TABLE = numba.int32[:, ::1]
_LEVEL = 1e-9  # the most that normals differ, and that edges rise by their length, in a plane


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


@kernel(
    (MESH_ARRAYS, _TABLE, numba.int64, numba.int64, RING, MATRIX, VECTOR, MATRIX, MATRIX, VECTOR),
)
def rest_midpoints(
    mesh: MeshArrays,
    births: Indices,
    column: int,
    normal_column: int,
    ring: Ring,
    rest: Points,
    scratch: Floats,
    places: Points,
    normals: Vectors,
    sizes: Floats,
) -> None:
    """Compute what `curved_midpoints` does on the surface at rest, where only tagged edges are creases.

    column, normal_column  first columns of the rest position and the rest normal; a new vertex gets its
                           normal, since a split leaves the mean of both ends, which leans at creases
    rest                   (V, 3) scratch for rest positions
    sizes                  (N,) receives the length of each edge
    """
    attributes, vert = mesh.attributes, mesh.vert
    at_rest = MeshArrays(rest, attributes, mesh.blends, vert, mesh.twin, mesh.tagged)
    if len(births):
        scratch[6] = vert[births[0, BIRTH_HALFEDGE]]
    for i in range(len(births)):
        a, b, new = births[i, 0], births[i, 1], births[i, BIRTH_HALFEDGE]
        h = incoming(mesh, new, a)
        middle, squares, known = vert[new], 0.0, 0.0
        is_hard = mesh.twin[h] < 0 or mesh.tagged[h]
        if not is_hard and _is_level(attributes, column, normal_column, a, b):
            for k in range(3):
                places[i, k] = 0.5 * (attributes[a, column + k] + attributes[b, column + k])
                normals[i, k] = attributes[a, normal_column + k]
        else:
            _copy_ring_at_rest(mesh, h, column, ring, rest)
            _copy_ring_at_rest(mesh, following(new), column, ring, rest)
            set_curved_midpoint(at_rest, h, new, ONLY_TAGGED, scratch, places, normals, i)
        for k in range(3):
            squares += (attributes[b, column + k] - attributes[a, column + k]) ** 2
            known += abs(normals[i, k])
        sizes[i] = math.sqrt(squares)
        for k in range(3):
            if known > 0.0:
                attributes[middle, normal_column + k] = normals[i, k]
