"""Reading meshes by trimesh: OBJ, PLY, STL, GLB, OFF.

trimesh is imported where it is used: most runs never read a mesh file.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.arrays import AnyArray, Faces, Points
from pipeline.errors import MeshError, MissingInputError
from pipeline.mesh.triangles import TriangleMesh
from pipeline.mesh.validate import require

FORMATS = ("obj", "ply", "stl", "glb", "gltf", "off")
_MERGE = 1e-9  # of the bounding box's diagonal: coordinates that close are one vertex


def read_mesh(path: str | Path) -> TriangleMesh:
    """Read a surface: scenes are joined, polygons triangulated, coincident vertices merged (P23).

    Merging joins the loose triangles of an STL and the seams of textured models into one surface;
    faces that lose a corner by it are dropped, as are vertices that no face uses.

    Raises MissingInputError where there is no such file, MeshError where it cannot be read or is not
    a finite, oriented manifold.
    """
    path = Path(path)
    if not path.is_file():
        raise MissingInputError(f"{path}: there is no such file; check the path")
    if path.suffix.lstrip(".").lower() not in FORMATS:
        raise MeshError(
            f"{path}: {path.suffix or 'no suffix'} is not a mesh format; use one of {', '.join(FORMATS)}"
        )
    import trimesh

    try:
        loaded = trimesh.load(path, force="mesh", process=False, maintain_order=True)
        points, faces = np.asarray(loaded.vertices, np.float64), np.asarray(loaded.faces, np.int64)
    except Exception as error:  # trimesh's readers raise whatever their parsers do
        raise MeshError(f"{path}: cannot be read as {path.suffix[1:].upper()} ({_brief(error)})") from error
    if len(faces) == 0:
        raise MeshError(f"{path}: it holds no faces; a surface needs at least one triangle")
    if not np.isfinite(points).all():
        wild = int(np.argmin(np.isfinite(points).all(axis=1)))
        raise MeshError(f"{path}: vertex {wild} is not finite; coordinates must be numbers")
    mesh = TriangleMesh(*_merged(points, faces))
    require(mesh, name=str(path))
    return mesh


def _merged(points: Points, faces: AnyArray) -> tuple[Points, Faces]:
    """Join coincident vertices, keep the order of their first use, drop what is then without use."""
    span = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
    cells = np.round((points - points.min(axis=0)) / (_MERGE * span)).astype(np.int64)
    _, first, cell = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    faces = first[cell.reshape(-1)[faces]]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    used, renumbered = np.unique(faces, return_inverse=True)
    return points[used], renumbered.reshape(-1, 3).astype(np.int32)


def _brief(error: Exception) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 120 else text[:117] + "…"
