"""Models whose surface at every time is given: by the files of another program, which a plug-in reads.

A frame of such a model does not follow from the frame before. Where all times have the same faces, the paths
of the file's vertices carry the surface: a point of it stays at its place on its face. Such a surface may be
resampled, new vertices get their places exactly, and flows act on it as it is at each frame, for the time
since the first one. Where faces change, each frame shows a surface of its own, and nothing else acts on it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Faces, Floats, Points, Vectors
from flowsculpt.pipeline.flow import Flow
from flowsculpt.pipeline.flow.regions import TriangleTree
from flowsculpt.pipeline.mesh import PolygonMesh, TriangleMesh
from flowsculpt.pipeline.mesh.normals import NORMAL, unit
from flowsculpt.pipeline.mesh.read import ImportedSurface, ModelFile
from flowsculpt.pipeline.shot.subjects import Model, as_data
from flowsculpt.render.base.input_files import joint_digest
from flowsculpt.render.base.serialise import NOT_PLAIN

VELOCITY = "velocity"
"""Vertex attribute (V, 3) of given surfaces: units per second of the flow, along which a frame is moved."""


class SurfaceSequence(ABC):
    """The contract of plug-ins that read surfaces over time.

    Times are seconds of the flow since the first frame of the shot; coordinates are those of the files. Each
    method that reads raises MeshError or MissingInputError, with the file, where it cannot.
    """

    @property
    @abstractmethod
    def path(self) -> Path:
        """The file with the surface of the first frame."""

    @property
    @abstractmethod
    def digest(self) -> str:
        """SHA-256 of the files of that surface."""

    @property
    @abstractmethod
    def files(self) -> tuple[tuple[Path, str], ...]:
        """All files that frames are read from, and their SHA-256."""

    @property
    def up(self) -> str | None:
        """The axis of the files that points up; None where they do not say it."""
        return None

    @property
    def notes(self) -> tuple[str, ...]:
        """Lines to tell the user, such as where velocities come from."""
        return ()

    @property
    def absent(self) -> tuple[str, str] | None:
        """The range of the first frames, which have surfaces, and what others lack; None if all have one."""
        return None

    @property
    @abstractmethod
    def keeps_faces(self) -> bool:
        """True if all times have the faces of `start`, so that its vertices have paths."""

    def start(self) -> ImportedSurface:
        """Return the surface of the first frame; by default what `surface` returns, from no file."""
        mesh, _ = self.surface(0.0)
        return ImportedSurface(mesh, (), "", len(mesh.vertices), len(mesh))

    def posed(self, points: Points) -> Points:
        """Return where points (V, 3) of the model at `path`, as a still one, are in the first frame."""
        return points

    @abstractmethod
    def points(self, seconds: float) -> Points:
        """Return where the vertices (V, 3) of `start` are at a time, if faces are kept.

        Times a little before the first or after the last continue in a straight line.
        """

    def normals(self, seconds: float) -> Vectors | None:
        """Return the normals (V, 3) at `points`, 0 where unknown; None where the files have none."""
        return None

    @abstractmethod
    def surface(self, seconds: float) -> tuple[PolygonMesh, Vectors | None]:
        """Return the surface at a time, and the velocities (V, 3) of its vertices per second, where known.

        The surface has the attribute `normal` (V, 3), where the files have normals; 0 where they are unknown.
        It may have the attribute `material` (V, 3), which patterns go by in place of positions, and the
        attribute `values` (V, 2), what it measures: see `Surface.VALUES`.
        """

    @abstractmethod
    def data(self, seconds: float) -> Any:
        """Return what decides the surface at a time and its velocities, JSON-able."""

    def quantiles(self, shares: Sequence[float]) -> Sequence[float]:
        """Return the numbers below which these fractions lie of the values of all frames of the shot."""
        raise NotImplementedError("surfaces with values have them")

    def facts(self, seconds: float) -> Mapping[str, Any]:
        """Return what is known at a time: `values` and `unit`, what is measured, where it measures; `date`,
        that of its data; `metres`, the length of a unit."""
        return {}


@dataclass(frozen=True)
class AnimatedModel(Model):
    """A model that its files move.

    digest    SHA-256 of the files of the first frame
    sequence  reads the surface of every time
    """

    sequence: SurfaceSequence = field(kw_only=True, metadata=NOT_PLAIN)

    @classmethod
    def of(cls, sequence: SurfaceSequence, up: str | None, paint: bool, **placing: Any) -> AnimatedModel:
        """Return the model of a sequence; arguments are those of `Model.of_file`."""
        painted = tuple(ModelFile(sequence.path).paint_files().items()) if paint else ()
        digests = ["seams 3", sequence.digest, *dict(painted).values()]
        return cls(
            joint_digest(digests) if paint else sequence.digest,
            path=sequence.path,
            files=(*sequence.files, *painted),
            up=up or sequence.up or "y",
            paint=paint,
            sequence=sequence,
            **placing,
        )

    def data(self) -> Any:
        """Return what decides all frames; where the first surface decides none of the others, not that."""
        data = as_data(self)
        return data if self.keeps_faces or self.fit is not None else {**data, "digest": ""}

    @property
    def keeps_faces(self) -> bool:
        """True if all times have the same faces."""
        return self.sequence.keeps_faces

    @property
    def notes(self) -> tuple[str, ...]:
        return (*self.imported().warnings, *self.sequence.notes)

    def imported(self) -> ImportedSurface:
        return self.sequence.start()

    def _posed(self, points: Points) -> Points:
        return self.sequence.posed(points)

    def vertices(self, seconds: float) -> Points:
        """Return where the vertices (V, 3) of `build` are at a time of the flow, where faces are kept."""
        points, (polygons, extra) = self.sequence.points(seconds), self._middles
        if extra:
            points = np.concatenate([points, [points[ring].mean(axis=0) for ring in extra]])
        return self._placed(points, polygons.vertices)

    def normals(self, seconds: float) -> Vectors | None:
        """Return unit normals (V, 3) at `vertices`, 0 where unknown; None where the files have none."""
        normals, more = self.sequence.normals(seconds), np.zeros((len(self._middles[1]), 3))
        return None if normals is None else unit(self._turned(np.concatenate([normals, more])))

    def carried(self, rest: Points, faces: AnyArray, seconds: float) -> Points:
        """Return where points (N, 3) on faces (N,) of the first frame are at a time."""
        return self.faces.on(faces, rest, self.vertices(seconds))

    def surface(self, seconds: float) -> TriangleMesh:
        """Return the surface at a time, with the attribute VELOCITY if it is known."""
        polygons, velocities = self.sequence.surface(seconds)
        around = None if self.fit is None else self.imported().mesh.vertices
        points = self._placed(polygons.vertices, around)
        if velocities is not None:
            moved = self._placed(polygons.vertices + velocities, around)
            polygons = polygons.with_attributes(**{VELOCITY: moved - points})
        if NORMAL in polygons.attributes:
            polygons = polygons.with_attributes(**{NORMAL: unit(self._turned(polygons.attributes[NORMAL]))})
        return polygons.with_vertices(points).triangulated()

    @cached_property
    def faces(self) -> FaceSurface:
        """The faces of the first frame, on which vertices keep their places where faces are kept."""
        return FaceSurface.of(self.build())

    @cached_property
    def _middles(self) -> tuple[PolygonMesh, list[AnyArray]]:
        """The polygons of the first frame, and the rings of those that take a vertex in their middle."""
        polygons, mesh = self.imported().mesh, self.build()
        extra = []
        for vertex in range(len(polygons.vertices), len(mesh.vertices)):
            around = np.unique(mesh.faces[(mesh.faces == vertex).any(axis=1)])
            extra.append(around[around != vertex])
        return polygons, extra


@dataclass(frozen=True, eq=False)
class FaceSurface:
    """The triangles (F, 3) of a surface with vertices (V, 3), which points lie on."""

    vertices: Points
    faces: Faces
    tree: TriangleTree

    @classmethod
    def of(cls, mesh: TriangleMesh) -> FaceSurface:
        return cls(mesh.vertices, mesh.faces, TriangleTree.of(mesh.vertices[mesh.faces]))

    def walked_to(self, points: Points, ends: Points, starts: AnyArray) -> AnyArray:
        """Return the face (N,) of each point that is reached from those of its ends on, over edges.

        ends    (N, 2, 3) points on the surface, twice the same for one end
        starts  (N, 2) the faces that these are on
        """
        return self.tree.walked_to(points, ends, starts, self._neighbours)

    def on(self, faces: AnyArray, points: Points, vertices: Points) -> Points:
        """Return the places on faces (N,) nearest to points (N, 3), with the vertices moved to (V, 3)."""
        return self.blended(vertices, faces, self.tree.shares_on(faces, points))

    @property
    def of_vertices(self) -> AnyArray:
        """A face (V,) at each vertex."""
        faces = np.zeros(len(self.vertices), np.int64)
        faces[self.faces] = np.arange(len(self.faces))[:, None]
        return faces

    @cached_property
    def _neighbours(self) -> AnyArray:
        """The faces (F, 3) across the edges of each, -1 at a boundary."""
        twins = PolygonMesh.from_triangles(TriangleMesh(self.vertices, self.faces)).twins
        return np.where(twins < 0, -1, twins // 3).reshape(-1, 3)

    def blended(self, values: Floats, face: AnyArray, shares: Floats) -> Floats:
        """Return values of the vertices (V, 3) at places of `tree`: faces (N,) and shares (N, 2)."""
        weights = np.column_stack([1.0 - shares.sum(axis=1), shares])
        return np.asarray(np.einsum("nk,nkj->nj", weights, values[self.faces[face]]))


@dataclass(frozen=True, eq=False)
class AnimatedFlow(Flow):
    """Moves points as the nearest points of an animated model move, which keeps its faces.

    For what asks only where points go, such as forecasts and sketches. Frames are made by `AnimatedModel`
    itself, so that flows after this one may take the surface anywhere.
    """

    model: AnimatedModel

    def displace(self, points: Points, time: float, dt: float) -> Points:
        known = self._arrived.get("last")
        if known is not None and np.array_equal(known[0], points):
            located = known[1]
        else:
            located = self._faces_at(time).tree.nearest(np.ascontiguousarray(points))
        before, after = (
            self._faces_at(0.0).blended(self.model.vertices(t), *located) for t in (time, time + dt)
        )
        moved = points + (after - before)
        self._arrived["last"] = moved.copy(), located
        return moved

    @cached_property
    def _arrived(self) -> dict[str, tuple[Points, tuple[AnyArray, Floats]]]:
        """The points that were moved last, and their places: mostly they are moved on, on their face."""
        return {}

    def _faces_at(self, time: float) -> FaceSurface:
        model = self.model
        return (
            model.faces if time == 0.0 else FaceSurface.of(model.build().with_vertices(model.vertices(time)))
        )

    def cache_data(self, time: float, dt: float) -> Any:
        sequence = self.model.sequence
        return {"animated": [self.model.data(), sequence.data(time), sequence.data(time + dt)]}

    @property
    def name(self) -> str:
        return f"motion of {self.model.path.name}"
