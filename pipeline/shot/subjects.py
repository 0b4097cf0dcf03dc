"""Subjects: solids by name, and mesh files. `copies` has several of one."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from fractions import Fraction
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Faces, Points
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.frames import FrameRange, FrameRate
from flowsculpt.pipeline.mesh import PolygonMesh, TriangleMesh, box, icosphere, rod, sheet, torus
from flowsculpt.pipeline.mesh.analytic_surfaces import (
    AnalyticSurface,
    BarLattice,
    BoxSurface,
    CapsuleSurface,
    CylinderSurface,
    SheetSurface,
    SolidSurface,
    SphereSurface,
    TorusSurface,
    lattice,
)
from flowsculpt.pipeline.mesh.control_net import Lattice
from flowsculpt.pipeline.mesh.mesh_formats import Paint, ScenePart
from flowsculpt.pipeline.mesh.read import ImportedSurface, ModelFile
from flowsculpt.pipeline.mesh.solids import one_sided_sheet, six_sided_box
from flowsculpt.render.base.input_files import joint_digest
from flowsculpt.render.base.serialise import NOT_PLAIN, OMIT_DEFAULT
from flowsculpt.render.scene.painted_faces import PaintedFaces

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
    def is_net(self) -> bool:
        """True for points that control a smooth surface, in a `lattice`.

        Other points are drawn as spheres; their radii (V,) are the attribute `radius` of their mesh.
        """
        return False

    @property
    def body(self) -> Subject:
        """The surface in or on which its points lie; itself where that is not known."""
        return self

    @property
    def files(self) -> tuple[tuple[Path, str], ...]:
        """The files that it is read from, and their SHA-256."""
        return ()

    @property
    def lattice(self) -> Lattice | None:
        """The layout of its vertices as the control points of a net; None for other subjects."""
        return None

    @property
    def notes(self) -> tuple[str, ...]:
        """Lines to tell the user about the file of the subject; none before this process has read it."""
        return ()

    def data(self) -> Any:
        """Return what decides the mesh at rest, as JSON-able data."""
        return as_data(self)

    def painted(self, rest: Points, faces: Faces) -> PaintedFaces | None:
        """Return what is painted on faces (F, 3) of rest positions (V, 3); None where nothing is."""
        return None

    @abstractmethod
    def build(self, max_edge_length: float | None = None) -> TriangleMesh:
        """Return the surface at rest.

        A solid is meshed for edges of at most max_edge_length, scene units; None is a coarse default. A model
        is as its file says: long edges are split on the first frame (P20, P25).
        """

    def polygons(self, max_edge_length: float | None = None) -> PolygonMesh:
        """Return the surface at rest as polygons of its own if it has any (P20), else as triangles."""
        return PolygonMesh.from_triangles(self.build(max_edge_length))


def as_data(value: Any) -> Any:
    """Return a value as JSON-able data, which keys are hashed from.

    Equal values give equal data on every machine. Dataclasses become dicts with their class under `is`,
    without fields that they compute from others (`init=False`), NOT_PLAIN fields, and OMIT_DEFAULT fields at
    their default; tuples become lists.

    Raises UsageError for a value without such a form, a Python function for one.
    """
    if value is None or isinstance(value, str | bool | int | float):
        return value
    if isinstance(value, np.integer | np.floating):
        return value.item()
    if isinstance(value, FrameRange | FrameRate | Fraction):
        return str(value)
    if isinstance(value, tuple | list):
        return [as_data(item) for item in value]
    if is_dataclass(value) and not isinstance(value, type):
        own = [f for f in fields(value) if f.init and f.metadata.get("plain", True)]
        named = [(f, getattr(value, f.name)) for f in own]
        kept = {f.name: as_data(v) for f, v in named if not f.metadata.get("omit_default") or v != f.default}
        return {"is": type(value).__name__, **kept}
    kind = "function" if callable(value) else type(value).__name__
    raise UsageError(f"a {kind} ({value!r}) cannot stand in a shot's data; use a flow of the catalogue")


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
    surface: Callable[..., SolidSurface]
    polygons: Callable[..., PolygonMesh] | None = None


def _icosphere(edge_length: float, radius: float) -> TriangleMesh:
    edges = math.ceil(radius * math.atan(2.0) / edge_length)  # along one edge of the icosahedron
    return icosphere(max(1, edges), radius)


def _rod(length: float, radius: float, caps: str) -> SolidSurface:
    return CapsuleSurface(length, radius) if caps == "round" else CylinderSurface(length, radius)


def _box(size: float | tuple[float, float, float]) -> SolidSurface:
    return BoxSurface(size if isinstance(size, tuple) else (size, size, size))


_SOLIDS: Mapping[str, SolidKind] = {
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
    """A solid, such as a box or a torus, and all of its measures by name, in the order of KINDS."""

    KINDS: ClassVar[Mapping[str, SolidKind]] = _SOLIDS
    """The solids that shots can name, by their names."""

    solid: str
    measures: tuple[tuple[str, Measure], ...]

    @classmethod
    def of(cls, solid: str, given: Mapping[str, Any]) -> Solid:
        """Return a solid from measures, e.g. `Solid.of("box", {"size": [2, 2, 1]})`; others take defaults."""
        return cls(solid, measures_of(Solid.KINDS[solid].measures, given))

    @property
    def project(self) -> SolidSurface:
        return Solid.KINDS[self.solid].surface(*(value for _, value in self.measures))

    def build(self, max_edge_length: float | None = None) -> TriangleMesh:
        values = [value for _, value in self.measures]
        largest = float(max(np.hstack([value for value in values if not isinstance(value, str)])))
        edge = _MESHED * max_edge_length if max_edge_length else _COARSEST * largest
        return Solid.KINDS[self.solid].make(max(edge, _FINEST * largest), *values)

    def painted(self, rest: Points, faces: Faces) -> PaintedFaces:
        return PaintedFaces(*self.project.texture(rest, faces), np.zeros(len(faces), np.int64))

    def polygons(self, max_edge_length: float | None = None) -> PolygonMesh:
        make = Solid.KINDS[self.solid].polygons
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


_TO_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Turns by −90° about x: z becomes y."""

_MOST_SIZES_AWAY = 1000.0
"""Distance from the origin over size: renderers hold coordinates to 1/16 million of that distance."""

_latest: dict[tuple[Any, ...], ImportedSurface] = {}
"""The surface that was read last: a run reads its model for the mesh, its polygons and its repairs."""


@dataclass(frozen=True)
class Model(Subject):
    """A mesh file, known by its contents: the same model elsewhere makes the same frames.

    It is repaired, turned, and then scaled about the origin or fitted, with the middle of its bounding box at
    the origin, where flows act. The stage is beneath its lowest point by itself.

    digest     SHA-256 of the file, and of the other layers of a USD stage
    scale      factor on all coordinates
    path       of the file
    files      digests of all files that it is read from, by path
    up         the axis of the file that points up: y or z
    rotate     angles about x, then y, then z, radians
    fit        its largest extent, scene units, in place of `scale`
    repair     True repairs what is not sound; False refuses it
    prim       path of the prim of a USD stage whose meshes are read; None for its default prim
    time_code  time of a USD stage; None for its first
    paint      True keeps the seams of its texture coordinates, vertex colours and materials, which looks show
    """

    digest: str
    scale: float = 1.0
    path: Path = field(default=Path(), metadata=NOT_PLAIN)
    files: tuple[tuple[Path, str], ...] = field(default=(), metadata=NOT_PLAIN, compare=False)
    up: str = field(default="y", metadata=OMIT_DEFAULT)
    rotate: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0), metadata=OMIT_DEFAULT)
    fit: float | None = field(default=None, metadata=OMIT_DEFAULT)
    repair: bool = field(default=True, metadata=OMIT_DEFAULT)
    prim: str | None = field(default=None, metadata=OMIT_DEFAULT)
    time_code: float | None = field(default=None, metadata=OMIT_DEFAULT)
    paint: bool = field(default=False, metadata=OMIT_DEFAULT)

    @classmethod
    def of_file(cls, path: Path, up: str | None = None, paint: bool = False, **placing: Any) -> Model:
        """Return the model in a file as it is now, up as its file says where `up` is None.

        placing  its other values by name. Raises what `ModelFile.files` raises.
        """
        model = ModelFile(path)
        files, painted = model.files(), tuple(model.paint_files().items()) if paint else ()
        digest = joint_digest(["seams 2", files.digest, *dict(painted).values()]) if paint else files.digest
        up = up or files.up or "y"
        return cls(digest, path=path, files=(*files.files, *painted), up=up, paint=paint, **placing)

    def build(self, max_edge_length: float | None = None) -> TriangleMesh:
        mesh = self.imported().mesh.triangulated()
        if self.paint:
            paint = _paint(self)
            posed = paint.placed(self._posed(paint.points))
            mesh = mesh.with_seams(posed.seams(mesh.vertices, mesh.halfedge_ends))
        return mesh.with_vertices(self._placed(mesh.vertices))

    def painted(self, rest: Points, faces: Faces) -> PaintedFaces | None:
        return _placed_paint(self).on_faces(rest, faces) if self.paint else None

    def polygons(self, max_edge_length: float | None = None) -> PolygonMesh:
        mesh = self.imported().mesh
        return mesh.with_vertices(self._placed(mesh.vertices))

    @property
    def notes(self) -> tuple[str, ...]:
        """Lines to tell the user: what was repaired, and what a model far from the origin loses."""
        known = _latest.get(self._read_from)
        if known is None:
            return ()
        return known.warnings + self._distance_notes(known)

    def _distance_notes(self, imported: ImportedSurface) -> tuple[str, ...]:
        distance, size = _distance_and_size(imported.mesh)
        steps = self.rounded_coordinates()
        if self.fit is not None or distance < _MOST_SIZES_AWAY * size:
            return tuple(steps)
        return (
            f"the model is {distance / size:.0f} times its size away from the origin, where flows act; its "
            "pictures, rendered in single precision, will show cracks. Write fit: 2, or centre the file.",
            *steps,
        )

    def rounded_coordinates(self) -> list[str]:
        """Return a line about a file whose 32-bit coordinates are too coarse where it lies, else none."""
        mesh = self.imported().mesh
        distance, size = _distance_and_size(mesh)
        single = mesh.vertices.astype(np.float32)
        if distance < _MOST_SIZES_AWAY * size or not np.array_equal(mesh.vertices, single):
            return []
        step = float(np.spacing(np.abs(single).max()))
        return [
            f"the model is {distance / size:.0f} times its size away from the origin, where the 32-bit "
            f"coordinates of its file are {step:.2g} apart, 1/{size / step:.0f} of its size: finer detail "
            "became steps. Export it nearer to the origin."
        ]

    def imported(self) -> ImportedSurface:
        """Return the surface as its file says. Raises MissingInputError or MeshError."""
        surface = _latest.get(self._read_from)
        if surface is None:
            surface = ModelFile(self.path, self.part).surface(self.repair)
            _latest.clear()
            _latest[self._read_from] = surface
        return surface

    @property
    def part(self) -> ScenePart | None:
        """The part of its scene that it is; None in formats whose parts have no names."""
        return ScenePart(self.prim, self.time_code) if ModelFile(self.path).names_parts else None

    @property
    def _read_from(self) -> tuple[Any, ...]:
        return self.path, self.digest, self.repair, self.prim, self.time_code

    def _posed(self, points: Points) -> Points:
        """Return where points (V, 3) of the file's surface are in the first frame, in its coordinates."""
        return points

    def _placed(self, points: Points, around: Points | None = None) -> Points:
        """Return points (V, 3) of the file where the shot has them. `fit` fits `around`, by default them."""
        points, fitted = self._turned(points), self._turned(points if around is None else around)
        if self.fit is None:
            return self.scale * points
        low, high = fitted.min(axis=0), fitted.max(axis=0)
        return (points - 0.5 * (low + high)) * (self.fit / float((high - low).max()))

    def _turned(self, points: Points) -> Points:
        if self.up == "z":
            points = points @ _TO_Y_UP.T
        return points @ self._rotation.T if any(self.rotate) else points

    @cached_property
    def _rotation(self) -> AnyArray:
        x, y, z = (np.array([[math.cos(a), -math.sin(a)], [math.sin(a), math.cos(a)]]) for a in self.rotate)
        about_x, about_y, about_z = np.eye(3), np.eye(3), np.eye(3)
        about_x[1:, 1:] = x
        about_y[np.ix_([2, 0], [2, 0])] = y
        about_z[:2, :2] = z
        matrix: AnyArray = about_z @ about_y @ about_x
        return np.where(np.abs(matrix) < 1e-15, 0.0, matrix)  # of right angles


@dataclass(frozen=True)
class PluginSurface(Model):
    """A surface that a plug-in makes; otherwise as a model that is read from a file.

    digest  SHA-256 of the plug-in's version, the settings, and the contents of the files that they name
    name    of its kind, such as `lettering.text`
    mesh    the surface, which is sound
    """

    name: str = ""
    mesh: TriangleMesh = field(default=TriangleMesh(np.empty((0, 3)), []), metadata=NOT_PLAIN, compare=False)

    def build(self, max_edge_length: float | None = None) -> TriangleMesh:
        """Return the surface, with long edges split where they are: its flat sides stay flat."""
        from flowsculpt.pipeline.resample import (  # compiled kernels, which take time to load
            Chord,
            Thresholds,
            resample,
        )

        mesh = self.mesh.with_vertices(self._placed(self.mesh.vertices))
        if max_edge_length is None:
            return mesh
        return resample(mesh, Thresholds(max_edge_length, 1e-3 * max_edge_length), Chord(), 0.0)[0]

    def imported(self) -> ImportedSurface:
        polygons = PolygonMesh.from_triangles(self.mesh)
        return ImportedSurface(polygons, (), "plug-in", len(self.mesh.vertices), len(self.mesh.faces))


@lru_cache(maxsize=4)
def _paint(model: Model) -> Paint:
    return ModelFile(model.path, model.part).paint()


@lru_cache(maxsize=4)
def _placed_paint(model: Model) -> Paint:
    """Return the paint of a model where the shot has it at rest."""
    paint = _paint(model)
    return paint.placed(model._placed(model._posed(paint.points), model.imported().mesh.vertices))


def _distance_and_size(mesh: PolygonMesh) -> tuple[float, float]:
    """Return the distance of a mesh's middle from the origin, and its largest extent."""
    low, high = mesh.bounds
    return float(np.linalg.norm(low + high)) / 2.0, float((high - low).max())
