"""Velocities on grids in VTK's XML files: images and rectilinear grids, in one piece or several."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn
from xml.etree import ElementTree

import numpy as np

from flowsculpt import UsageError
from flowsculpt.api import shorten
from flowsculpt.api.files import InputFile
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.fields.vtk_arrays import MOST_A_BYTE, VtkFile

MAX_BYTES = 8 << 30  # memory for the samples of a field, or of a sequence


def require_size(file: Path, lengths: Iterable[int], most: int = MAX_BYTES) -> None:
    """Raise UsageError where float64 velocities on axes of these lengths take more than `most` bytes."""
    wanted = 24 * math.prod(lengths)
    if wanted > most:
        raise UsageError(f"{file}: {_size(wanted)} of velocities are too many; {_size(most)} are the most")


def _size(count: int) -> str:
    return f"{count >> 30} GiB" if count >> 30 else f"{count} bytes"


_LONGEST_AXIS = 1 << 20  # the most numbers on an axis of a rectilinear grid


SERIAL, PARALLEL = ("ImageData", "RectilinearGrid"), ("PImageData", "PRectilinearGrid")

Extent = tuple[tuple[int, int], ...]
"""First and last node of a grid along each axis."""


@dataclass(frozen=True)
class VtkGrid:
    """A grid of velocities.

    axes      three arrays, along `turn`
    velocity  (X, Y, Z, 3), along x, y and z of the world
    turn      (3, 3), its columns the directions of the axes; None where they are x, y and z
    notes     what was done to the data, for the user
    """

    axes: list[Floats]
    velocity: np.ndarray
    turn: Floats | None = None
    notes: tuple[str, ...] = ()


def read_vtk(
    file: Path, content: bytes, array: str | None = None, most: int = MAX_BYTES, components: int = 3
) -> VtkGrid:
    """Return the grid of a file, put together from its pieces; data at cells are averaged to points.

    most        bytes of the velocities; checked by the extents before anything is unpacked
    components  of the array: 3, or 1 of numbers

    Raises UsageError where it is no such file, and the errors of the parsers of its parts.
    """
    head = _Grid.of(file, content)
    grids = [_Grid.of(path, InputFile(path, most).content()) for path in head.sources] or [head]
    pieces = [(grid, piece) for grid in grids for piece in grid.pieces]
    extents = [grid.extent(piece) for grid, piece in pieces]
    if not pieces:
        head.fail("it has no pieces, and so no samples")
    whole = tuple(
        (min(extent[k][0] for extent in extents), max(extent[k][1] for extent in extents)) for k in range(3)
    )
    lengths = [last - first + 1 for first, last in whole]
    require_size(file, lengths, most)
    for (grid, piece), extent in zip(pieces, extents, strict=True):
        grid.require_room(piece, extent)
    axes = [np.full(length, np.nan) for length in lengths]
    found = [grid.velocities(piece, array, components) for grid, piece in pieces]
    at_cells = {is_cells for _, is_cells in found}
    if len(at_cells) > 1:
        head.fail("some pieces have velocities at points and others at cells")
    by_cell = at_cells == {True}
    velocity = (
        np.full((*(length - by_cell for length in lengths), components), np.nan)
        if len(pieces) > 1
        else np.empty(0)
    )
    for (grid, piece), extent, (element, _) in zip(pieces, extents, found, strict=True):
        shape = [last - first + (not by_cell) for first, last in reversed(extent)]
        values = grid.numbers(element, components * math.prod(shape))
        if values.size != components * math.prod(shape):
            what = "cells" if by_cell else "points"
            grid.fail(f"there are {values.size} numbers for {math.prod(shape)} {what} of {components} each")
        part = values.reshape(*shape, components).transpose(2, 1, 0, 3)
        starts = [first - begin for (first, _), (begin, _) in zip(extent, whole, strict=True)]
        if len(pieces) == 1:
            velocity = part.astype(np.float64)
        else:
            velocity[tuple(slice(at, at + n) for at, n in zip(starts, part.shape, strict=False))] = part
        for k, values_on in enumerate(grid.axes(piece, extent)):
            axes[k][starts[k] : starts[k] + len(values_on)] = values_on
    if len(pieces) > 1 and np.isnan(velocity).any():
        head.fail("its pieces leave gaps, or hold NaN")
    notes = (f"{file.name}: data at cells are averaged to points",) if by_cell else ()
    return VtkGrid(axes, _at_points(velocity) if by_cell else velocity, pieces[0][0].turn, notes)


def _at_points(cells: np.ndarray) -> np.ndarray:
    """Return the means of the cells around each point; at the border of those that are there."""
    for k in range(3):
        before = np.concatenate([cells.take([0], k), cells], k)
        cells = 0.5 * (before + np.concatenate([cells, cells.take([-1], k)], k))
    return cells


def arrays_of(file: Path) -> list[dict[str, Any]]:
    """Return facts about the arrays of a VTK file, as the command `data` lists variables."""
    head = _parsed(file, InputFile(file, MAX_BYTES).content()).head
    found = {}
    for place in ("points", "cells"):
        kind = "PointData" if place == "points" else "CellData"
        for data in (*head.iter(kind), *head.iter(f"P{kind}")):
            for element in data:
                name, count = element.get("Name", "?"), int(element.get("NumberOfComponents") or 1)
                facts = {"name": name, "type": element.get("type", ""), "dimensions": {"component": count}}
                found[name] = {**facts, "units": "", "meaning": f"at {place}"}
    return list(found.values())


def piece_files(file: Path) -> tuple[Path, ...]:
    """Return the files of the pieces that a parallel file names; none of others."""
    if file.suffix.lower() not in (".pvti", ".pvtr"):
        return ()
    return _Grid.of(file, InputFile(file, MAX_BYTES).content()).sources


def collection(file: Path, content: bytes) -> tuple[list[float], list[Path]]:
    """Return the times of a collection (.pvd), ascending, and the files at each. Raises UsageError."""
    head = _parsed(file, content).head
    found: dict[float, Path] = {}
    for entry in head.findall("Collection/DataSet"):
        try:
            time = float(entry.get("timestep", ""))
        except ValueError:
            time = math.nan
        if not math.isfinite(time) or not entry.get("file"):
            raise UsageError(f"{file}: a DataSet has no time or no file. Save it again from ParaView.")
        if found.setdefault(time, _beside(file, entry.get("file", ""))) != _beside(
            file, entry.get("file", "")
        ):
            raise UsageError(f"{file}: time {time:g} has several parts; a field is one. Save it as one grid.")
    if not found:
        raise UsageError(f"{file}: it lists no files. Save it again from ParaView.")
    times = sorted(found)
    return times, [found[time] for time in times]


def _beside(file: Path, name: str) -> Path:
    """Return the path of a file that another names. Raises UsageError for one outside of its folder."""
    path = Path(name)
    if path.is_absolute() or ".." in path.parts:
        raise UsageError(
            f"{file}: it names {shorten(name)}, which is not beside it. Put its files beside it."
        )
    return file.parent / path


@dataclass(frozen=True)
class _Grid:
    """The parts of a file.

    size  bytes of the file
    vtk   its elements and arrays
    """

    file: Path
    size: int
    vtk: VtkFile

    @classmethod
    def of(cls, file: Path, content: bytes) -> _Grid:
        vtk = _parsed(file, content)
        if vtk.kind not in (*SERIAL, *PARALLEL):
            fact = f"its type is {vtk.kind}; a field is ImageData or RectilinearGrid"
            remedy = (
                ". Resample it (Resample To Image) and save it as .vti" if vtk.kind.endswith("dGrid") else ""
            )
            raise UsageError(f"{file}: {fact}{remedy}")
        return cls(file, len(content), vtk)

    @property
    def sources(self) -> tuple[Path, ...]:
        """The files that a parallel one names."""
        if self.vtk.kind not in PARALLEL:
            return ()
        return tuple(_beside(self.file, piece.get("Source", "?")) for piece in self.pieces)

    @property
    def pieces(self) -> list[ElementTree.Element]:
        return self.vtk.head.findall("*/Piece")

    def fail(self, fact: str) -> NoReturn:
        raise UsageError(f"{self.file}: {fact}; save it again from VTK or ParaView, with point data")

    def extent(self, piece: ElementTree.Element) -> Extent:
        if self.vtk.kind in PARALLEL:
            self.fail("one of its pieces is a parallel file itself")
        ends = self._row(piece, "Extent", 6, None).tolist()
        if not all(end.is_integer() for end in ends) or any(ends[k] > ends[k + 1] for k in (0, 2, 4)):
            self.fail(f"Extent is {piece.get('Extent')!r} and must be 6 whole numbers, ascending in pairs")
        return tuple((int(ends[k]), int(ends[k + 1])) for k in (0, 2, 4))

    def require_room(self, piece: ElementTree.Element, extent: Extent) -> None:
        """Raise UsageError where a piece has more points than the bytes of its file can hold."""
        count = math.prod(max(1, last - first) for first, last in extent)
        if 3 * count > MOST_A_BYTE.get(self.vtk.compressor, 1) * self.size:
            self.fail(f"Extent is {piece.get('Extent')!r}, more points than {self.size} bytes can hold")

    @property
    def turn(self) -> Floats | None:
        """The directions of the axes as columns; None for those of the world."""
        image = self.vtk.head.find("ImageData")
        if image is None:
            return None
        turn = self._row(image, "Direction", 9, "1 0 0 0 1 0 0 0 1").reshape(3, 3)
        if np.array_equal(turn, np.eye(3)):
            return None
        if not np.allclose(turn.T @ turn, np.eye(3), atol=1e-6):
            self.fail("its axes (Direction) are not perpendicular to each other and of length 1")
        return turn

    def axes(self, piece: ElementTree.Element, extent: Extent) -> list[Floats]:
        """Return the axes of a piece, along the directions of the file."""
        if self.vtk.kind == "RectilinearGrid":
            named = piece.find("Coordinates")
            arrays = [] if named is None else named.findall("DataArray")
            if len(arrays) != 3:
                self.fail(f"it has {len(arrays)} axes under Coordinates instead of three")
            axes = [self.numbers(element, _LONGEST_AXIS).astype(np.float64) for element in arrays]
            for axis, (first, last) in zip(axes, extent, strict=True):
                if len(axis) != last - first + 1:
                    self.fail(f"an axis has {len(axis)} numbers, and its Extent {last - first + 1}")
            return axes
        image = self.vtk.head.find("ImageData")
        assert image is not None, "its piece was found there"
        origin, spacing = self._row(image, "Origin", 3, "0 0 0"), self._row(image, "Spacing", 3, "1 1 1")
        if self.turn is not None:
            origin = self.turn.T @ origin
        return [
            origin[k] + spacing[k] * np.arange(first, last + 1, dtype=np.float64)
            for k, (first, last) in enumerate(extent)
        ]

    def velocities(
        self, piece: ElementTree.Element, array: str | None, components: int
    ) -> tuple[ElementTree.Element, bool]:
        """Return the velocities of a piece, or its numbers, and whether they are at cells."""
        try:
            return velocity_array(piece, array, components)
        except UsageError as error:
            raise UsageError(f"{self.file}: {error}") from None

    def numbers(self, element: ElementTree.Element, most: int) -> np.ndarray:
        """Return the values of a DataArray, flat: see `VtkFile.numbers`."""
        try:
            return self.vtk.numbers(element, most)
        except UsageError as error:
            self.fail(str(error))

    def _row(self, element: ElementTree.Element, name: str, count: int, default: str | None) -> Floats:
        text = element.get(name, default)
        try:
            row = np.array((text or "").split(), np.float64)
        except ValueError:
            row = np.empty(0)
        if len(row) != count or not np.isfinite(row).all():
            self.fail(f"{name} is {text!r}; it must be {count} numbers")
        return row


def velocity_array(
    piece: ElementTree.Element, array: str | None, components: int = 3
) -> tuple[ElementTree.Element, bool]:
    """Return the array of a piece with its velocities, or its numbers, and whether they are at cells.

    Raises UsageError where there is none, or more than one.
    """
    names: list[str] = []
    wanted = array
    for place in ("PointData", "CellData"):
        data = piece.find(place)
        data = ElementTree.Element(place) if data is None else data
        vectors = [element for element in data if int(element.get("NumberOfComponents") or 1) == components]
        wanted = array or data.get("Vectors") or wanted
        matches = [element for element in vectors if wanted is None or element.get("Name") == wanted]
        if len(matches) == 1:
            return matches[0], place == "CellData"
        names += [element.get("Name", "?") for element in vectors]
    what = f"no array {shorten(wanted)} of" if wanted and wanted not in names else "not one array of"
    hint = f" There are: {', '.join(names)}." if names else ""
    count = "three components" if components == 3 else "one component"
    raise UsageError(f"there is {what} {count} at its points or cells.{hint}")


def _parsed(file: Path, content: bytes) -> VtkFile:
    try:
        return VtkFile.of(content)
    except UsageError as error:
        raise UsageError(f"{file}: {error}") from None
