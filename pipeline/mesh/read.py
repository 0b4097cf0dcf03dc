"""Read meshes: OBJ, PLY, OFF, STL, glTF, COLLADA and 3MF, with their polygons; USD by usd-core, FBX by ufbx.

trimesh cuts faces of more than four sides into fans, which is wrong for concave ones, and drops groups.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from pipeline.errors import FlowsculptError, MeshError, reason_of
from pipeline.mesh.collada_files import read_collada, up_of_collada
from pipeline.mesh.fbx_files import read_fbx, up_of_fbx
from pipeline.mesh.file_surface import FileSurface
from pipeline.mesh.gltf_document import MOST_BYTES
from pipeline.mesh.gltf_files import GLTF_FORMATS, is_gltf, read_gltf, scene_files
from pipeline.mesh.obj_files import read_wavefront
from pipeline.mesh.off_files import read_object_file
from pipeline.mesh.ply_files import read_polygon_file
from pipeline.mesh.polygon_mesh import PolygonMesh
from pipeline.mesh.repair import repair_surface
from pipeline.mesh.stl_files import read_stl
from pipeline.mesh.threemf_files import read_threemf
from pipeline.mesh.triangle_mesh import TriangleMesh
from pipeline.mesh.usd_files import USD_FORMATS, StagePart, is_usd, read_usd, stage_files
from render.base.input_files import digest_of_file, joint_digest, opened_input, read_input, require_input

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


def read_surface(path: str | Path, repair: bool = True, part: StagePart | None = None) -> ImportedSurface:
    """Read a surface: scenes are joined, polygons kept, coincident vertices merged, faults repaired.

    Merging joins the loose triangles of an STL and the seams of textured models into one surface; faces with
    fewer than three corners left are dropped, and so are unused vertices. Creases are the edges that an OBJ
    tags as such, and those between faces of different objects, groups, smoothing groups or materials (P31);
    in USD those with a sharpness, and those between meshes; in FBX, COLLADA and 3MF those between meshes or
    materials, in FBX also those with a weight and hard ones amid smooth ones.

    part  of a USD stage

    Raises MissingInputError where there is no such file, MeshError where it cannot be read or is not a
    finite, oriented manifold: without `repair` any such fault, with it those that cannot be repaired.
    MachineError for USD without usd-core, and for FBX without ufbx.
    """
    path = Path(path)
    readers = _READERS if part is None else dict.fromkeys(USD_FORMATS, lambda p: read_usd(p, part))
    loaded = read_by_suffix(path, readers, "a mesh format")
    if len(loaded.corners) == 0:
        rest = "".join(f"; {note}" for note in loaded.notes)
        raise MeshError(f"{path}: it holds no faces; a surface needs at least one triangle{rest}")
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


def reader_of(parse: Callable[[bytes], T]) -> Callable[[Path], T]:
    """Return the reader of files whose content `parse` reads."""
    return lambda path: parse(read_input(path, MOST_BYTES))


_READERS: dict[str, Callable[[Path], FileSurface]] = {
    "obj": reader_of(read_wavefront),
    "ply": reader_of(read_polygon_file),
    "stl": reader_of(read_stl),
    "glb": read_gltf,
    "gltf": read_gltf,
    "off": reader_of(read_object_file),
    "fbx": read_fbx,
    "dae": reader_of(read_collada),
    "3mf": reader_of(read_threemf),
    **dict.fromkeys(USD_FORMATS, read_usd),
}
FORMATS = tuple(_READERS)
"""Suffixes of readable mesh files."""

_VARIANTS = ("gltf", "usda", "usdc", "usdz")
"""Formats that messages leave out beside glb and usd."""

FORMATS_WITH_Z_UP = ("stl",)
"""Formats most of whose files have z up; they come from printing and construction."""


_UP_AXES: dict[str, Callable[[Path], str]] = {
    "fbx": lambda path: up_of_fbx(path, digest_of_file(path)),
    "dae": reader_of(up_of_collada),
    "3mf": lambda path: "z",
}
"""Readers of the axis that points up, of the formats that state it; USD is read by `stage_files`."""


def states_up(path: Path) -> bool:
    """Tell whether files of a path's format state which axis points up."""
    return is_usd(path) or path.suffix.lower().lstrip(".") in _UP_AXES


def usual_up(path: Path) -> str:
    """Return the axis, y or z, that points up: what a file states, or what is usual in its format.

    Raises as `model_files` where the format states it.
    """
    up = model_files(path).up if states_up(path) else None
    return up or ("z" if path.suffix.lower().lstrip(".") in FORMATS_WITH_Z_UP else "y")


class ModelFiles(NamedTuple):
    """The files that a model is read from.

    digest  SHA-256 of their contents
    files   SHA-256 of each, by its path: the model's own file first, then the others that its reader opens,
            which are layers of a USD stage and buffers of a glTF scene
    up      axis that points up, y or z; None in formats that do not say it
    """

    digest: str
    files: tuple[tuple[Path, str], ...]
    up: str | None = None


def model_files(path: Path) -> ModelFiles:
    """Return the files of a model, and their digests.

    Raises MissingInputError where one is missing; for USD, glTF, FBX, COLLADA and 3MF also MeshError
    where it cannot be read, and MachineError without the package that reads it.
    """
    if is_usd(path):
        stage = read_by_suffix(path, dict.fromkeys(USD_FORMATS, stage_files), "a USD stage")
        others = [(layer, digest) for layer, digest in stage.digests.items() if layer != path.absolute()]
        return ModelFiles(stage.digest, ((path, stage.digests[path.absolute()]), *others), stage.up)
    own = (path, digest_of_file(path))
    if not is_gltf(path):
        reader = ["text reader 2"] if _was_misread(path) else []
        up = read_by_suffix(path, _UP_AXES, "a format that states its axes") if states_up(path) else None
        return ModelFiles(joint_digest([*reader, own[1]]), (own,), up)
    scene = read_by_suffix(path, dict.fromkeys(GLTF_FORMATS, scene_files), "a glTF scene")
    files = (own, *((file, digest_of_file(file)) for file in scene.buffers))
    return ModelFiles(joint_digest([*scene.reader, *(digest for _, digest in files)]), files)


_MISREAD = {
    "obj": re.compile(
        rb"\A\xef\xbb\xbf|^[ \t]*(?:o|g|usemtl|mtllib)[ \t][^\r\n]*\\[ \t]*[\r\n]", re.MULTILINE
    ),
    "off": re.compile(rb"^[ \t]*(?:ST|C|N)*4n?OFF", re.MULTILINE),
    "ply": re.compile(rb"[\r\n]element[ \t]+tristrips[ \t]"),
}
"""What files begin with that an earlier reader read otherwise: they are other models now.

It lost the first vertex behind a byte order mark, and statements behind names that end in a backslash; it
divided by no w, and left out strips of triangles.
"""


def _was_misread(path: Path) -> bool:
    pattern = _MISREAD.get(path.suffix.lower().lstrip("."))
    if pattern is None:
        return False
    with opened_input(path) as (file, size):
        return pattern.search(file.read(min(size, 1 << 14))) is not None


def read_by_suffix(path: Path, readers: Mapping[str, Callable[[Path], T]], kind: str) -> T:
    """Return what the reader for the file's suffix returns.

    Raises MissingInputError where there is no such file, MeshError for another suffix or an unreadable file,
    BadInputError for one that is too large.
    """
    size, suffix = require_input(path), path.suffix.lstrip(".").lower()
    if suffix not in readers:
        raise MeshError(
            f"{path}: {path.suffix or 'no suffix'} is not {kind}; "
            f"use one of {', '.join(name for name in readers if name not in _VARIANTS)}"
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
