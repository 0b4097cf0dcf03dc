"""Reading meshes: OBJ, PLY and OFF with their polygons, STL and GLB by trimesh.

trimesh's readers of polygon files cut faces of more than four sides into fans, which is wrong for concave
ones, and forget groups. It is imported where it is used: most runs never read a mesh file.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.errors import MeshError, MissingInputError
from pipeline.mesh.io.file_surface import FileSurface, file_surface
from pipeline.mesh.io.obj import read_object_file, read_wavefront
from pipeline.mesh.io.ply import read_polygon_file
from pipeline.mesh.polygon_mesh import PolygonMesh
from pipeline.mesh.triangle_mesh import TriangleMesh
from pipeline.mesh.validation import require_polygons, twin_corners

FORMATS = ("obj", "ply", "stl", "glb", "gltf", "off")
_MERGE = 1e-9  # of the bounding box's diagonal: coordinates that close are one vertex


def read_mesh(path: str | Path) -> TriangleMesh:
    """Read a surface of triangles: what `read_polygons` reads, its polygons cut into triangles (P23).

    The creases of the file come along. Raises what `read_polygons` raises.
    """
    return read_polygons(path).triangulated()


def read_polygons(path: str | Path) -> PolygonMesh:
    """Read a surface as it is: scenes are joined, polygons kept, coincident vertices merged.

    Merging joins the loose triangles of an STL and the seams of textured models into one surface; faces
    that have fewer than three corners left are dropped, as are vertices that no face uses. Creases are
    the edges that an OBJ tags as such, and those between faces of its different objects, groups,
    smoothing groups or materials (P31).

    Raises MissingInputError where there is no such file, MeshError where it cannot be read or is not
    a finite, oriented manifold.
    """
    path = Path(path)
    if not path.is_file():
        raise MissingInputError(f"{path}: there is no such file; check the path")
    suffix = path.suffix.lstrip(".").lower()
    if suffix not in FORMATS:
        raise MeshError(
            f"{path}: {path.suffix or 'no suffix'} is not a mesh format; use one of {', '.join(FORMATS)}"
        )
    try:
        found = _READERS.get(suffix, _read_by_trimesh)(path)
    except Exception as error:  # readers raise whatever their parsers do
        raise MeshError(f"{path}: cannot be read as {suffix.upper()} ({_brief(error)})") from error
    if len(found.corners) == 0:
        raise MeshError(f"{path}: it holds no faces; a surface needs at least one triangle")
    if not np.isfinite(found.points).all():
        wild = int(np.argmin(np.isfinite(found.points).all(axis=1)))
        raise MeshError(f"{path}: vertex {wild} is not finite; coordinates must be numbers")
    mesh, groups, tagged = _merged(found)
    require_polygons(mesh, name=str(path))
    return mesh.with_creases(np.concatenate([_between_groups(mesh, groups), _existing(mesh, tagged)]))


def _read_by_trimesh(path: Path) -> FileSurface:
    import trimesh

    loaded = trimesh.load(path, force="mesh", process=False, maintain_order=True)
    return file_surface(np.asarray(loaded.vertices, np.float64), np.asarray(loaded.faces))


_READERS: dict[str, Callable[[Path], FileSurface]] = {
    "obj": read_wavefront,
    "ply": read_polygon_file,
    "off": read_object_file,
}


def _merged(found: FileSurface) -> tuple[PolygonMesh, AnyArray, AnyArray]:
    """Join coincident vertices, drop what is then without use; groups and tagged edges go along."""
    points, offsets = found.points, found.offsets
    joined = _first_alike(points)
    corners, face = joined[found.corners], np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
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
    inside = ((found.tagged >= 0) & (found.tagged < len(points))).all(axis=1)
    return mesh, found.groups[whole], number[joined[found.tagged[inside]]]


def _first_alike(points: AnyArray) -> AnyArray:
    """(V,) for each point the first one that lies where it does."""
    span = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
    cells = np.round((points - points.min(axis=0)) / (_MERGE * span)).astype(np.int64)
    _, first, cell = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    return first[cell.reshape(-1)]


def _between_groups(mesh: PolygonMesh, groups: AnyArray) -> AnyArray:
    """(K, 2) the edges whose two faces belong to different groups."""
    twin, mine = twin_corners(mesh), groups[mesh.owners]
    parting = (twin >= 0) & (mine != mine[twin])
    return np.column_stack([mesh.corners[parting], mesh.heads[parting]])


def _existing(mesh: PolygonMesh, pairs: AnyArray) -> AnyArray:
    """(K, 2) those of the pairs that are edges; a tag on others says nothing of the surface."""
    if not len(pairs):
        return pairs
    edges, wanted = mesh.edges.astype(np.int64), np.sort(pairs, axis=1)
    number = len(mesh.vertices)
    known = edges[:, 0] * number + edges[:, 1]
    return wanted[(wanted[:, 0] >= 0) & np.isin(wanted[:, 0] * number + wanted[:, 1], known)]


def _brief(error: Exception) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 120 else text[:117] + "…"
