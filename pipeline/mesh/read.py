"""Read meshes: OBJ, PLY and OFF with their polygons, STL and GLB by trimesh.

trimesh cuts faces of more than four sides into fans, which is wrong for concave ones, and drops groups. It is
imported only where it is used, since most runs never read a mesh file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from pipeline.errors import FlowsculptError, MeshError, MissingInputError, reason_of
from pipeline.mesh.early_ends import check_glb, check_stl
from pipeline.mesh.polygon_files import (
    FileSurface,
    file_surface,
    read_object_file,
    read_polygon_file,
    read_wavefront,
)
from pipeline.mesh.polygon_mesh import PolygonMesh
from pipeline.mesh.repair import repair_surface
from pipeline.mesh.triangle_mesh import TriangleMesh

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
    vertices  number of vertices in the file
    faces     number of faces in the file
    """

    mesh: PolygonMesh
    repairs: tuple[str, ...]
    format: str
    vertices: int
    faces: int


def read_surface(path: str | Path, repair: bool = True) -> ImportedSurface:
    """Read a surface: scenes are joined, polygons kept, coincident vertices merged, faults repaired.

    Merging joins the loose triangles of an STL and the seams of textured models into one surface; faces with
    fewer than three corners left are dropped, and so are unused vertices. Creases are the edges that an OBJ
    tags as such, and those between faces of different objects, groups, smoothing groups or materials (P31).

    Raises MissingInputError where there is no such file, MeshError where it cannot be read or is not a
    finite, oriented manifold: without `repair` any such fault, with it those that cannot be repaired.
    """
    path = Path(path)
    loaded = read_by_suffix(path, _READERS, "a mesh format")
    if len(loaded.corners) == 0:
        raise MeshError(f"{path}: it holds no faces; a surface needs at least one triangle")
    try:
        mesh, repairs = repair_surface(loaded, repair)
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from None
    suffix = path.suffix.lstrip(".").upper()
    return ImportedSurface(mesh, repairs, suffix, len(loaded.points), len(loaded.offsets) - 1)


def _read_by_trimesh(path: Path) -> FileSurface:
    import trimesh

    scene = trimesh.load(path, force="mesh", process=False, maintain_order=True)
    return file_surface(np.asarray(scene.vertices, np.float64), np.asarray(scene.faces), base=None)


def _read_stl(path: Path) -> FileSurface:
    try:
        surface = _read_by_trimesh(path)
    except Exception:
        check_stl(path.read_bytes())
        raise
    if len(surface.corners) == 0:
        check_stl(path.read_bytes())
    return surface


def _read_glb(path: Path) -> FileSurface:
    check_glb(path.read_bytes())
    return _read_by_trimesh(path)


_READERS: dict[str, Callable[[Path], FileSurface]] = {
    "obj": read_wavefront,
    "ply": read_polygon_file,
    "stl": _read_stl,
    "glb": _read_glb,
    "gltf": _read_by_trimesh,
    "off": read_object_file,
}
FORMATS = tuple(_READERS)
"""Suffixes of readable mesh files."""


def read_by_suffix(path: Path, readers: Mapping[str, Callable[[Path], T]], kind: str) -> T:
    """Return what the reader for the file's suffix returns.

    Raises MissingInputError where there is no such file, MeshError for another suffix or an unreadable file.
    """
    if not path.is_file():
        raise MissingInputError(f"{path}: there is no such file; check the path")
    suffix = path.suffix.lstrip(".").lower()
    if suffix not in readers:
        raise MeshError(
            f"{path}: {path.suffix or 'no suffix'} is not {kind}; use one of {', '.join(readers)}"
        )
    if path.stat().st_size == 0:
        raise MeshError(f"{path}: the file is empty. Copy or export it again.")
    try:
        return readers[suffix](path)
    except FlowsculptError:
        raise
    except Exception as error:  # readers raise whatever their parsers do
        raise MeshError(
            f"{path}: cannot be read as {suffix.upper()} ({reason_of(error)}). Copy or export it again."
        ) from error
