"""One pass over all edges: which are out of the bracket, and how far it reaches."""

from __future__ import annotations

import numba
import numpy as np

from pipeline.arrays import Floats, Indices
from pipeline.kernels import kernel
from pipeline.mesh._kernels_halfedge import INTS, LEAN, SURFACE, VECTOR, Surface
from pipeline.resample._kernels_lists import push, squared


@kernel((SURFACE, numba.int64, numba.float64, VECTOR, INTS, INTS, VECTOR), **LEAN)
def _list(
    surface: Surface, h: int, length: float, limits: Floats, longs: Indices, shorts: Indices, extent: Floats
) -> None:
    if not length < np.inf:
        extent[2] += 1
    if surface.twin[h] > h:
        return
    if length > limits[0]:
        push(longs, h)
    elif length < limits[1]:
        push(shorts, h)


@kernel((SURFACE, numba.int64, VECTOR, INTS, INTS, VECTOR), **LEAN)
def scan(
    surface: Surface, faces: int, limits: Floats, longs: Indices, shorts: Indices, extent: Floats
) -> None:
    """List every edge out of the bracket once; `extent` gets the shortest and longest squared length,
    and the number of edges (seen from their faces) whose length is not finite.

    `limits` begins with the largest and smallest squared length allowed. Faces are visited in order and
    only the edges listed look at their twins, so the pass costs little more than reading the mesh.
    """
    points, vert = surface.points, surface.vert
    most, least = limits[0], limits[1]
    low, high = extent[0], extent[1]
    for f in range(faces):
        h = 3 * f
        a, b, c = vert[h], vert[h + 1], vert[h + 2]
        if a < 0:
            continue
        ab, bc, ca = squared(points, a, b), squared(points, b, c), squared(points, c, a)
        small = ab if ab < bc else bc
        small = ca if ca < small else small
        large = ab if ab > bc else bc
        large = ca if ca > large else large
        low = small if small < low else low
        high = large if large > high else high
        finite = ab + bc + ca < np.inf  # comparisons with nan are false, and lose it above
        if not (large <= most and small >= least and finite):
            _list(surface, h, ab, limits, longs, shorts, extent)
            _list(surface, h + 1, bc, limits, longs, shorts, extent)
            _list(surface, h + 2, ca, limits, longs, shorts, extent)
    extent[0], extent[1] = low, high
