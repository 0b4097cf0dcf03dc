"""Subjects as Reynolds began with them: few large polygons, which the first frame slices (P20)."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from pipeline.mesh.polygons import PolygonMesh

_SIDES = [(4, 6, 7, 5), (0, 1, 3, 2), (2, 3, 7, 6), (0, 4, 5, 1), (1, 5, 7, 3), (0, 2, 6, 4)]


def six_sided_box(size: ArrayLike) -> PolygonMesh:
    """A box of six quadrilaterals around the origin; `size` holds its full extents in x, y and z."""
    corners = np.array(list(product((-0.5, 0.5), repeat=3)))
    return PolygonMesh(corners * np.asarray(size, np.float64), _SIDES)


def one_sided_sheet(size: ArrayLike) -> PolygonMesh:
    """One quadrilateral in the plane y = 0 that faces upwards; `size` is along x and z."""
    half = 0.5 * np.asarray(size, np.float64)
    corners = np.zeros((4, 3))
    corners[:, (0, 2)] = half * [(-1, -1), (-1, 1), (1, 1), (1, -1)]
    return PolygonMesh(corners, [range(4)])
