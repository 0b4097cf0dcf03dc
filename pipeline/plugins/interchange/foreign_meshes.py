"""Meshes of other Python libraries as surfaces: repaired, and textured after resampling as before."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flowsculpt import MeshError, PolygonMesh, TriangleMesh, UsageError
from flowsculpt.api import plural
from flowsculpt.api.meshes import FileSurface, Floats, ModelFile, find_coincident, repair_surface
from flowsculpt.pipeline.plugins.interchange.mesh_writers import UV
from flowsculpt.pipeline.plugins.interchange.model_paint import ModelPaint


def repair_mesh(mesh: TriangleMesh | PolygonMesh) -> tuple[TriangleMesh, tuple[str, ...]]:
    """Return a sound surface of a mesh's faces, in triangles, and what was changed.

    A resampler takes finite, oriented manifolds only, and tears a surface open where its vertices are double.
    trimesh, PyVista and glTF double them at seams of textures and at sharp edges. Vertices at one place are
    merged, faces wound alike, duplicate faces dropped, and parts that touch at a point or edge separated.

    Creases are kept, seams are not. Merged vertices have the attributes of the first of them; where these
    differ, as texture coordinates do at a seam, the changes say so: see `TextureCoordinates`.

    Returns the surface, for which `validate` says whether it is closed, and one line for each kind of change
    with its count and the coordinates of the first. Raises MeshError where nothing sound can be made of it.
    """
    faces = mesh if isinstance(mesh, PolygonMesh) else PolygonMesh.from_triangles(mesh)
    surface = FileSurface.of(faces.vertices, faces.corners.astype(np.int64), sides=np.diff(faces.offsets))
    surface = surface._replace(tagged=faces.creases.astype(np.int64))
    repaired, changes = repair_surface(surface)
    first, source = _first_vertices(mesh.vertices, repaired.vertices)
    attributes = {name: values[source] for name, values in mesh.attributes.items()}
    lost = _lost_values(mesh.attributes, first)
    return repaired.triangulated().with_attributes(**attributes), (*changes, *lost)


def _lost_values(attributes: Mapping[str, np.ndarray], first: np.ndarray) -> Iterator[str]:
    """Yield a line for each attribute that differs between vertices and the `first` (V,) at their place."""
    for name, values in attributes.items():
        count = int((values != values[first]).reshape(len(values), -1).any(axis=1).sum())
        if count:
            places = plural(count, "vertex", "vertices")
            yield f"attribute {name!r} of {places} differs from that of others there: dropped"


def _first_vertices(vertices: Floats, places: Floats) -> tuple[np.ndarray, np.ndarray]:
    """Return the first vertex at each vertex (V,) and at each place (N,), V or more where there is none.

    The tolerance is a share of the extent of the places.
    """
    both = np.concatenate([vertices, places])
    first = find_coincident(both, np.arange(len(both)) >= len(vertices))
    return first[: len(vertices)], first[len(vertices) :]


REST = "rest"
"""Name of the vertex attribute (V, 3) with positions at rest, which exact placement keeps."""


class TextureCoordinates:
    """Texture coordinates of a mesh, found on its surface again after resampling; nothing crosses a seam.

    Each vertex keeps its place on the mesh at rest, as the attribute `rest`. A corner of a new face takes the
    coordinates of the nearest point of the mesh there, on the face's own side of a seam.

    vertices  (V, 3)
    faces     (F, 3)
    uv        (V, 2), or (F, 3, 2) for the corners of each face: to the right and upwards. Vertices with one
              pair each are double at seams, as those of trimesh are

    Raises MeshError where the arrays have other shapes, there is no face, or a number is not finite.

        texture = TextureCoordinates(model.vertices, model.faces, model.visual.uv)
        mesh, changes = repair_mesh(TriangleMesh(model.vertices, model.faces))
        sculpture = Resampler(texture.prepare(mesh), Thresholds(0.05))
        textured = texture.split(sculpture.mesh)  # textured.attributes["uv"]
    """

    _paint: Any

    def __init__(self, vertices: ArrayLike, faces: ArrayLike, uv: ArrayLike) -> None:
        mesh, given = TriangleMesh(vertices, faces), np.asarray(uv, np.float64)
        count = len(mesh.faces)
        if not count:
            raise MeshError("the mesh has no faces, so it has no texture coordinates")
        if given.shape not in ((len(mesh.vertices), 2), (count, 3, 2)):
            raise MeshError(
                f"uv has shape {given.shape}; it must be ({len(mesh.vertices)}, 2), a pair for each vertex, "
                f"or ({count}, 3, 2), a pair for each corner"
            )
        if not (np.isfinite(given).all() and np.isfinite(mesh.vertices).all()):
            raise MeshError("vertices or uv hold numbers that are not finite; replace them")
        corners = given.reshape(-1, 2) if given.ndim == 3 else given[mesh.faces.reshape(-1)]
        sides, indices = np.full(count, 3), mesh.faces.reshape(-1).astype(np.int64)
        self._paint = ModelPaint.of(mesh.vertices, sides, indices, corners, np.zeros(count, np.int64))

    @classmethod
    def read(cls, path: str | Path) -> TextureCoordinates:
        """Return those of an OBJ, GLB, FBX or USD file, whose surface `read_mesh` reads.

        Raises MissingInputError and MeshError as `read_mesh`, also where the file has none.
        """
        found = cls.__new__(cls)
        found._paint = ModelFile(Path(path)).paint()
        if isinstance(found._paint, ModelPaint) and not np.ptp(found._paint.coordinates, axis=(0, 1)).any():
            raise MeshError(f"{path}: it has no texture coordinates. Export it with them.")
        return found

    def prepare(self, mesh: TriangleMesh) -> TriangleMesh:
        """Return the mesh as a `Resampler` takes it: with its seams, and with its vertices as `rest`.

        Raises UsageError where a vertex lies at no vertex of the textured mesh: prepare it before it moves.
        """
        _, first = _first_vertices(self._paint.points, mesh.vertices)
        if (first >= len(self._paint.points)).any():
            vertex = int(np.argmax(first >= len(self._paint.points)))
            raise UsageError(
                f"vertex {vertex} is at {mesh.vertices[vertex]}, where the mesh with texture coordinates has "
                "none. Prepare the mesh before it moves."
            )
        seams = self._paint.seams(mesh.vertices, mesh.halfedge_ends)
        return mesh.with_seams(seams).with_attributes(**{REST: mesh.vertices})

    def split(self, mesh: TriangleMesh) -> TriangleMesh:
        """Return a resampled mesh with the attribute `uv` (V, 2), and its vertices double at seams.

        It has the other attributes too, and the faces in their order; no creases or seams. That is what
        trimesh, PyVista and `write_mesh` take. Raises UsageError where the mesh has no `rest`.
        """
        if REST not in mesh.attributes:
            raise UsageError(f"the mesh has no attribute {REST!r}; resample what `prepare` returns")
        painted = self._paint.on_faces(mesh.attributes[REST], mesh.faces)
        charts = painted.charts[:, None] + (painted.charts.max(initial=0) + 1) * mesh.faces.astype(np.int64)
        _, corner, faces = np.unique(charts, return_index=True, return_inverse=True)
        source = mesh.faces.reshape(-1)[corner]
        attributes = {name: values[source] for name, values in mesh.attributes.items()}
        uv = painted.coordinates.reshape(-1, 2)[corner]
        return TriangleMesh(mesh.vertices[source], faces.reshape(-1, 3), {**attributes, UV: uv})
