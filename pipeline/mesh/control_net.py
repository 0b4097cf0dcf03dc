"""Control nets: the layout of their points, and their smooth B-spline surface.

The surface is a uniform bicubic B-spline, after Riesenfeld (*Applications of B-spline Approximation to
Geometric Problems of Computer-Aided Design*, 1973) and Farin, *Curves and Surfaces for CAGD*. It does not
pass through its points but stays within their convex hull, and moving them by an affine map moves it by the
same map. An open side begins near its second row of points and ends near the last but one: exactly there, if
those points are the midpoints of their neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Faces, Floats, Points, Vectors
from flowsculpt.pipeline.errors import MeshError, UsageError
from flowsculpt.pipeline.mesh.meshes import TriangleMesh
from flowsculpt.pipeline.mesh.normals import ShadedMesh, vertex_normals


@dataclass(frozen=True)
class Lattice:
    """Layout of control points in rows, one row after the other: point (i, j) is number i · columns + j.

    rows, columns  their numbers; at least 4
    closed         True where the first row follows the last one, and where the first column does

    The front of a net is the side from which the turn from the row to the column direction is
    counter-clockwise.

    Raises MeshError for fewer rows or columns.
    """

    rows: int
    columns: int
    closed: tuple[bool, bool] = (False, False)

    least: ClassVar = 4  # points along each side: the support of one cubic piece

    def __post_init__(self) -> None:
        if min(self.rows, self.columns) < self.least:
            size = f"{self.rows} × {self.columns}"
            fact = f"a net of {size} points is too small; a bicubic patch needs {self.least} × {self.least}"
            raise MeshError(f"{fact}. Add rows or columns.")

    def __len__(self) -> int:
        """Return the number of points."""
        return self.rows * self.columns

    def faces(self) -> Faces:
        """Return the net as triangles (F, 3), two for each of its cells."""
        return grid_faces(self.rows, self.columns, self.closed)

    def as_array(self) -> AnyArray:
        """Return int32 (4,): rows, columns, and 1 for each closed direction."""
        return np.array([self.rows, self.columns, *self.closed], np.int32)

    @classmethod
    def from_array(cls, numbers: AnyArray) -> Lattice:
        """Return the lattice of an `as_array`. Raises MeshError for other arrays."""
        if numbers.shape != (4,):
            rule = "it must be 4 numbers: rows, columns, and whether each is closed"
            raise MeshError(f"a net has shape {numbers.shape}; {rule}")
        rows, columns, around, across = numbers.tolist()
        return cls(rows, columns, (bool(around), bool(across)))


def grid_faces(rows: int, columns: int, closed: tuple[bool, bool]) -> Faces:
    """Return triangles (F, 3) over points in rows, two a cell; closed sides share their points."""
    i = np.arange(rows if closed[0] else rows - 1)[:, None]
    j = np.arange(columns if closed[1] else columns - 1)[None, :]
    below, above = i * columns, (i + 1) % rows * columns
    after = (j + 1) % columns
    corners = np.stack([below + j, above + j, above + after, below + after], axis=-1).reshape(-1, 4)
    return corners[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3).astype(np.int32)


PIECES = 8  # default number of pieces for each span between two control points

MOST_VERTICES = 16_000_000

_FLAT = 1e-12  # of the product of both tangents' lengths; shorter cross products give no normal


def bspline_surface(points: Points, lattice: Lattice, pieces: int = PIECES) -> ShadedMesh:
    """Return the surface of a net, every span cut into `pieces` × `pieces` quads of two triangles.

    points  (lattice.rows · lattice.columns, 3)

    Vertices lie on the surface; normals are the cross products of its two derivatives. Where these vanish or
    are parallel, as at a pole, the normal is the mean of the surrounding triangles. `source_vertex` is the
    control point with the largest weight.

    Raises UsageError where the surface would have more than MOST_VERTICES vertices.
    """
    across, along = _samples(lattice, pieces)
    if len(across) * len(along) > MOST_VERTICES:
        raise UsageError(
            f"a net of {lattice.rows} × {lattice.columns} points cut into {pieces} × {pieces} has "
            f"{len(across) * len(along)} vertices; {MOST_VERTICES} are the most. Lower smooth.tessellate."
        )
    net = points.reshape(lattice.rows, lattice.columns, 3)
    vertices = _blend(net, across.weights, across, along.weights, along)
    by_row = _blend(net, across.slopes, across, along.weights, along)
    by_column = _blend(net, across.weights, across, along.slopes, along)
    faces = grid_faces(len(across), len(along), lattice.closed)
    normals = _normals(TriangleMesh(vertices, faces), by_row, by_column)
    source = across.nearest[:, None] * lattice.columns + along.nearest
    return ShadedMesh(vertices, normals, faces, source.reshape(-1).astype(np.int32))


def bspline_values(values: AnyArray, lattice: Lattice, pieces: int = PIECES) -> Floats:
    """Return values (N, k) at the vertices of `bspline_surface`, blended from control points (V, k).

    Rest positions of control points give the rest positions of the vertices.
    """
    across, along = _samples(lattice, pieces)
    grid = np.asarray(values, np.float64).reshape(lattice.rows, lattice.columns, -1)
    return _blend(grid, across.weights, across, along.weights, along)


class _Samples:
    """Sample places along one direction of a net, and the weights of its points there.

    points   (M, 4) the points with a weight
    weights  (M, 4) their weights; they add up to 1
    slopes   (M, 4) the derivatives of the weights; they add up to 0
    nearest  (M,) the point with the largest weight
    """

    def __init__(self, count: int, closed: bool, pieces: int) -> None:
        spans = count if closed else count - 3
        steps = np.arange(spans * pieces + (0 if closed else 1))
        span = np.minimum(steps // pieces, spans - 1)
        t = ((steps - span * pieces) / pieces)[:, None]
        self.points = (span[:, None] + np.arange(4)) % count
        s = 1.0 - t
        middle = (3.0 * t**3 - 6.0 * t**2 + 4.0) / 6.0, (3.0 * s**3 - 6.0 * s**2 + 4.0) / 6.0
        self.weights = np.hstack([s**3 / 6.0, *middle, t**3 / 6.0])
        inner = (3.0 * t**2 - 4.0 * t) / 2.0, (4.0 * s - 3.0 * s**2) / 2.0
        self.slopes = np.hstack([-(s**2) / 2.0, *inner, t**2 / 2.0])
        self.nearest = self.points[np.arange(len(steps)), self.weights.argmax(axis=1)]

    def __len__(self) -> int:
        return len(self.points)


def _samples(lattice: Lattice, pieces: int) -> tuple[_Samples, _Samples]:
    """Return the samples along the columns of a net (from row to row), and along its rows."""
    around, across = lattice.closed
    return _Samples(lattice.rows, around, pieces), _Samples(lattice.columns, across, pieces)


def _blend(grid: Floats, row_weights: Floats, rows: _Samples, weights: Floats, columns: _Samples) -> Floats:
    """Blend a grid (R, C, k) over its rows, then over its columns: (M · N, k)."""
    over_rows = np.einsum("mi,mick->mck", row_weights, grid[rows.points])
    over_both = np.einsum("nj,mnjk->mnk", weights, over_rows[:, columns.points])
    return np.ascontiguousarray(over_both.reshape(-1, grid.shape[2]))


def _normals(mesh: TriangleMesh, by_row: Vectors, by_column: Vectors) -> Vectors:
    """Return unit normals (N, 3)."""
    normals = np.cross(by_row, by_column)
    lengths = np.linalg.norm(normals, axis=1)
    known = lengths > _FLAT * np.linalg.norm(by_row, axis=1) * np.linalg.norm(by_column, axis=1)
    normals[known] /= lengths[known, None]
    if not known.all():
        normals[~known] = vertex_normals(mesh)[~known]
    return normals
