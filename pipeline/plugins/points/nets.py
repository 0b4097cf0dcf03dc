"""Control nets: points in rows that control a smooth surface, from a solid, a file or the shot file."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from flowsculpt import TriangleMesh, UsageError
from flowsculpt.api.meshes import Floats, Lattice
from flowsculpt.api.shots import Subject
from flowsculpt.pipeline.plugins.points.point_files import read_net

Net = tuple[Floats, Lattice]
Size = float | tuple[float, ...]


def sheet_net(size: tuple[float, float], rows: int, columns: int) -> Net:
    """Return a rectangle in the plane y = 0 that faces upwards. `size` is along x and z; rows run along x."""
    z, x = _line(size[1], rows), _line(size[0], columns)
    points = np.zeros((rows, columns, 3))
    points[..., 2], points[..., 0] = z[:, None], x[None, :]
    return points.reshape(-1, 3), Lattice(rows, columns)


def tube_net(length: float, radius: float, rows: int, columns: int) -> Net:
    """Return an open tube along the y axis with this radius at the columns; rows run around it."""
    points = np.empty((rows, columns, 3))
    points[..., 1] = _line(length, rows)[:, None]
    points[..., 0], points[..., 2] = _ring(radius, columns)
    return points.reshape(-1, 3), Lattice(rows, columns, (False, True))


def torus_net(radius: float, tube_radius: float, rows: int, columns: int) -> Net:
    """Return a ring around the y axis; rows run around the axis, columns around the tube.

    Raises UsageError where the tube is as thick as the ring is wide.
    """
    if tube_radius >= radius:
        raise UsageError(
            f"tube_radius {tube_radius:g} must be below radius {radius:g}, or the ring intersects itself"
        )
    away, height = _ring(tube_radius, rows)
    cos, sin = _ring(1.0, columns)
    points = np.empty((rows, columns, 3))
    points[..., 0] = (radius + away)[:, None] * cos
    points[..., 1] = height[:, None]
    points[..., 2] = (radius + away)[:, None] * sin
    return points.reshape(-1, 3), Lattice(rows, columns, (True, True))


def _line(extent: float, count: int) -> Floats:
    """Return points evenly on a line, one beyond each end, so that an open cubic spans the extent."""
    return extent * ((np.arange(count) - 1.0) / (count - 3) - 0.5)


def _ring(radius: float, count: int) -> tuple[Floats, Floats]:
    """Return cosine and sine of a circle enlarged so that a closed cubic through it has the radius.

    At its points the cubic takes a sixth of each neighbour and four sixths of the point: (4 + 2 cos step) / 6
    of the circle.
    """
    step = 2.0 * math.pi / count
    angle = step * np.arange(count)
    outer = radius * 3.0 / (2.0 + math.cos(step))
    return outer * np.cos(angle), outer * np.sin(angle)


class ControlNet(Subject):
    """Control points in rows that move; visible is the bicubic B-spline surface that they control."""

    @property
    def is_surface(self) -> bool:
        return False

    @property
    def is_net(self) -> bool:
        return True

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

    measures: Mapping[str, Size]
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
    measures: tuple[tuple[str, Size], ...]
    rows: int
    columns: int

    @classmethod
    def of(
        cls, solid: str, given: Mapping[str, Any], rows: int | None = None, columns: int | None = None
    ) -> NetOfSolid:
        """Return a net from measures, e.g. `NetOfSolid.of("tube", {"length": 4})`; others take defaults."""
        kind = NETS[solid]
        measures = tuple((name, _size(given.get(name, value))) for name, value in kind.measures.items())
        return cls(solid, measures, rows or kind.rows, columns or kind.columns)

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
    path: Path = field(default=Path(), metadata={"plain": False})  # keys have its digest

    @property
    def files(self) -> tuple[tuple[Path, str], ...]:
        return ((self.path, self.digest),)

    def net(self) -> Net:
        """Return points and layout. Raises what `read_net` raises, and MeshError for too few points."""
        return _net(self.scale * read_net(self.path, self.columns), self.closed)


def _size(given: Any) -> Size:
    return tuple(map(float, given)) if isinstance(given, list | tuple) else float(given)


def _net(grid: Floats, closed: tuple[bool, bool]) -> Net:
    rows, columns, _ = grid.shape
    points: Floats = grid.reshape(-1, 3)
    return points, Lattice(rows, columns, closed)
