"""Models to be printed: a closed surface as STL at a size in millimetres, and a report of it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pipeline.arrays import Points
from pipeline.errors import MeshError
from pipeline.mesh import TriangleMesh
from pipeline.mesh.validation import validate
from pipeline.plugins.interchange.exported_frame import ExportedFrame
from pipeline.plugins.interchange.wall_thickness import wall_thickness
from pipeline.statistics import self_intersections

LONGEST_SIDE = 100.0
"""Millimetres of the longest side of a printed model."""


@dataclass(frozen=True)
class PrintReport:
    """Measures of a model as it is printed.

    size       width, depth and height, millimetres
    volume     cubic millimetres
    thinnest   the thinnest wall, millimetres, estimated by rays; None where none met the surface again
    thin       the wall that a hundredth of the faces are thinner than, as `thinnest`
    crossings  pairs of faces that pass through each other
    """

    size: tuple[float, float, float]
    volume: float
    triangles: int
    thinnest: float | None
    thin: float | None
    crossings: int

    @classmethod
    def of(cls, model: TriangleMesh) -> PrintReport:
        """Measure a model in millimetres, with z up."""
        low, high = model.bounds
        width, depth, height = (high - low).tolist()
        walls = wall_thickness(model)
        known = walls[np.isfinite(walls)]
        return cls(
            size=(width, depth, height),
            volume=volume_of(model.vertices, model),
            triangles=len(model.faces),
            thinnest=float(known.min()) if len(known) else None,
            thin=float(np.quantile(known, 0.01)) if len(known) else None,
            crossings=self_intersections(model),
        )

    def in_words(self) -> str:
        """Return the report in a few sentences."""
        size = " × ".join(f"{side:.1f}" for side in self.size)
        words = f"{size} mm, {self.volume / 1000.0:.4g} cm³, {self.triangles} triangles, closed."
        if self.thinnest is not None:
            words += f" Its thinnest wall is about {self.thinnest:.2g} mm, and 1% of its faces"
            words += f" have less than {self.thin:.2g} mm below them."
        if self.crossings:
            words += f" {self.crossings} pairs of faces pass through each other; let the slicer merge them."
        return words

    def as_data(self) -> dict[str, Any]:
        """Return the report as JSON data, with its unit."""
        return {"unit": "mm", **asdict(self)}


def print_model(frame: ExportedFrame, longest: float, name: str) -> TriangleMesh:
    """Return a frame in millimetres, standing on z = 0 with z up, as printers have it.

    longest  millimetres of its longest side
    name     of the frame, for messages

    Raises MeshError for a point cloud, and for a surface that is not closed.
    """
    if not len(frame.faces):
        raise MeshError(f"{name}: a point cloud has no surface to print; export it as ply or usd")
    mesh = TriangleMesh(frame.points, frame.faces)
    found = validate(mesh)
    if found.problem is not None:
        raise MeshError(f"{name}: {found.problem}, so it cannot be printed; export it as ply and repair it")
    if not found.closed:
        raise MeshError(
            f"{name}: {found.boundary_edges} edges have a face on one side only; a printer needs a closed "
            "surface. Export it as ply and give it a thickness, or choose a closed subject"
        )
    x, y, z = frame.points.T
    stood = np.stack([x, -z, y], axis=1)
    low, high = stood.min(axis=0), stood.max(axis=0)
    middle = np.array([*(0.5 * (low + high))[:2], low[2]])
    points = (stood - middle) * (longest / float((high - low).max()))
    faces = mesh.faces if volume_of(points, mesh) > 0.0 else mesh.faces[:, ::-1]
    return TriangleMesh(points, faces)


def volume_of(points: Points, mesh: TriangleMesh) -> float:
    """Return the volume that a closed mesh encloses with vertices at points (V, 3); below 0 if inside out."""
    a, b, c = points[mesh.faces].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0
