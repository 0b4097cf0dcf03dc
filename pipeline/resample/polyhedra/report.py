"""What one resampling of a polyhedron did and what it left."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.resample.report import Report


@dataclass(frozen=True)
class PolyhedralReport(Report):
    """The counts that triangles have, and those of faces with any number of sides.

    splits           vertices put on edges
    cuts             faces cut in two
    average_sides    sides a face, on average: the drift toward triangles (P21)
    widest           the longest side of the box of any face along the axes, scene units
    refused          besides the reasons of triangles, `area`: where faces collapse and not edges, an edge
                     whose faces are large enough
    """

    cuts: int = 0
    average_sides: float = 3.0
    widest: float = 0.0
