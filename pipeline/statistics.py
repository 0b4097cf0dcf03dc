"""Statistics of a mesh (P7)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flowsculpt.pipeline.mesh import TriangleMesh
from flowsculpt.pipeline.mesh.kernels.face_measures import (
    cosines_at_edges,
    count_ascending,
    lengths_and_areas,
)
from flowsculpt.pipeline.mesh.kernels.intersections import bounding_boxes, count_crossings, fill_grid

COUNTED_FRAMES = 8
"""Crossings are counted in the first frame of a shot and in every such frame after it."""


@dataclass(frozen=True)
class MeshStatistics:
    """Measures of a surface: mesh-like if `mean_edge / diameter` is small and `median_dihedral` near π.

    mean_edge        mean edge length, scene units; every edge counts once for each of its faces
    diameter         diagonal of the bounding box, scene units
    median_dihedral  median inner angle between neighbouring faces, radians: π is flat
    area             scene units squared
    crossings        pairs of faces that intersect, which no continuous flow makes; None: not counted
    """

    mean_edge: float
    diameter: float
    median_dihedral: float
    area: float
    crossings: int | None


_EDGE_PARTS, _BUCKET_PARTS = 2, 4
"""Parts in which a large mesh is looked through: more take less memory, and more passes over its faces."""

_MATCHED_TOGETHER = 1 << 18
"""A mesh of at least so many vertices is large: the edges of smaller ones find both their faces together."""


def mesh_statistics(mesh: TriangleMesh, count_crossings: bool = True) -> MeshStatistics:
    """Return the statistics of a sound mesh.

    count_crossings  False leaves out the pairs of faces that intersect, which take longer than all others
    """
    lengths, area = lengths_and_areas(mesh.vertices, mesh.faces)
    low, high = mesh.bounds
    return MeshStatistics(
        mean_edge=lengths / (3 * len(mesh.faces)),
        diameter=float(np.linalg.norm(high - low)),
        median_dihedral=_median_dihedral(mesh),
        area=area,
        crossings=self_intersections(mesh) if count_crossings else None,
    )


def _median_dihedral(mesh: TriangleMesh) -> float:
    """Return the median inner angle, by the median cosine; π where no faces meet."""
    cosines, edges = np.empty(3 * len(mesh.faces) // 2), 0
    together = max(_MATCHED_TOGETHER, -(-len(mesh.vertices) // _EDGE_PARTS))
    for first in range(0, len(mesh.vertices), together):
        begins = np.empty(min(together, len(mesh.vertices) - first) + 1, np.int32)
        ascending = np.empty(2 * count_ascending(mesh.faces, first, begins), np.int32)
        edges = cosines_at_edges(mesh.vertices, mesh.faces, first, begins, ascending, edges, cosines)
    if not edges:
        return math.pi
    cosine = float(np.median(cosines[:edges], overwrite_input=True))
    return math.pi - math.acos(min(max(cosine, -1.0), 1.0))


_CELL = 1.5
"""The size of a cell of the grid, in faces of median size."""

_SAMPLED = 1 << 16
"""Faces, about, whose median size stands for that of all."""

_BUCKETS = 1 << 20
"""A mesh with at least so many buckets of cells is large: fewer are filled together."""


def self_intersections(mesh: TriangleMesh) -> int:
    """Return the number of pairs of faces that cross each other; 0 for an embedded surface.

    Two faces cross where an edge of one passes through the inside of the other. Faces that share an edge are
    not compared, those that share a corner are; mere contact does not count.
    """
    if not len(mesh.faces):
        return 0
    points, faces, boxes = mesh.vertices, mesh.faces, np.empty((len(mesh.faces), 6), np.float32)
    bounding_boxes(points, faces, points.min(axis=0), boxes)
    some = boxes[:: 1 + len(faces) // _SAMPLED]  # the size of cells decides the time alone
    largest = max(float((boxes[:, 3 + axis] - boxes[:, axis]).max()) for axis in range(3))
    cell = max(_CELL * float(np.median((some[:, 3:] - some[:, :3]).max(axis=1))), largest / 32, 1e-300)
    buckets = 1 << int(2 * len(faces) - 1).bit_length()
    filled, crossings = min(buckets, max(_BUCKETS, buckets // _BUCKET_PARTS)), 0
    for first in range(0, buckets, filled):
        ends = np.zeros(filled + 2, np.int32)
        fill_grid(boxes, cell, buckets, first, ends, np.empty(0, np.int32))
        np.cumsum(ends, out=ends)
        listed = np.empty(ends[-1], np.int32)
        fill_grid(boxes, cell, buckets, first, ends, listed)
        crossings += count_crossings(points, faces, boxes, cell, buckets, first, ends, listed)
    return int(crossings)
