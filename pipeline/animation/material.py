"""Where the points of a surface were before anything moved them: for colours that move with the material."""

from __future__ import annotations

from typing import TypeVar

from pipeline.arrays import Points
from pipeline.errors import UsageError
from pipeline.mesh import PolygonMesh, TriangleMesh
from pipeline.resample.at_rest import REST

MATERIAL = "material"
"""The vertex attribute (V, 3) of those places, where `rest` does not tell them: with exact placement it does
until the surface at rest is renewed."""

Mesh = TypeVar("Mesh", TriangleMesh, PolygonMesh)


def marked(mesh: Mesh) -> Mesh:
    """The undeformed surface, whose vertices from here on remember where they are now."""
    return mesh.with_attributes(**{MATERIAL: mesh.vertices})


def material_of(mesh: TriangleMesh) -> Points:
    """(V, 3) scene units: where the vertices of a frame of a shot were in its undeformed subject.

    With exact placement that is exact until the surface at rest is renewed. From then on, and with other
    placements, a new vertex is taken to come from the middle between its parents.

    Raises UsageError where the mesh is no frame of a shot.
    """
    for name in (MATERIAL, REST):
        if name in mesh.attributes:
            return mesh.attributes[name]
    raise UsageError(
        f"the mesh has neither vertex attribute {MATERIAL!r} nor {REST!r}; it is no frame of a shot"
    )
