"""Formats of model files: what reads their surfaces, how these move, and the paint that lies on the faces.

A format is a `SurfaceReader` and, where its files hold more than a surface, a `PaintReader`, and a function
that opens a `MovingSurface`. A plug-in names them in a `FileFormat`, by suffix. Surfaces are as files have
them: polygons that are not merged or checked.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeVar

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Faces, Floats, Indices, Points
from flowsculpt.render.base.input_files import InputFile, joint_digest
from flowsculpt.render.scene.painted_faces import PaintedFaces

if TYPE_CHECKING:
    from flowsculpt.render.scene.materials import PatternedMaterial

T = TypeVar("T")

LARGEST_COORDINATE = 1e12
"""The limit of any number in a shot file: squares and products of such coordinates stay finite."""


class FileSurface(NamedTuple):
    """Polygons as a file has them, not yet merged or checked.

    points      float64 (V, 3)
    offsets     int64 (F + 1,): face f has the corners ``corners[offsets[f]:offsets[f + 1]]``
    corners     int64 (C,), from 0
    groups      int64 (F,): edges between faces with different numbers are creases
    tagged      int64 (K, 2): edges that the file itself marks as creases
    base        number of the first vertex and the first face in the file; None in formats without numbers,
                whose faces share no vertices
    notes       lines to tell the user about what else the file holds
    unit        length of a unit of its coordinates, metres; None in formats that do not say it
    velocities  of the points, float64 (V, 3), units per second; None where the file has none
    normals     of the points, float64 (V, 3), of any length; None where the file has none
    numbers     returns an array of numbers (V,) by its name; raises MeshError where there is none
    """

    points: Points
    offsets: AnyArray
    corners: AnyArray
    groups: AnyArray
    tagged: AnyArray
    base: int | None = 0
    notes: tuple[str, ...] = ()
    unit: float | None = None
    velocities: Points | None = None
    normals: Points | None = None
    numbers: Callable[[str], Floats] | None = None

    @classmethod
    def of(
        cls,
        points: Points,
        faces: Sequence[Sequence[int]] | AnyArray,
        groups: Sequence[int] | None = None,
        tagged: Sequence[tuple[int, int]] = (),
        base: int | None = 0,
        notes: tuple[str, ...] = (),
        sides: Sequence[int] | AnyArray | None = None,
    ) -> FileSurface:
        """Return the surface of faces.

        faces  one corner sequence a face; (F, n) where all faces have n corners; or, with their numbers of
               `sides` (F,), the corners of all, int64 (C,), one face after another

        Raises ValueError where a face names a missing vertex.
        """
        if sides is not None:
            offsets, corners = offsets_of(sides), np.asarray(faces, np.int64)
        elif isinstance(faces, np.ndarray):
            offsets, corners = faces.shape[1] * np.arange(len(faces) + 1), faces.reshape(-1).astype(np.int64)
        else:
            offsets = offsets_of([len(face) for face in faces])
            corners = np.fromiter(chain.from_iterable(faces), np.int64)
        outside = (corners < 0) | (corners >= len(points))
        if outside.any():
            c = int(np.argmax(outside))
            face = int(np.searchsorted(offsets, c, side="right")) - 1
            first = base or 0
            fact = f"face {face + first} names vertex {corners[c] + first}"
            raise ValueError(f"{fact}; the file has {len(points)} vertices, numbered from {first}")
        alike = np.zeros(len(offsets) - 1, np.int64) if groups is None else np.array(groups, np.int64)
        return cls(points, offsets, corners, alike, np.array(tagged, np.int64).reshape(-1, 2), base, notes)

    @property
    def shares_vertices(self) -> bool:
        return self.base is not None


def offsets_of(sides: Sequence[int] | AnyArray) -> AnyArray:
    """Return where the corners of each face begin, and the last end, int64 (F + 1,), by their counts (F,)."""
    offsets = np.zeros(len(sides) + 1, np.int64)
    np.cumsum(sides, out=offsets[1:])
    return offsets


MOST_BYTES = 1 << 30  # bytes of a mesh file at most


@dataclass(frozen=True)
class ScenePart:
    """The part of a scene that is a model, and when.

    prim       path of the prim whose meshes are read; None for the scene's default prim, or all of it
    time_code  time of the scene; None for its first
    animation  name of the animation of a moving surface; None where the file has one
    """

    prim: str | None = None
    time_code: float | None = None
    animation: str | None = None


class SourceFiles(NamedTuple):
    """The files that a model is read from.

    digest  SHA-256 of their contents
    files   SHA-256 of each, by its path: the model's own file first, then the others that its reader opens,
            which are layers of a USD stage and buffers of a glTF scene
    up      axis that points up, y or z; None in formats that do not say it
    """

    digest: str
    files: tuple[tuple[Path, str], ...]
    up: str | None = None

    @classmethod
    def of(
        cls, files: Sequence[tuple[Path, str]], up: str | None = None, readers: Sequence[str] = ()
    ) -> SourceFiles:
        """Return files with the digest of all.

        readers  words for readers that earlier versions did not have, for files that they read otherwise
        """
        return cls(joint_digest([*readers, *(digest for _, digest in files)]), tuple(files), up)


@dataclass(frozen=True)
class SurfaceReader:
    """The reader of the surfaces of a format.

    read       reads a surface. Raises MeshError, or any error, where it cannot
    files      returns the files that a surface is read from; None where it is the one file
    states_up  whether files say which axis points up; `files` then returns it
    usual_up   axis, y or z, that points up in most files of a format that does not say it
    read_part  reads a part of a scene; None where parts have no names
    vertices   reads the positions (V, 3) of vertices and their other numbers (V,) by name, also of files
               without faces; None where `read` returns all that the format has
    misread    matches the beginning of files that an earlier reader read otherwise: they are other models now
    """

    read: Callable[[Path], FileSurface]
    files: Callable[[Path], SourceFiles] | None = None
    states_up: bool = False
    usual_up: str = "y"
    read_part: Callable[[Path, ScenePart], FileSurface] | None = None
    vertices: Callable[[Path], tuple[Points, Mapping[str, AnyArray]]] | None = None
    misread: re.Pattern[bytes] | None = None

    def reads(self, part: ScenePart | None) -> Callable[[Path], FileSurface]:
        """Return what reads a surface, or a part of it where the format names parts."""
        read_part = self.read_part
        return self.read if part is None or read_part is None else lambda path: read_part(path, part)

    @classmethod
    def of_content(
        cls,
        parse: Callable[[bytes], FileSurface],
        files: Callable[[Path], SourceFiles] | None = None,
        **options: Any,
    ) -> SurfaceReader:
        """Return the reader of surfaces that `parse` makes of the content of a file; the rest as above."""
        return cls(lambda path: parse(InputFile(path, MOST_BYTES).content()), files, **options)


class MovingSurface(Protocol):
    """A surface of a file that moves: its facts, and its polygons at times, which are read when asked for.

    One sample is in memory at a time. A process that reads them is kept from the first until `close`.
    """

    @property
    def files(self) -> SourceFiles:
        """The files that it is read from, their digests, and the axis that points up."""

    @property
    def times(self) -> Floats:
        """Seconds of its samples, float64 (T,), ascending; of the first and last key if `is_continuous`."""

    @property
    def rate(self) -> float | None:
        """Frames per second; None where the file does not say it."""

    @property
    def is_in_frames(self) -> bool:
        """True if its times are frames, not seconds: the file does not say how long a frame is (PC2)."""

    @property
    def is_fixed(self) -> bool:
        """True if its faces and their corners are those of the still surface at all times."""

    @property
    def is_continuous(self) -> bool:
        """True if the file itself says where vertices are at all times, also between its samples."""

    def at(self, seconds: float) -> FileSurface:
        """Return the polygons at a time, as `SurfaceReader.read` returns those of a still surface.

        Before the first time it is the first sample, after the last the last. One that is not continuous has
        the sample at the last of `times` that is not later.

        Raises MeshError, with the file and the time, where it cannot be read; MissingInputError where a file
        is gone or has changed since the surface was opened.
        """

    def close(self) -> None:
        """End the process that reads it; `at` begins another."""


class Paint(Protocol):
    """The paint of a model."""

    @property
    def points(self) -> Points:
        """The points (V, 3) at the corners of its faces, as the file has them."""

    def placed(self, place: Points) -> Paint:
        """Return the paint with its points (V, 3) elsewhere."""

    def seams(self, vertices: Points, edges: Indices) -> Indices:
        """Return those of the edges (E, 2) of a surface where the paint changes.

        vertices  (V, 3) of the surface, at points of the file
        """

    def on_faces(self, rest: Points, faces: Faces) -> PaintedFaces:
        """Return the paint of faces (F, 3) of vertices whose rest positions are (V, 3)."""


class ModelMaterials(NamedTuple):
    """The materials of a model.

    parts  by number
    files  SHA-256 of all files that they are read from, by their paths
    notes  lines to tell the user about what is not shown as the file has it
    """

    parts: tuple[PatternedMaterial, ...]
    files: Mapping[Path, str]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class PaintReader:
    """The reader of what lies on the faces of models of a format: texture coordinates, colours and materials.

    materials  returns the materials of a model
    paint      returns the paint
    files      returns the files that paint is read from besides those of the surface, and their SHA-256
    of_part    returns the reader of a `ScenePart` of scenes; None where parts have no names

    They raise MissingInputError where a file is not there, and any error where it cannot read.
    """

    materials: Callable[[Path], ModelMaterials]
    paint: Callable[[Path], Paint]
    files: Callable[[Path], Mapping[Path, str]] = lambda path: {}
    of_part: Callable[[ScenePart], PaintReader] | None = None


def suffix_of(path: str | Path) -> str:
    """Return the suffix of a path in small letters, without its dot."""
    return Path(path).suffix.lower().lstrip(".")
