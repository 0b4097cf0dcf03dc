"""Repair: from the faces of a file to a sound surface, and what was changed on the way."""

from __future__ import annotations

from typing import NamedTuple

from pipeline.mesh.merging import merge_coincident
from pipeline.mesh.polygon_files import FileSurface
from pipeline.mesh.polygon_mesh import PolygonMesh
from pipeline.mesh.validation import require


class RepairedSurface(NamedTuple):
    """A sound surface; `repairs` has one line for each kind of change, with count and first coordinates."""

    mesh: PolygonMesh
    repairs: tuple[str, ...] = ()


def repair_surface(surface: FileSurface, repair: bool = True, name: str = "mesh") -> RepairedSurface:
    """Return the sound surface of a file's polygons, with the creases of the file.

    A surface that is sound once its coincident vertices are merged is returned as it is.

    Raises MeshError, a sentence that begins with `name`, where nothing sound can be made of it, and without
    `repair` wherever it is not sound.
    """
    merged = merge_coincident(surface)
    require(merged.mesh, name=name)
    return RepairedSurface(merged.mesh.with_creases(merged.creases))
