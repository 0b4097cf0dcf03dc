"""Files of points: clouds and control nets."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flowsculpt import MeshError
from flowsculpt.api import plural, suggest
from flowsculpt.api.files import Archive, InputFile, number_fault, text_content
from flowsculpt.api.meshes import Floats, ModelFile

_POINTS = ("points", "vertices")
_ATTRIBUTE = "attribute:"

MOST_BYTES = 1 << 30  # of a file

LARGEST = 1e12
"""The limit of coordinates, as of any number in a shot file."""


class PointSet(NamedTuple):
    """points: float64 (N, 3); attributes: by name, one number a point, (N,)."""

    points: Floats
    attributes: Mapping[str, np.ndarray]


def read_points(path: str | Path) -> PointSet:
    """Read the points of a PLY, XYZ, NPZ or OBJ file, in their order.

    ply  the vertices, with their other properties as attributes
    xyz  a point a line: three numbers, separated by blanks or commas; further ones are `column_4` and so on
    npz  `points` or `vertices` (N, 3); arrays (N,) are attributes, also those named `attribute:<name>`
    obj  the vertices

    Raises MissingInputError where there is no such file, MeshError where it cannot be read, has no points, or
    points that are not finite.
    """
    path = Path(path)
    points = ModelFile(path).read_by(_READERS, "a file of points")
    if not len(points.points):
        raise MeshError(f"{path}: it has no points; a cloud needs at least one")
    if points.points.ndim != 2 or points.points.shape[1] != 3:
        raise MeshError(f"{path}: its points have shape {points.points.shape}; they must be (N, 3)")
    _require_finite(path, points.points)
    return points


def read_net(path: str | Path, columns: int | None = None) -> Floats:
    """Read the control points of a net, (rows, columns, 3).

    npz  `points` or `vertices` (rows, columns, 3), or (N, 3) with `columns`
    obj  the vertices, row by row, `columns` in each

    Raises MissingInputError where there is no such file, MeshError where it cannot be read, is no grid of
    points, or has points that are not finite.
    """
    path = Path(path)
    points = (
        ModelFile(path).read_by({name: _READERS[name] for name in ("npz", "obj")}, "a file of a net").points
    )
    if points.ndim == 3:
        if columns not in (None, points.shape[1]):
            raise MeshError(
                f"{path}: its rows have {plural(points.shape[1], 'point')}, not {columns}; leave columns out"
            )
        grid = points
    else:
        if columns is None:
            raise MeshError(f"{path}: its points are one list; write columns, the number of points in a row")
        if not len(points) or len(points) % columns:
            raise MeshError(
                f"{path}: {plural(len(points), 'point')} cannot make rows of {columns}; correct columns"
            )
        grid = points.reshape(len(points) // columns, columns, -1)
    if grid.shape[2] != 3:
        raise MeshError(f"{path}: its points have shape {points.shape}; they must be (rows, columns, 3)")
    _require_finite(path, grid)
    return grid


def _require_finite(path: Path, points: Floats) -> None:
    wrong = ~(np.abs(points) <= LARGEST).all(axis=-1)  # and so not NaN
    if wrong.any():
        first = tuple(np.argwhere(wrong)[0].tolist())
        where = f"point {first[0]}" if len(first) == 1 else f"the point in row {first[0]}, column {first[1]}"
        fault = "too large" if np.isfinite(points[first]).all() else "not finite"
        more = int(wrong.sum()) - 1
        raise MeshError(
            f"{path}: {where} is {fault} (and {more} more); coordinates must be numbers up to 1e12"
        )


_PARTED_TWICE = re.compile(rb"[-+]?\d+,\d+")
"""A number with a decimal comma, among words that blanks or semicolons separate."""


def _xyz(content: bytes) -> PointSet:
    rows: list[list[bytes]] = []
    for line, text in enumerate(text_content(content).split(b"\n"), 1):
        words = text.partition(b"#")[0].replace(b";", b" ").split()
        if not words:
            continue
        if len(words) > 1 and any(map(_PARTED_TWICE.fullmatch, words)):
            shown = b" ".join(words).decode("utf-8", "replace")[:40]
            raise ValueError(f"line {line}: {shown}: commas separate numbers, and decimals have a point")
        row = b" ".join(words).replace(b",", b" ").split()
        if len(row) < 3 or len(row) != len(rows[0] if rows else row):
            fact = f"point {len(rows)} has {plural(len(row), 'number')}"
            raise ValueError(f"{fact}; all need the same number, at least three")
        if fault := number_fault(row):
            raise ValueError(f"line {line}: {fault}")
        rows.append(row)
    table = np.array(rows, np.float64).reshape(len(rows), len(rows[0]) if rows else 3)
    columns = range(3, table.shape[1])
    return PointSet(table[:, :3].copy(), {f"column_{k + 1}": table[:, k].copy() for k in columns})


def _arrays(content: bytes) -> PointSet:
    archive = Archive(content)
    name = next((name for name in _POINTS if name in archive.names), None)
    if name is None:
        hint = suggest(_POINTS[0], sorted(archive.names)) if archive.names else "It is empty."
        raise MeshError(f"it has no array {' or '.join(_POINTS)}. {hint}")
    points = archive.array(name).astype(np.float64)
    if points.ndim not in (2, 3):
        raise MeshError(f"its {name} have shape {points.shape}; they must be (N, 3)")
    headers = {other: archive.header(other) for other in archive.names if other != name}
    one_each = [n for n, h in headers.items() if h.shape == points.shape[:1] and h.dtype.kind in "fiu"]
    return PointSet(points, {n.removeprefix(_ATTRIBUTE): archive.array(n) for n in one_each})


def _vertices(path: Path) -> PointSet:
    """Return the vertices of a file of a mesh format."""
    form = ModelFile(path).reader
    if form is None:
        raise MeshError("the plug-in that reads it is missing. Install flowsculpt again.")
    return PointSet(form.read(path).points, {}) if form.vertices is None else PointSet(*form.vertices(path))


_READERS: Mapping[str, Callable[[Path], PointSet]] = {
    "ply": _vertices,
    "xyz": lambda path: _xyz(InputFile(path, MOST_BYTES).content()),
    "npz": lambda path: _arrays(InputFile(path, MOST_BYTES).content()),
    "obj": _vertices,
}
