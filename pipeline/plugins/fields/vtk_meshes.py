"""Velocities and numbers at the points of VTK's meshes (`.vtu`) and bent grids (`.vts`), put on even grids.

Cells are cut into tetrahedra, and those of flat data into triangles, in which they are linear.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from flowsculpt import MeshError, UsageError
from flowsculpt.api import shorten
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.fields.grid_layout import FAR
from flowsculpt.pipeline.plugins.fields.simplex_resampling import EvenGrid, shares_of, spread
from flowsculpt.pipeline.plugins.fields.vtk_arrays import MOST_A_BYTE, VtkFile
from flowsculpt.pipeline.plugins.fields.vtk_cells import Cells, Faces
from flowsculpt.pipeline.plugins.fields.vtk_grids import VtkGrid, velocity_array

RESAMPLED = (".vtu", ".vts")
"""Suffixes of files whose velocities are put on an even grid."""

FINER = 1.5
"""Nodes of the grid along a side, over those that as many points in an even grid would have."""

LARGEST = 256
"""The most nodes along the longest side, where a shot names no number."""

_FLAT = 1e-6  # extent across a plane, over the largest, up to which points are in it
_MOST = 1 << 27  # points and corners of cells

_TETRAHEDRA = {
    10: ((0, 1, 2, 3),),
    11: tuple((0, *pair, 7) for pair in ((1, 3), (3, 2), (2, 6), (6, 4), (4, 5), (5, 1))),
    12: tuple((0, *pair, 6) for pair in ((1, 2), (2, 3), (3, 7), (7, 4), (4, 5), (5, 1))),
    13: ((0, 1, 2, 5), (0, 1, 5, 4), (0, 4, 5, 3)),
    14: ((0, 1, 2, 4), (0, 2, 3, 4)),
}
_TRIANGLES = {5: ((0, 1, 2),), 8: ((0, 1, 3), (0, 3, 2)), 9: ((0, 1, 2), (0, 2, 3))}
_CORNERS = {5: 3, 8: 4, 9: 4, 10: 4, 11: 8, 12: 8, 13: 6, 14: 5}


class _Mesh(NamedTuple):
    """Points (N, 3), their velocities (N, 3) or numbers (N, 1), and simplices (S, 4); (S, 3) of flat data."""

    points: Floats
    velocity: Floats
    simplices: np.ndarray


def read_resampled(
    file: Path, content: bytes, array: str | None, resolution: int | None, components: int = 3
) -> VtkGrid:
    """Return the velocities of a file on an even grid around its points; outside of its cells they are 0.

    resolution  nodes along the longest side; None: about as fine as the points
    components  1 for numbers (X, Y, Z, 1), which are NaN outside of the cells

    Raises UsageError where it is no such file, has no cells, or its cells are of kinds that are not read.
    """
    try:
        mesh = _read(VtkFile.of(content), len(content), array, components)
    except (MeshError, UsageError) as error:
        raise UsageError(f"{file}: {str(error).rstrip('.')}. Save it again from VTK or ParaView.") from None
    width = mesh.simplices.shape[1] - 1
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    inside = np.sort(np.argsort(high - low)[3 - width :])  # the axes that the points extend along
    points = np.ascontiguousarray(mesh.points[:, inside])
    size = high[inside] - low[inside]
    longest = resolution or _usual(size, len(points))
    try:
        grid = EvenGrid.around(low[inside], high[inside], longest)
    except UsageError as error:
        raise UsageError(f"{file}: {error}") from None
    digest = hashlib.sha256(points.tobytes() + mesh.simplices.tobytes()).hexdigest()
    shares = shares_of(points, mesh.simplices, grid, digest)
    count = math.prod(grid.shape)
    numbers = spread(shares.of(mesh.velocity.astype(np.float32), count).reshape(*grid.shape, components))
    lacking, velocity = np.isnan(numbers[..., :1]).astype(np.float32), np.nan_to_num(numbers)
    outside = 1.0 - len(shares.nodes) / count
    own = grid.interpolated(lacking, points)[:, 0] < 1e-6
    difference = grid.interpolated(velocity, points)[own] - mesh.velocity[own]
    scale = float((mesh.velocity[own] ** 2).sum())
    off = math.sqrt(float((difference**2).sum()) / scale) if scale else 0.0
    shape = " × ".join(map(str, grid.shape))
    what = "velocities" if components == 3 else str(array)
    notes = [
        f"{file.name}: its {len(points):,} points are read on an even grid of {shape} nodes; {what} at its "
        f"own points differ by {100.0 * off:.2g}% (rms), which a higher resolution makes less"
    ]
    if outside > 0.01 and components == 3:
        notes.append(
            f"{file.name}: {outside:.0%} of the box around it is outside of its cells, and has no velocity"
        )
    shown = velocity if components == 3 else numbers
    axes, velocity = _in_space(grid, inside.tolist(), shown, low, float(size.max()))
    return VtkGrid(axes, velocity.astype(np.float64), None, tuple(notes))


def _usual(size: Floats, count: int) -> int:
    """Return the nodes along the longest side of a grid that is FINER than `count` points in it."""
    step = float(np.prod(size) / count) ** (1.0 / len(size))
    return max(2, min(LARGEST, round(FINER * float(size.max()) / step)))


def _in_space(
    grid: EvenGrid, inside: list[int], velocity: np.ndarray, low: Floats, longest: float
) -> tuple[list[Floats], np.ndarray]:
    """Return three axes and values (X, Y, Z, W); along an axis that flat data lack they are the same."""
    given = dict(zip(inside, grid.axes, strict=True))
    axes = []
    for k in range(3):
        if k in given:
            axes.append(given[k])
            continue
        axes.append(low[k] + FAR * longest * np.array([-1.0, 1.0]))
        velocity = np.repeat(np.expand_dims(velocity, k), 2, axis=k)
    return axes, velocity


def _read(vtk: VtkFile, size: int, array: str | None, components: int) -> _Mesh:
    if vtk.kind not in ("UnstructuredGrid", "StructuredGrid"):
        raise UsageError(f"its type is {vtk.kind}; it must be UnstructuredGrid or StructuredGrid")
    pieces = vtk.head.findall(f"{vtk.kind}/Piece")
    if not pieces:
        raise UsageError("it has no pieces, and so no samples")
    read = [_piece(vtk, piece, size, array, components) for piece in pieces]
    starts = np.cumsum([0, *(len(points) for points, _, _ in read)])
    points = np.concatenate([part for part, _, _ in read])
    velocity = np.concatenate([part for _, part, _ in read])
    if not (np.isfinite(points).all() and np.isfinite(velocity).all()):
        raise UsageError("its points or its array are not all finite numbers. Fill the gaps with zeros")
    solid = [cells[0] + first for (_, _, cells), first in zip(read, starts, strict=False)]
    flat = [cells[1] + first for (_, _, cells), first in zip(read, starts, strict=False)]
    tetrahedra, triangles = np.concatenate(solid), np.concatenate(flat)
    if len(tetrahedra):
        return _Mesh(points, velocity, tetrahedra)
    if not len(triangles):
        raise UsageError("it has no cells with an area or a volume, so nothing is between its points")
    extent = np.ptp(points, axis=0)
    if extent.min() > _FLAT * extent.max():
        raise UsageError(
            "its cells are faces that are not in one plane along two axes, so nothing is between them"
        )
    return _Mesh(points, velocity, triangles)


def _piece(
    vtk: VtkFile, piece: Element, size: int, array: str | None, components: int
) -> tuple[Floats, Floats, tuple[np.ndarray, np.ndarray]]:
    """Return points, velocities at them, and tetrahedra and triangles of a piece."""
    shape = _shape(piece) if vtk.kind == "StructuredGrid" else None
    count = math.prod(shape) if shape else _count(piece, "NumberOfPoints")
    if 3 * count > MOST_A_BYTE.get(vtk.compressor, 1) * size:
        raise UsageError(f"it says that it has {count} points, more than {size} bytes can hold")
    points = _numbers(vtk, piece.find("Points/DataArray"), 3 * count, "points").reshape(-1, 3)
    element, is_cells = velocity_array(piece, array, components)
    cells = _grid_cells(shape) if shape else _mesh_cells(vtk, piece)
    cells.require_faces_or_none(count)
    rows, what = len(cells.types) if is_cells else count, "velocities" if components == 3 else str(array)
    values = _numbers(vtk, element, components * rows, what).reshape(-1, components)
    velocity = cells.means(values, count) if is_cells else values
    return points, velocity, (_simplices(cells, _TETRAHEDRA, 4), _simplices(cells, _TRIANGLES, 3))


def _simplices(cells: Cells, tables: Mapping[int, tuple[tuple[int, ...], ...]], width: int) -> np.ndarray:
    """Return the corners (S, width) of the parts of cells of some types."""
    parts = [np.empty((0, width), np.int64)]
    for kind, table in tables.items():
        chosen = np.flatnonzero(cells.types == kind)
        rows = cells.points[cells.starts[chosen][:, None] + np.arange(_CORNERS[kind])]
        parts += [rows[:, list(part)] for part in table]
    return np.concatenate(parts)


def _shape(piece: Element) -> tuple[int, int, int]:
    """Return the numbers of points of a bent grid along its axes."""
    text = piece.get("Extent", "")
    try:
        ends = [int(part) for part in text.split()]
    except ValueError:
        ends = []
    if len(ends) != 6 or any(ends[k] > ends[k + 1] for k in (0, 2, 4)):
        raise UsageError(f"Extent is {shorten(text)!r} and must be 6 whole numbers, ascending in pairs")
    return ends[1] - ends[0] + 1, ends[3] - ends[2] + 1, ends[5] - ends[4] + 1


def _grid_cells(shape: tuple[int, int, int]) -> Cells:
    """Return the cells of a bent grid: hexahedra, or quadrangles where it has one layer."""
    numbers = np.arange(math.prod(shape)).reshape(shape[::-1]).transpose(2, 1, 0)  # by x, y and z
    long = [k for k in range(3) if shape[k] > 1]
    if len(long) < 2:
        raise UsageError("its points are a line, so they hold no velocities in space")
    offsets = [(0, 0), (1, 0), (1, 1), (0, 1)]
    corners = [(i, j, k) for k in (0, 1) for i, j in offsets] if len(long) == 3 else offsets
    parts = []
    for corner in corners:
        place: list[slice] = [slice(None)] * 3
        for axis, step in zip(long, corner, strict=True):
            place[axis] = slice(1, None) if step else slice(None, -1)
        parts.append(numbers[tuple(place)].transpose(2, 1, 0).ravel())
    points = np.stack(parts, axis=1)
    many, width = points.shape
    types = np.full(many, 12 if width == 8 else 9)
    return Cells(types, width * np.arange(many + 1), points.ravel(), Faces.joined([]), np.ones(many, bool))


def _mesh_cells(vtk: VtkFile, piece: Element) -> Cells:
    """Return the cells of a mesh. Raises UsageError for kinds that are not read."""
    count = _count(piece, "NumberOfCells")
    named = {each.get("Name"): each for each in piece.findall("Cells/DataArray")}
    types = _numbers(vtk, named.get("types"), count, "types of cells").astype(np.int64)
    known = np.isin(types, [0, 1, 2, 3, 4, *_TRIANGLES, *_TETRAHEDRA])
    if not known.all():
        cell = int(np.argmin(known))
        raise UsageError(
            f"cell {cell} has VTK's type {types[cell]}; tetrahedra, voxels, hexahedra, wedges, pyramids, and "
            "flat triangles and quadrangles are read. Cut the others by ParaView's filter Tetrahedralize"
        )
    ends = _numbers(vtk, named.get("offsets"), count, "offsets").astype(np.int64)
    starts = np.concatenate([[0], ends])
    if (np.diff(starts) < 0).any() or starts[-1] > _MOST:
        raise UsageError(f"offsets of its cells do not ascend, or go beyond {_MOST}")
    points = _numbers(vtk, named.get("connectivity"), int(starts[-1]), "connectivity").astype(np.int64)
    return Cells(types, starts, points, Faces.joined([]), np.ones(count, bool))


def _count(piece: Element, name: str) -> int:
    text = piece.get(name, "0").strip()
    if not text.isdecimal() or int(text) > _MOST:
        raise UsageError(f"{name} is {shorten(text)!r}; it must be a number up to {_MOST}")
    return int(text)


def _numbers(vtk: VtkFile, element: Element | None, count: int, what: str) -> np.ndarray:
    """Return the numbers of an array. Raises UsageError where they are not so many."""
    values = np.empty(0) if element is None else vtk.numbers(element, count)
    if len(values) != count:
        raise UsageError(f"it has {len(values)} numbers of {what}, and needs {count}")
    return values.astype(np.float64)
