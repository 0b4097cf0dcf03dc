"""Nets: subjects that are control points, drawn as the smooth surface that they shape."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.arrays import Floats, Points
from pipeline.mesh import TriangleMesh
from pipeline.mesh.control_net import Lattice, Net, sheet_net, torus_net, tube_net
from pipeline.mesh.io.points import read_net
from pipeline.shot.data import NOT_DATA
from pipeline.shot.subject import Measure, Subject, measure

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
