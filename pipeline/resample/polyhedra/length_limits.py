"""The thresholds of one frame, for edges and faces by their vertices."""

from __future__ import annotations

import math

import numpy as np

from pipeline.arrays import Floats
from pipeline.mesh.polygon_mesh import PolygonMesh
from pipeline.resample.polyhedra.geometry import between
from pipeline.resample.polyhedra.polyhedron import Point
from pipeline.resample.thresholds import Thresholds


class LengthLimits:
    """Maximum and minimum length and hard angle at every vertex; the same everywhere if they are numbers.

    An edge has the geometric mean of the limits at its two ends, a face the smallest maximum of its corners.
    """

    def __init__(self, thresholds: Thresholds, mesh: PolygonMesh) -> None:
        """Raises UsageError where an active threshold gives impossible values."""
        self.max_vertices = thresholds.max_vertices
        self._same: float | None = None
        if thresholds.active:
            # functions take triangles, whose first vertices are those of the polygons
            fields = thresholds.fields(mesh.triangulated())[: len(mesh.vertices)]
            self._at: list[Point] = [(high, low, angle) for high, low, angle in fields.tolist()]
        else:
            numbers = thresholds.numbers
            self._same = math.cos(numbers[2])
            self._at = [numbers] * len(mesh.vertices)

    @property
    def table(self) -> Floats:
        """(V, 3): maximum and minimum length, scene units, and hard angle, radians, at every vertex."""
        return np.array(self._at)

    def max_edge_length(self, a: int, b: int) -> float:
        """Return the maximum length of the edge between two vertices."""
        return math.sqrt(self._at[a][0] * self._at[b][0])

    def min_edge_length(self, a: int, b: int) -> float:
        """Return the minimum length of the edge between two vertices."""
        return math.sqrt(self._at[a][1] * self._at[b][1])

    def hard_cosine(self, a: int, b: int) -> float:
        """Return the cosine of the hard angle at the edge between two vertices."""
        if self._same is not None:
            return self._same
        return math.cos(math.sqrt(self._at[a][2] * self._at[b][2]))

    def max_face_size(self, vertices: list[int]) -> float:
        """Return the longest side that the bounding box of a face may have."""
        return min(self._at[v][0] for v in vertices)

    def add(self, a: int, b: int, share: float) -> None:
        """Add the limits of the next vertex, interpolated between the ends of the edge that it splits."""
        self._at.append(between(self._at[a], self._at[b], share))

    def merge(self, a: int, b: int, share: float) -> None:
        """Set the limits of `a` to those at the place that it moves to."""
        self._at[a] = between(self._at[a], self._at[b], share)
