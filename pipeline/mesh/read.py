"""Read meshes: OBJ, PLY and OFF with their polygons, STL and GLB by trimesh.

trimesh cuts faces of more than four sides into fans, which is wrong for concave ones, and drops groups. It is
imported only where it is used, since most runs never read a mesh file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.errors import FlowsculptError, MeshError, MissingInputError, reason_of
from pipeline.mesh.polygon_files import (
    FileSurface,
    file_surface,
    read_object_file,
    read_polygon_file,
    read_wavefront,
)
from pipeline.mesh.polygon_mesh import PolygonMesh
from pipeline.mesh.triangle_mesh import TriangleMesh, edge_keys
from pipeline.mesh.validation import require, twin_corners

T = TypeVar("T")

_MERGE = 1e-9  # of the bounding box's diagonal: closer vertices are one


def read_mesh(path: str | Path) -> TriangleMesh:
    """Read a surface and triangulate its polygons (P23).

    Keeps the creases of the file. Raises the errors of `read_polygons`.
    """
    return read_polygons(path).triangulated()


def read_polygons(path: str | Path) -> PolygonMesh:
    """Read a surface as it is: scenes are joined, polygons kept, coincident vertices merged.

    Merging joins the loose triangles of an STL and the seams of textured models into one surface; faces with
    fewer than three corners left are dropped, and so are unused vertices. Creases are the edges that an OBJ
    tags as such, and those between faces of different objects, groups, smoothing groups or materials (P31).

    Raises MissingInputError where there is no such file, MeshError where it cannot be read or is not a
    finite, oriented manifold.
    """
    path = Path(path)
    loaded = read_by_suffix(path, _READERS, "a mesh format")
    if len(loaded.corners) == 0:
        raise MeshError(f"{path}: it holds no faces; a surface needs at least one triangle")
    if not np.isfinite(loaded.points).all():
        vertex = int(np.argmin(np.isfinite(loaded.points).all(axis=1)))
        raise MeshError(f"{path}: vertex {vertex} is not finite; coordinates must be numbers")
    mesh, groups, tagged = _merged(loaded)
    require(mesh, name=str(path))
    return mesh.with_creases(np.concatenate([_between_groups(mesh, groups), _existing(mesh, tagged)]))


def _read_by_trimesh(path: Path) -> FileSurface:
    import trimesh

    scene = trimesh.load(path, force="mesh", process=False, maintain_order=True)
    return file_surface(np.asarray(scene.vertices, np.float64), np.asarray(scene.faces))


_READERS: dict[str, Callable[[Path], FileSurface]] = {
    "obj": read_wavefront,
    "ply": read_polygon_file,
    "stl": _read_by_trimesh,
    "glb": _read_by_trimesh,
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
    try:
        return readers[suffix](path)
    except FlowsculptError:
        raise
    except Exception as error:  # readers raise whatever their parsers do
        raise MeshError(f"{path}: cannot be read as {suffix.upper()} ({reason_of(error)})") from error


def _merged(loaded: FileSurface) -> tuple[PolygonMesh, AnyArray, AnyArray]:
    """Merge coincident vertices and drop unused ones; return the mesh, the groups and the tagged edges."""
    points, offsets = loaded.points, loaded.offsets
    joined = _first_alike(points)
    corners, face = joined[loaded.corners], np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    following = np.arange(1, len(corners) + 1)
    some = offsets[1:] > offsets[:-1]
    following[offsets[1:][some] - 1] = offsets[:-1][some]
    kept = corners != corners[following]
    sides = np.bincount(face[kept], minlength=len(offsets) - 1)
    whole = sides >= 3
    used, renumbered = np.unique(corners[kept & whole[face]], return_inverse=True)
    mesh = PolygonMesh.from_arrays(
        points[used], np.cumsum([0, *sides[whole].tolist()]), renumbered.reshape(-1)
    )
    number = np.full(len(points), -1)
    number[used] = np.arange(len(used))
    inside = ((loaded.tagged >= 0) & (loaded.tagged < len(points))).all(axis=1)
    return mesh, loaded.groups[whole], number[joined[loaded.tagged[inside]]]


def _first_alike(points: AnyArray) -> AnyArray:
    """Return for each point (V,) the first one at the same position."""
    span = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
    cells = np.round((points - points.min(axis=0)) / (_MERGE * span)).astype(np.int64)
    _, first, cell = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    return first[cell.reshape(-1)]


def _between_groups(mesh: PolygonMesh, groups: AnyArray) -> AnyArray:
    """Return the edges (K, 2) whose two faces belong to different groups."""
    twin, mine = twin_corners(mesh), groups[mesh.owners]
    parting = (twin >= 0) & (mine != mine[twin])
    return np.column_stack([mesh.corners[parting], mesh.heads[parting]])


def _existing(mesh: PolygonMesh, pairs: AnyArray) -> AnyArray:
    """Return the pairs (K, 2) that are edges; tags on others are ignored."""
    if not len(pairs):
        return pairs
    wanted = np.sort(pairs, axis=1)
    return wanted[(wanted[:, 0] >= 0) & np.isin(edge_keys(wanted), edge_keys(mesh.edges))]
