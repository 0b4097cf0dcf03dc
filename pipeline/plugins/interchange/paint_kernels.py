"""The nearest points of charts of a painted model."""

from __future__ import annotations

import numpy as np

from flowsculpt.api.flows import DEEPEST, doubles_at, kernel, nearest
from flowsculpt.api.meshes import Floats


@kernel("void(f8[:, ::1], i8[::1], i8[::1], i8[::1], i8[::1], f8[:, ::1])")
def find_nearest(
    points: Floats,
    trees: np.ndarray,
    addresses: np.ndarray,
    starts: np.ndarray,
    found: np.ndarray,
    places: Floats,
) -> None:
    """Find the nearest triangle of a tree at each point, and the nearest point in it.

    points     (N, 3), finite
    trees      (N,) the number of the `TriangleTree` of each point
    addresses  of the arrays of the trees; `starts` of the triangles in them
    found      (N,) receives triangles in the order of the tree
    places     (N, 2) receives s and r as `nearest_on_triangle` returns them
    """
    stack = np.empty(DEEPEST, np.int64)
    for i in range(len(points)):
        tree, x, y, z = trees[i], points[i, 0], points[i, 1], points[i, 2]
        start = starts[tree]
        _, at, s, r = nearest(doubles_at(addresses[tree]), start, x, y, z, np.inf, stack)
        found[i], places[i, 0], places[i, 1] = (at - start) // 9, s, r
