"""Clouds: subjects that are points, drawn as spheres."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from pipeline.arrays import Floats, Points
from pipeline.errors import MeshError, UsageError, suggestion
from pipeline.mesh import TriangleMesh
from pipeline.mesh.io.points import PointSet, read_points
from pipeline.mesh.scatter import on_surface, within
from pipeline.shot.data import NOT_DATA
from pipeline.shot.subject import Solid, Subject

RADIUS = "radius"
"""The vertex attribute (V,), scene units, that makes points into spheres."""

MOST_POINTS = 2_000_000

_ROOM = 2.45
"""Edges of the mesh that points are strewn on, in distances between points: about a face for each."""


class Cloud(Subject):
    """Points that move, each for itself: nothing is between them to resample."""

    @property
    def is_surface(self) -> bool:
        return False

    @abstractmethod
    def points(self) -> tuple[Points, Floats]:
        """Places (N, 3) and radii (N,) at rest."""

    def build(self, max_edge_length: float | None = None) -> TriangleMesh:
        """The points as the vertices of a mesh without faces, their radii as the attribute `radius`."""
        points, radii = self.points()
        return TriangleMesh(points, [], {RADIUS: radii})


@dataclass(frozen=True)
class CloudInSolid(Cloud):
    """Points strewn evenly in a solid, or on its surface.

    radius  of each, scene units
    """

    solid: Solid
    count: int
    fill: Literal["volume", "surface"]
    seed: int
    radius: float

    def points(self) -> tuple[Points, Floats]:
        """Raises UsageError for the volume of a solid that encloses none."""
        mesh, surface = self.solid.build(), self.solid.project
        if self.fill == "surface":
            corners = mesh.vertices[mesh.faces]
            sides = corners[:, 1:] - corners[:, :1]
            area = 0.5 * float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum())
            fine = self.solid.build(_ROOM * (area / self.count) ** 0.5)
            places = surface(on_surface(fine, self.count, self.seed))
        elif self.solid.solid == "sheet":
            raise UsageError("a sheet encloses no volume to fill; write fill: surface")
        else:
            places = within(mesh.bounds, surface.encloses, self.count, self.seed)
        return places, np.full(self.count, self.radius)


@dataclass(frozen=True)
class CloudOfFile(Cloud):
    """The points of a file, known by its contents.

    digest  SHA-256 of the file
    radius  of each, scene units; or the name of the attribute of the file that says it, in the file's units
    scale   factor on all coordinates, and on radii that the file says
    """

    digest: str
    radius: float | str
    scale: float = 1.0
    path: Path = field(default=Path(), metadata=NOT_DATA)

    def points(self) -> tuple[Points, Floats]:
        """Raises what `read_points` and `radii_of` raise."""
        found = read_points(self.path)
        radii = radii_of(found, self.radius, str(self.path))
        return self.scale * found.points, radii if isinstance(self.radius, float) else self.scale * radii


def radii_of(found: PointSet, radius: float | str, name: str) -> Floats:
    """(N,) the radius of each point of a file: one for all, or those of an attribute.

    Raises MeshError, which begins with `name`, where there are too many points, no such attribute, or a value
    of it is not above 0.
    """
    if len(found.points) > MOST_POINTS:
        raise MeshError(f"{name}: it holds {len(found.points)} points; {MOST_POINTS} are the most")
    if not isinstance(radius, str):
        return np.full(len(found.points), radius)
    if radius not in found.attributes:
        hint = suggestion(radius, found.attributes) if found.attributes else "It has none; write a number."
        raise MeshError(f"{name}: its points have no attribute {radius!r} for a radius. {hint}")
    radii = found.attributes[radius].astype(np.float64)
    bad = np.flatnonzero(~(np.isfinite(radii) & (radii > 0)))
    if len(bad):
        raise MeshError(
            f"{name}: {radius} of point {bad[0]} is {radii[bad[0]]:g} (and {len(bad) - 1} more); radii must "
            "be above 0"
        )
    return radii
