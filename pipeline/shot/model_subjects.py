"""Subjects that are mesh files, repaired, turned upright and scaled."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.arrays import AnyArray, Points
from pipeline.mesh import PolygonMesh, TriangleMesh
from pipeline.mesh.mesh_formats import ScenePart
from pipeline.mesh.read import ImportedSurface, names_parts, read_surface
from pipeline.shot.subjects import Subject
from render.base.serialise import NOT_PLAIN, OMIT_DEFAULT

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

    def build(self, max_edge_length: float | None = None) -> TriangleMesh:
        mesh = self.imported().mesh.triangulated()
        return mesh.with_vertices(self._placed(mesh.vertices))

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
        if self._read_from not in _latest:
            part = ScenePart(self.prim, self.time_code) if names_parts(self.path) else None
            surface = read_surface(self.path, self.repair, part)
            _latest.clear()
            _latest[self._read_from] = surface
        return _latest[self._read_from]

    @property
    def _read_from(self) -> tuple[Any, ...]:
        return self.path, self.digest, self.repair, self.prim, self.time_code

    def _placed(self, points: Points) -> Points:
        """Return points (V, 3) of the file where the shot has them."""
        if self.up == "z":
            points = points @ _TO_Y_UP.T
        if any(self.rotate):
            points = points @ self._rotation.T
        if self.fit is None:
            return self.scale * points
        low, high = points.min(axis=0), points.max(axis=0)
        return (points - 0.5 * (low + high)) * (self.fit / float((high - low).max()))

    @cached_property
    def _rotation(self) -> AnyArray:
        x, y, z = (np.array([[math.cos(a), -math.sin(a)], [math.sin(a), math.cos(a)]]) for a in self.rotate)
        about_x, about_y, about_z = np.eye(3), np.eye(3), np.eye(3)
        about_x[1:, 1:] = x
        about_y[np.ix_([2, 0], [2, 0])] = y
        about_z[:2, :2] = z
        matrix: AnyArray = about_z @ about_y @ about_x
        return np.where(np.abs(matrix) < 1e-15, 0.0, matrix)  # of right angles


def _distance_and_size(mesh: PolygonMesh) -> tuple[float, float]:
    """Return the distance of a mesh's middle from the origin, and its largest extent."""
    low, high = mesh.bounds
    return float(np.linalg.norm(low + high)) / 2.0, float((high - low).max())
