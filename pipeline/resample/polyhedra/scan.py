"""Passes over a whole surface: which elements may be out of the bracket.

They answer a few too many rather than one too few: whoever works on an element compares it exactly.
"""

from __future__ import annotations

import numpy as np

from pipeline.arrays import AnyArray, Floats
from pipeline.mesh.polygons import PolygonMesh
from pipeline.resample.polyhedra.bracket import Bracket
from pipeline.resample.polyhedra.structure import OUTSIDE, Polyhedron

_SLACK = 1e-9


def long_edges(surface: Polyhedron, bracket: Bracket) -> list[int]:
    """The first half-edges of the edges over the maximum."""
    edges, lengths, limits = _measured(surface, bracket.table[:, 0])
    return _listed(edges[lengths > (1 - _SLACK) * limits])


def short_edges(surface: Polyhedron, bracket: Bracket) -> list[int]:
    """The first half-edges of the edges under the minimum."""
    edges, lengths, limits = _measured(surface, bracket.table[:, 1])
    return _listed(edges[lengths < (1 + _SLACK) * limits])


def wide_faces(mesh: PolygonMesh, bracket: Bracket) -> list[int]:
    """The faces whose box is longer than the maximum."""
    limits = np.minimum.reduceat(bracket.table[mesh.corners, 0], mesh.offsets[:-1])
    return _listed(np.flatnonzero(mesh.extents > (1 - _SLACK) * limits))


def edge_lengths(surface: Polyhedron) -> Floats:
    """(E,) of every edge, scene units."""
    return _measured(surface, np.zeros(len(surface.points)))[1]


def _measured(surface: Polyhedron, limit: Floats) -> tuple[AnyArray, Floats, Floats]:
    """First half-edges, lengths, and the limits that those of their two ends make together."""
    ends = np.array(surface.origin).reshape(-1, 2)
    edges = np.flatnonzero(ends[:, 0] != OUTSIDE)
    points = np.array(surface.points)
    a, b = ends[edges].T
    return 2 * edges, np.linalg.norm(points[a] - points[b], axis=1), np.sqrt(limit[a] * limit[b])


def _listed(numbers: AnyArray) -> list[int]:
    found: list[int] = numbers.tolist()
    return found
