"""Counting where a surface passes through itself, which a continuous flow never makes it do."""

from __future__ import annotations

import numpy as np

from pipeline.mesh._kernels_intersect import count_crossings, fill_grid
from pipeline.mesh.triangles import TriangleMesh

_CELL = 1.5  # size of a cell of the grid, in faces of median size


def self_intersections(mesh: TriangleMesh) -> int:
    """How many pairs of faces cross each other; 0 for an embedded surface.

    Two faces cross where an edge of one passes through the inside of the other. Faces that share an edge
    are not compared, those that share a corner are; mere contact does not count.
    """
    if not len(mesh.faces):
        return 0
    points, faces = np.array(mesh.vertices), np.array(mesh.faces)
    extents = np.ptp(points[faces], axis=1).max(axis=1)
    cell = max(_CELL * float(np.median(extents)), float(extents.max()) / 32, 1e-300)
    start = np.zeros((1 << int(2 * len(faces) - 1).bit_length()) + 1, np.int64)
    fill_grid(points, faces, cell, start, np.empty(0, np.int32))
    start = np.cumsum(start)
    listed, begins = np.empty(start[-1], np.int32), start.copy()
    fill_grid(points, faces, cell, begins, listed)
    crossings = np.empty(len(faces), np.int32)
    count_crossings(points, faces, cell, start, listed, crossings)
    return int(crossings.sum())
