"""Read meshes with their polygons, from files of the formats of the core and of plug-ins.

trimesh cuts faces of more than four sides into fans, which is wrong for concave ones, and drops groups.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from pipeline.errors import FlowsculptError, MeshError, reason_of
from pipeline.mesh.file_surface import FileSurface
from pipeline.mesh.mesh_formats import (
    MeshFormat,
    ModelFiles,
    ScenePart,
    format_of,
    mesh_suffixes,
    own_file,
    suffix_of,
)
from pipeline.mesh.polygon_mesh import PolygonMesh
from pipeline.mesh.repair import repair_surface
from pipeline.mesh.triangle_mesh import TriangleMesh
from render.base.input_files import require_input

T = TypeVar("T")


def read_mesh(path: str | Path) -> TriangleMesh:
    """Read a surface and triangulate its polygons (P23).

    Keeps the creases of the file. Raises the errors of `read_polygons`.
    """
    return read_polygons(path).triangulated()


def read_polygons(path: str | Path) -> PolygonMesh:
    """Read a surface as it is, with its polygons, repaired where needed.

    Raises the errors of `read_surface`.
    """
    return read_surface(path).mesh


@dataclass(frozen=True)
class ImportedSurface:
    """A surface read from a file.

    mesh      sound: finite, oriented and manifold; with the creases of the file
    repairs   one line for each kind of repair, with the count and the coordinates of the first
    format    suffix of the file in capitals: `OBJ`
    vertices  number of vertices in the file; of merged ones where its faces share none, as in an STL
    faces     number of faces in the file
    notes     lines about what was not read as other programs show it
    unit      length of a unit of its coordinates, metres; None where the file does not say it
    """

    mesh: PolygonMesh
    repairs: tuple[str, ...]
    format: str
    vertices: int
    faces: int
    notes: tuple[str, ...] = ()
    unit: float | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """Lines to tell the user about a model: what was repaired, and the notes."""
        repaired = (f"model repaired: {line}" for line in self.repairs)
        return (*repaired, *(f"model: {line}" for line in self.notes))


def read_surface(path: str | Path, repair: bool = True, part: ScenePart | None = None) -> ImportedSurface:
    """Read a surface: scenes are joined, polygons kept, coincident vertices merged, faults repaired.

    Merging joins the loose triangles of an STL and the seams of textured models into one surface; faces with
    fewer than three corners left are dropped, and so are unused vertices. Creases are the edges that an OBJ
    tags as such, and those between faces of different objects, groups, smoothing groups or materials (P31);
    those of other formats as their readers say.

    part  of a scene whose format names parts

    Raises MissingInputError where there is no such file, MeshError where it cannot be read or is not a
    finite, oriented manifold: without `repair` any such fault, with it those that cannot be repaired.
    MachineError without the package that reads its format.
    """
    path = Path(path)
    form = format_of(path)
    readers = {} if form is None else {suffix_of(path): _reader(form, part)}
    loaded = read_by_suffix(path, readers, "a mesh format", mesh_suffixes())
    if len(loaded.corners) == 0:
        rest = "".join(f"; {note}" for note in loaded.notes)
        raise MeshError(f"{path}: it has no faces; a surface needs at least one triangle{rest}")
    _require_cuttable(path, loaded)
    try:
        mesh, repairs = repair_surface(loaded, repair)
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from None
    suffix = path.suffix.lstrip(".").upper()
    vertices = len(loaded.points) if loaded.shares_vertices else len(mesh.vertices)
    return ImportedSurface(
        mesh, repairs, suffix, vertices, len(loaded.offsets) - 1, loaded.notes, loaded.unit
    )


_FEW_CORNERS, _MOST_WORK = 64, 1.2e9
"""Cutting a face of n corners takes n³ steps; those of faces with few corners are not counted."""


def _require_cuttable(path: Path, surface: FileSurface) -> None:
    """Raise MeshError where cutting the faces into triangles would take more than seconds."""
    sides = np.diff(surface.offsets)
    if (sides[sides > _FEW_CORNERS].astype(np.float64) ** 3).sum() > _MOST_WORK:
        face = int(np.argmax(sides))
        raise MeshError(
            f"{path}: face {face + (surface.base or 0)} has {sides[face]} corners, too many to be cut into "
            "triangles here. Triangulate the model in the program that made it."
        )


def _reader(form: MeshFormat, part: ScenePart | None) -> Callable[[Path], FileSurface]:
    """Return the reader of a surface, or of a part of it where the format names parts."""
    if part is None or form.read_part is None:
        return form.read
    read_part = form.read_part
    return lambda path: read_part(path, part)


def states_up(path: Path) -> bool:
    """Tell whether files of a path's format state which axis points up."""
    form = format_of(path)
    return form is not None and form.states_up


def usual_up(path: Path) -> str:
    """Return the axis, y or z, that points up: what a file states, or what is usual in its format.

    Raises as `model_files` where the format states it.
    """
    form = format_of(path)
    if form is None:
        return "y"
    return (model_files(path).up if form.states_up else None) or form.usual_up


def model_files(path: Path) -> ModelFiles:
    """Return the files of a model, and their digests.

    Raises MissingInputError where one is missing; in formats whose files name others or state their axes also
    MeshError where it cannot be read, and MachineError without the package that reads it.
    """
    form = format_of(path)
    if form is None or form.files is None:
        return own_file(path)
    return read_by_suffix(path, {suffix_of(path): form.files}, "a mesh format")


def read_by_suffix(
    path: Path, readers: Mapping[str, Callable[[Path], T]], kind: str, known: Sequence[str] = ()
) -> T:
    """Return what the reader for the file's suffix returns.

    known  suffixes for the message, where there are more than `readers` has

    Raises MissingInputError where there is no such file, MeshError for another suffix or an unreadable file,
    BadInputError for one that is too large.
    """
    size, suffix = require_input(path), path.suffix.lstrip(".").lower()
    if suffix not in readers:
        raise MeshError(
            f"{path}: {path.suffix or 'no suffix'} is not {kind}; use one of {', '.join(known or readers)}"
        )
    if not size:
        raise MeshError(f"{path}: the file is empty. Copy or export it again.")
    try:
        with np.errstate(all="ignore"):  # numbers that are not finite are reported with their position
            return readers[suffix](path)
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from None
    except FlowsculptError:
        raise
    except Exception as error:  # readers raise whatever their parsers do
        raise MeshError(
            f"{path}: cannot be read as {suffix.upper()} ({reason_of(error)}). Copy or export it again."
        ) from error
