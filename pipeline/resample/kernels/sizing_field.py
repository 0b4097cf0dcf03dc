"""Edge lengths over a surface: curvature from normals, and gradation."""

from __future__ import annotations

import math

import numba
import numpy as np

from pipeline.arrays import Faces, Floats, Points, Vectors
from pipeline.kernels import kernel
from pipeline.mesh.kernels.halfedge import MATRIX, VECTOR

FACES = numba.int32[:, ::1]


@kernel(numba.float64(MATRIX, numba.int64, numba.int64))
def _distance(rows: Points, a: int, b: int) -> float:
    """Return the distance between rows a and b."""
    x, y, z = rows[b, 0] - rows[a, 0], rows[b, 1] - rows[a, 1], rows[b, 2] - rows[a, 2]
    return math.sqrt(x * x + y * y + z * z)


@kernel((MATRIX, FACES, MATRIX, numba.float64, VECTOR))
def edge_curvature(
    points: Points, faces: Faces, normals: Vectors, shortest: float, curvature: Floats
) -> None:
    """Compute the largest curvature, in 1 / scene unit, along the edges at every vertex.

    Two unit normals differ by 2 sin(θ/2), and so do the ends of a chord that turns by θ on a unit circle:
    their quotient is the exact curvature of the circle through both. Edges below `shortest` count as that
    long, so that noise in their normals does not pass for curvature.
    """
    curvature[:] = 0.0
    for f in range(len(faces)):
        for i in range(3):
            a, b = faces[f, i], faces[f, (i + 1) % 3]
            bent = _distance(normals, a, b) / max(_distance(points, a, b), shortest)
            curvature[a] = max(curvature[a], bent)
            curvature[b] = max(curvature[b], bent)


@kernel(numba.boolean(VECTOR, numba.int64, numba.int64, numba.float64))
def _lower_longer(lengths: Floats, a: int, b: int, rise: float) -> bool:
    """Lower the longer of two lengths to the other plus `rise`, if it is above; return whether it was."""
    if lengths[a] > lengths[b] + rise:
        lengths[a] = lengths[b] + rise
    elif lengths[b] > lengths[a] + rise:
        lengths[b] = lengths[a] + rise
    else:
        return False
    return True


@kernel(numba.int64(MATRIX, FACES, numba.float64, VECTOR))
def limit_gradation(points: Points, faces: Faces, slope: float, lengths: Floats) -> int:
    """Lower lengths until they differ by at most slope × distance along every edge; return the sweeps taken.

    Each length becomes the least, over all paths along edges, of the length at the path's start plus
    slope × the path's length. Rounding keeps the order of sums, so the order of sweeps changes no bit. Sweeps
    alternate in direction, since vertices lie in memory much as they lie on the surface.
    """
    last = len(faces) - 1
    rises = np.empty((len(faces), 3))
    for f in range(len(faces)):
        for i in range(3):
            rises[f, i] = slope * _distance(points, faces[f, i], faces[f, (i + 1) % 3])
    sweeps, changed = 0, True
    while changed:
        changed = False
        for j in range(len(faces)):
            f = j if sweeps % 2 == 0 else last - j
            for i in range(3):
                if _lower_longer(lengths, faces[f, i], faces[f, (i + 1) % 3], rises[f, i]):
                    changed = True
        sweeps += 1
    return sweeps
