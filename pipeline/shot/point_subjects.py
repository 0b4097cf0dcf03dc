"""Subjects that are points: clouds, drawn as spheres, and control nets of smooth surfaces."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.errors import MeshError, UsageError, shortened, suggestion
from flowsculpt.pipeline.mesh import TriangleMesh
from flowsculpt.pipeline.mesh.control_net import Lattice, Net, sheet_net, torus_net, tube_net
from flowsculpt.pipeline.mesh.points import PointSet, read_net, read_points, sample_surface, within
from flowsculpt.pipeline.shot.subjects import Measure, Solid, Subject, measures_of
from flowsculpt.render.base.serialise import NOT_PLAIN

RADIUS = "radius"
"""The vertex attribute (V,), scene units, that makes points into spheres."""

MOST_POINTS = 2_000_000

_EDGE = 2.45
"""Edge length of the mesh that points are scattered on, in distances between points: about a face a point."""


class Cloud(Subject):
    """Points that move independently; they have no edges to resample."""

    @property
    def is_surface(self) -> bool:
        return False

    @abstractmethod
    def points(self) -> tuple[Points, Floats]:
        """Return positions (N, 3) and radii (N,) at rest."""

    def build(self, max_edge_length: float | None = None) -> TriangleMesh:
        """Return a mesh of the points without faces, with their radii as the attribute `radius`."""
        points, radii = self.points()
        return TriangleMesh(points, [], {RADIUS: radii})


@dataclass(frozen=True)
class CloudInSolid(Cloud):
    """Points scattered evenly in a solid, or on its surface.

    radius  of each sphere, scene units
    """

    solid: Solid
    count: int
    fill: Literal["volume", "surface"]
    seed: int
    radius: float

    def points(self) -> tuple[Points, Floats]:
        """Return positions and radii. Raises UsageError for the volume of a sheet, which encloses none."""
        mesh, surface = self.solid.build(), self.solid.project
        if self.fill == "surface":
            corners = mesh.vertices[mesh.faces]
            sides = corners[:, 1:] - corners[:, :1]
            area = 0.5 * float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum())
            fine = self.solid.build(_EDGE * (area / self.count) ** 0.5)
            places = surface(sample_surface(fine, self.count, self.seed)[0])
        elif self.solid.solid == "sheet":
            raise UsageError("a sheet encloses no volume to fill; write fill: surface")
        else:
            places = within(mesh.bounds, surface.encloses, self.count, self.seed)
        return places, np.full(self.count, self.radius)


@dataclass(frozen=True)
class CloudOfFile(Cloud):
    """The points of a file, identified by its contents.

    digest  SHA-256 of the file
    radius  of each sphere, scene units; or the name of an attribute of the file, in the file's units
    scale   factor on all coordinates, and on radii from the file
    """

    digest: str
    radius: float | str
    scale: float = 1.0
    path: Path = field(default=Path(), metadata=NOT_PLAIN)

    def points(self) -> tuple[Points, Floats]:
        """Return positions and radii. Raises what `read_points` and `radii_of` raise."""
        file = read_points(self.path)
        radii = radii_of(file, self.radius, str(self.path))
        return self.scale * file.points, radii if isinstance(self.radius, float) else self.scale * radii


def radii_of(file: PointSet, radius: float | str, name: str) -> Floats:
    """Return the radii (N,) of the points of a file: one number for all, or an attribute.

    Raises MeshError, which begins with `name`, for too many points, an unknown attribute, or a value of it
    that is not above 0.
    """
    if len(file.points) > MOST_POINTS:
        raise MeshError(f"{name}: it holds {len(file.points)} points; it may hold {MOST_POINTS}. Thin it out")
    if not isinstance(radius, str):
        return np.full(len(file.points), radius)
    if radius not in file.attributes:
        hint = suggestion(radius, file.attributes) if file.attributes else "It has none; write a number."
        raise MeshError(f"{name}: its points have no attribute {shortened(radius)} for a radius. {hint}")
    radii = file.attributes[radius].astype(np.float64)
    bad = np.flatnonzero(~(np.isfinite(radii) & (radii > 0)))
    if len(bad):
        raise MeshError(
            f"{name}: {radius} of point {bad[0]} is {radii[bad[0]]:g} (and {len(bad) - 1} more); radii must "
            "be above 0. Correct them in the file"
        )
    return radii


class ControlNet(Subject):
    """Control points in rows that move; visible is the bicubic B-spline surface that they control."""

    @property
    def is_surface(self) -> bool:
        return False

    @property
    def lattice(self) -> Lattice:
        return self.net()[1]

    @abstractmethod
    def net(self) -> Net:
        """Return the points (N, 3) at rest, row by row, and their layout."""

    def build(self, max_edge_length: float | None = None) -> TriangleMesh:
        """Return the control net as a mesh, its cells cut into triangles."""
        points, lattice = self.net()
        return TriangleMesh(points, lattice.faces())


@dataclass(frozen=True)
class NetKind:
    """A net that shots can name.

    measures       names and defaults of its measures, scene units
    rows, columns  default numbers of points
    make           `make(*measures, rows, columns)`
    """

    measures: Mapping[str, Measure]
    rows: int
    columns: int
    make: Callable[..., Net]


NETS: Mapping[str, NetKind] = {
    "sheet": NetKind({"size": (2.0, 2.0)}, 12, 12, sheet_net),
    "tube": NetKind({"length": 3.0, "radius": 0.5}, 12, 8, tube_net),
    "torus": NetKind({"radius": 1.0, "tube_radius": 0.4}, 8, 16, torus_net),
}


@dataclass(frozen=True)
class NetOfSolid(ControlNet):
    """A net of NETS. `measures` holds all of its measures by name, in the order of the registry."""

    solid: str
    measures: tuple[tuple[str, Measure], ...]
    rows: int
    columns: int

    @classmethod
    def of(
        cls, solid: str, given: Mapping[str, Any], rows: int | None = None, columns: int | None = None
    ) -> NetOfSolid:
        """Return a net from measures, e.g. `NetOfSolid.of("tube", {"length": 4})`; others take defaults."""
        kind = NETS[solid]
        return cls(solid, measures_of(kind.measures, given), rows or kind.rows, columns or kind.columns)

    def net(self) -> Net:
        return NETS[self.solid].make(*(value for _, value in self.measures), self.rows, self.columns)


@dataclass(frozen=True)
class NetOfRows(ControlNet):
    """A net whose points stand in the shot file, in rows of equal length."""

    rows: tuple[tuple[tuple[float, ...], ...], ...]
    closed: tuple[bool, bool] = (False, False)

    def net(self) -> Net:
        return _net(np.array(self.rows, np.float64), self.closed)


@dataclass(frozen=True)
class NetOfFile(ControlNet):
    """The net of a file, identified by its contents.

    digest   SHA-256 of the file
    columns  points in a row; None takes the rows of the file
    scale    factor on all coordinates
    """

    digest: str
    columns: int | None = None
    closed: tuple[bool, bool] = (False, False)
    scale: float = 1.0
    path: Path = field(default=Path(), metadata=NOT_PLAIN)

    def net(self) -> Net:
        """Return points and layout. Raises what `read_net` raises, and MeshError for too few points."""
        return _net(self.scale * read_net(self.path, self.columns), self.closed)


def _net(grid: Floats, closed: tuple[bool, bool]) -> Net:
    rows, columns, _ = grid.shape
    points: Points = grid.reshape(-1, 3)
    return points, Lattice(rows, columns, closed)
