"""Clouds: subjects that are points, drawn as spheres."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pipeline.arrays import Floats, Points
from pipeline.errors import MeshError, UsageError, suggestion
from pipeline.mesh import TriangleMesh
from pipeline.mesh.control_net import Lattice, Net, sheet_net, torus_net, tube_net
from pipeline.mesh.io.points import PointSet, read_net, read_points
from pipeline.mesh.scatter import on_surface, within
from pipeline.shot.data import NOT_DATA
from pipeline.shot.subject import Measure, Solid, Subject, measure

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


MOST_POINTS = 1_000_000


class ControlNet(Subject):
    """Points in rows that move; what is seen is the bicubic B-spline surface of where they are."""

    @property
    def is_surface(self) -> bool:
        return False

    @property
    def lattice(self) -> Lattice:
        return self.net()[1]

    @abstractmethod
    def net(self) -> Net:
        """The points (N, 3) at rest, row by row, and how they are laid out."""

    def build(self, max_edge_length: float | None = None) -> TriangleMesh:
        """The net itself, its cells cut into triangles."""
        points, lattice = self.net()
        return TriangleMesh(points, lattice.faces())


@dataclass(frozen=True)
class NetKind:
    """A net that shots can name.

    measures       what it is measured by, in scene units, and what it measures if nothing is said
    rows, columns  of how many points it is if nothing is said
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
        """`NetOfSolid.of("tube", {"length": 4})`; what is left out takes its default."""
        kind = NETS[solid]
        values = {**kind.measures, **given}
        measures = tuple((name, measure(values[name])) for name in kind.measures)
        return cls(solid, measures, rows or kind.rows, columns or kind.columns)

    def net(self) -> Net:
        return NETS[self.solid].make(*(value for _, value in self.measures), self.rows, self.columns)


@dataclass(frozen=True)
class NetOfRows(ControlNet):
    """A net whose points stand in the shot file, in rows of equally many."""

    rows: tuple[tuple[tuple[float, ...], ...], ...]
    closed: tuple[bool, bool] = (False, False)

    def net(self) -> Net:
        return _net(np.array(self.rows, np.float64), self.closed)


@dataclass(frozen=True)
class NetOfFile(ControlNet):
    """The net of a file, known by its contents.

    digest   SHA-256 of the file
    columns  how many of its points make a row; None where the file says it
    scale    factor on all coordinates
    """

    digest: str
    columns: int | None = None
    closed: tuple[bool, bool] = (False, False)
    scale: float = 1.0
    path: Path = field(default=Path(), metadata=NOT_DATA)

    def net(self) -> Net:
        """Raises what `read_net` raises, and MeshError for a net that is too small."""
        return _net(self.scale * read_net(self.path, self.columns), self.closed)


def _net(grid: Floats, closed: tuple[bool, bool]) -> Net:
    rows, columns, _ = grid.shape
    points: Points = grid.reshape(-1, 3)
    return points, Lattice(rows, columns, closed)
