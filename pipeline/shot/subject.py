"""Subjects and solids by name. `model_subject` has mesh files, `point_subjects` clouds and nets."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.errors import UsageError
from pipeline.mesh import (
    PolygonMesh,
    TriangleMesh,
    box,
    icosphere,
    rod,
    sheet,
    torus,
)
from pipeline.mesh.analytic_surfaces import (
    AnalyticSurface,
    BoxSurface,
    CapsuleSurface,
    CylinderSurface,
    SheetSurface,
    SphereSurface,
    TorusSurface,
)
from pipeline.mesh.bars import BarLattice, lattice
from pipeline.mesh.control_net import Lattice
from pipeline.mesh.solids import one_sided_sheet, six_sided_box

Measure = float | str | tuple[float, ...]


class Subject(ABC):
    """The mesh at rest that a flow deforms."""

    @property
    def project(self) -> AnalyticSurface | None:
        """The analytic surface of the mesh at rest, or None; it maps points to the nearest on it."""
        return None

    @property
    def is_surface(self) -> bool:
        """True if its mesh is visible and can be resampled; False for points that only move."""
        return True

    @property
    def lattice(self) -> Lattice | None:
        """The layout of its vertices as the control points of a net; None for other subjects."""
        return None

    @property
    def notes(self) -> tuple[str, ...]:
        """Lines to tell the user about the file of the subject; none before this process has read it."""
        return ()

    @abstractmethod
    def build(self, max_edge_length: float | None = None) -> TriangleMesh:
        """Return the surface at rest.

        A solid is meshed for edges of at most max_edge_length, scene units; None is a coarse default. A model
        is as its file says: long edges are split on the first frame (P20, P25).
        """

    def polygons(self, max_edge_length: float | None = None) -> PolygonMesh:
        """Return the surface at rest as polygons of its own if it has any (P20), else as triangles."""
        return PolygonMesh.from_triangles(self.build(max_edge_length))


@dataclass(frozen=True)
class SeveralSubjects(Subject):
    """Stands for the subjects of a shot that has several. Each has a shot of its own: `Shot.subjects`."""

    names: tuple[str, ...]

    def build(self, max_edge_length: float | None = None) -> TriangleMesh:
        """Raise UsageError: what needs one surface does not take several."""
        raise UsageError(
            f"the shot has several subjects ({', '.join(self.names)}), and this is for one. Name it, as in "
            f"--subject {self.names[0]}, where the command takes that, or make a shot of that subject"
        )


@dataclass(frozen=True)
class SolidKind:
    """A solid that shots can name.

    measures  names and defaults of its measures, scene units
    make      `make(edge_length, *measures)`: its mesh
    surface   `surface(*measures)`: the analytic surface that the mesh approximates
    polygons  `polygons(*measures)`: the solid as a few polygons, if all its sides are flat
    """

    measures: Mapping[str, Measure]
    make: Callable[..., TriangleMesh]
    surface: Callable[..., AnalyticSurface]
    polygons: Callable[..., PolygonMesh] | None = None


def _icosphere(edge_length: float, radius: float) -> TriangleMesh:
    edges = math.ceil(radius * math.atan(2.0) / edge_length)  # along one edge of the icosahedron
    return icosphere(max(1, edges), radius)


def _rod(length: float, radius: float, caps: str) -> AnalyticSurface:
    return CapsuleSurface(length, radius) if caps == "round" else CylinderSurface(length, radius)


def _box(size: float | tuple[float, float, float]) -> AnalyticSurface:
    return BoxSurface(size if isinstance(size, tuple) else (size, size, size))


SOLIDS: Mapping[str, SolidKind] = {
    "box": SolidKind({"size": (2.0, 2.0, 2.0)}, lambda edge, size: box(size, edge), _box, six_sided_box),
    "icosphere": SolidKind({"radius": 1.0}, _icosphere, SphereSurface),
    "lattice": SolidKind(
        {"size": (2.0, 2.0, 2.0), "spacing": 0.6, "thickness": 0.15},
        lambda edge, size, spacing, thickness: lattice(size, spacing, thickness, edge),
        BarLattice,
    ),
    "rod": SolidKind(
        {"length": 3.0, "radius": 0.5, "caps": "round"},
        lambda edge, length, radius, caps: rod(length, radius, edge, caps),
        _rod,
    ),
    "sheet": SolidKind(
        {"size": (2.0, 2.0)}, lambda edge, size: sheet(size, edge), SheetSurface, one_sided_sheet
    ),
    "torus": SolidKind(
        {"radius": 1.0, "tube_radius": 0.4},
        lambda edge, radius, tube_radius: torus(radius, tube_radius, edge),
        TorusSurface,
    ),
}

_MESHED = 0.62
"""Edge length of meshed solids over the maximum: the geometric mean of the limits, 40% and 100%."""

_COARSEST = 1 / 16
"""Edge length over size without a maximum edge length."""

_FINEST = 1 / 500
"""Finest edge length over size: splits refine further, up to the budget of vertices."""


@dataclass(frozen=True)
class Solid(Subject):
    """A solid of SOLIDS. `measures` holds all of its measures by name, in the order of the registry."""

    solid: str
    measures: tuple[tuple[str, Measure], ...]

    @classmethod
    def of(cls, solid: str, given: Mapping[str, Any]) -> Solid:
        """Return a solid from measures, e.g. `Solid.of("box", {"size": [2, 2, 1]})`; others take defaults."""
        return cls(solid, measures_of(SOLIDS[solid].measures, given))

    @property
    def project(self) -> AnalyticSurface:
        return SOLIDS[self.solid].surface(*(value for _, value in self.measures))

    def build(self, max_edge_length: float | None = None) -> TriangleMesh:
        values = [value for _, value in self.measures]
        largest = float(max(np.hstack([value for value in values if not isinstance(value, str)])))
        edge = _MESHED * max_edge_length if max_edge_length else _COARSEST * largest
        return SOLIDS[self.solid].make(max(edge, _FINEST * largest), *values)

    def polygons(self, max_edge_length: float | None = None) -> PolygonMesh:
        make = SOLIDS[self.solid].polygons
        if make is None:
            return super().polygons(max_edge_length)
        return make(*(value for _, value in self.measures))


def measures_of(defaults: Mapping[str, Measure], given: Mapping[str, Any]) -> tuple[tuple[str, Measure], ...]:
    """Return all measures by name: those of a shot file, and the defaults of others."""

    def converted(value: Any) -> Measure:
        if isinstance(value, list | tuple):
            return tuple(float(x) for x in value)
        return value if isinstance(value, str) else float(value)

    return tuple((name, converted(given.get(name, default))) for name, default in defaults.items())
