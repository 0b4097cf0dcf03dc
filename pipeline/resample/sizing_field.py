"""Sizing fields: edge length by distance to a camera, by curvature, or by a formula (P26, P35)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.arrays import AnyArray, Faces, Floats, Points, Vectors
from pipeline.errors import UsageError
from pipeline.formula import PLACE, TIME, Expression, time_values
from pipeline.mesh.meshes import TriangleMesh
from pipeline.mesh.normals import NORMAL, split_at_creases
from pipeline.resample.kernels.edge_scans import edge_curvature, limit_gradation

SHORT = 0.4
"""Share of the finest edge: shorter edges collapse (P12), and their curvature is noise."""

FORMULA_NAMES = (*PLACE, *TIME)
"""Names that a formula may use."""


@dataclass(frozen=True)
class DistanceToCamera:
    """Edges of constant size in the picture: their length grows with the distance from the camera.

    position          of the camera, scene units
    pixels            length of an edge across the line of sight, in the picture
    field_of_view     radians, horizontal
    width             of the picture, in pixels
    finest, coarsest  bounds, scene units

    At distance d the edge length is 2 d tan(field_of_view / 2) / width × pixels.
    """

    position: tuple[float, float, float]
    pixels: float
    finest: float
    coarsest: float
    field_of_view: float = math.radians(26)
    width: float = 1920.0

    def __post_init__(self) -> None:
        _require_order(self.finest, self.coarsest)
        if not 0 < self.field_of_view < math.pi:
            raise UsageError(f"field_of_view {self.field_of_view:g} must lie between 0 and pi radians")
        if not (self.pixels > 0 and self.width > 0):
            raise UsageError(f"{self.pixels:g} pixels of a width of {self.width:g}: both must be above 0")

    def __call__(self, mesh: TriangleMesh) -> Floats:
        """Return edge lengths (V,), scene units."""
        distance = np.linalg.norm(mesh.vertices - np.array(self.position), axis=1)
        pixel = 2.0 * math.tan(0.5 * self.field_of_view) / self.width
        return np.clip(self.pixels * pixel * distance, self.finest, self.coarsest)


@dataclass(frozen=True)
class Curvature:
    """Edges that leave the surface by no more than a tolerance (Herzen & Barr 1987).

    tolerance         the chord height, scene units: distance of an edge's middle from the surface
    finest, coarsest  bounds for the edges, scene units
    hard_angle        radians: an edge that turns by more is a crease, not curvature, unless exact normals
                      say otherwise; pi for surfaces without creases

    A chord of length h under an arc of curvature κ has the height κh²/8, so h = sqrt(8 tolerance / κ). κ is
    measured along edges, from the change of the normal between their ends: exact normals if the mesh has them
    (attribute `normal`), else means over the surrounding faces, separate for each side of a crease. At the
    rim of a thin sheet the normal turns within an edge as long as the sheet is thick: the rim is refined
    however thin it becomes, down to `finest`.
    """

    tolerance: float
    finest: float
    coarsest: float
    hard_angle: float = math.radians(40)

    def __post_init__(self) -> None:
        _require_order(self.finest, self.coarsest)
        if not (math.isfinite(self.tolerance) and self.tolerance > 0):
            raise UsageError(f"tolerance {self.tolerance:g} must be a positive length in scene units")
        if not 0 < self.hard_angle <= math.pi:
            raise UsageError(f"hard_angle {self.hard_angle:g} must lie between 0 and pi radians")

    def __call__(self, mesh: TriangleMesh) -> Floats:
        """Return edge lengths (V,), scene units."""
        bent = curvature(mesh, self.hard_angle, SHORT * self.finest)
        flat = 8.0 * self.tolerance / self.coarsest**2
        return np.maximum(np.sqrt(8.0 * self.tolerance / np.maximum(bent, flat)), self.finest)


@dataclass(frozen=True)
class ThresholdFormula:
    """A threshold as a formula over position and time: `0.02 + 0.01 * abs(y)`.

    text         see `pipeline.formula`; raises FormulaError for a wrong one
    unit         factor on its value: radians a degree, for angles written in degrees
    frame, time  the current frame and its time in seconds, if the formula uses them
    """

    text: str
    unit: float = 1.0
    frame: int | None = None
    time: float | None = None
    expression: Expression = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "expression", Expression(self.text, FORMULA_NAMES))

    def at(self, frame: int, time: float) -> ThresholdFormula:
        """Return the formula with its frame and time filled in; itself if it uses neither."""
        used = self.expression.uses
        seconds = float(time) if {"t", "time"} & used else None
        now = replace(self, frame=frame if "frame" in used else None, time=seconds)
        return self if now == self else now

    def __call__(self, mesh: TriangleMesh) -> Floats:
        """Return values (V,). Raises UsageError where a value is not finite, or the time is not known."""
        now = time_values(self.frame, self.time)
        missing = [name for name in now if name in self.expression.uses and now[name] is None]
        if missing:
            raise UsageError(f"formula {self.text!r} needs a {missing[0]}; ask for it `at` a frame first")
        known = {name: value for name, value in now.items() if value is not None}
        x, y, z = mesh.vertices.T
        return self.unit * self.expression(x=x, y=y, z=z, **known)


def curvature(mesh: TriangleMesh, hard_angle: float = math.radians(40), shortest: float = 0.0) -> Floats:
    """Return the largest curvature (V,) along the edges at every vertex, 1 / scene units; 0 where flat.

    For hard_angle and shortest see `Curvature` and `pipeline.resample.kernels.edge_scans.edge_curvature`.
    Raises MeshError where the mesh is not an oriented manifold.
    """
    points, faces, normals, source = _shaded(mesh, hard_angle)
    apart = np.empty(len(points))
    edge_curvature(points, faces, normals, max(shortest, np.finfo(np.float64).tiny), apart)
    if source is None:
        return apart
    joined = np.zeros(len(mesh.vertices))
    np.maximum.at(joined, source, apart)
    return joined


def graded(mesh: TriangleMesh, lengths: Floats, gradation: float) -> Floats:
    """Return lengths (V,), lowered until they differ along every edge by at most gradation × its length."""
    result = np.array(lengths)  # copies are writable, as compiled kernels declare their arguments
    limit_gradation(np.array(mesh.vertices), np.array(mesh.faces), gradation, result)
    return result


def _shaded(mesh: TriangleMesh, hard_angle: float) -> tuple[Points, Faces, Vectors, AnyArray | None]:
    """Return vertices, faces, unit normals and, if vertices are split at creases, their source vertices."""
    exact = mesh.attributes.get(NORMAL)
    known = None if exact is None else np.linalg.norm(exact, axis=1) > 0.5
    if exact is not None and known is not None and known.all():
        return np.array(mesh.vertices), np.array(mesh.faces), np.array(exact, np.float64), None
    points, normals, faces, source = split_at_creases(mesh, hard_angle)
    if exact is not None and known is not None:
        normals[known[source]] = exact[source[known[source]]]
    return points, faces, normals, source


def _require_order(finest: float, coarsest: float) -> None:
    if not (math.isfinite(coarsest) and 0 < finest <= coarsest):
        raise UsageError(
            f"finest {finest:g} and coarsest {coarsest:g} must be positive lengths in scene units, "
            "the first at most as long as the second"
        )
