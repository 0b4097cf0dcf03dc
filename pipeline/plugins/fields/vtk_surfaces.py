"""Surfaces of VTK's XML files: polygons (`.vtp`), the skin of grids of cells (`.vtu`), and both over time.

A file with a `p` before its suffix (`.pvtp`, `.pvtu`) names the files of its pieces, and a `.pvd` the files
of times. Points that pieces share are one in grids, so that no skin lies between pieces.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path, PurePosixPath
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from flowsculpt import MeshError, UsageError
from flowsculpt.api import plural, quote, shorten, suggest
from flowsculpt.api.files import InputFile
from flowsculpt.api.meshes import FileSurface, Floats, ModelFile, SourceFiles, SurfaceReader, find_coincident
from flowsculpt.pipeline.plugins.fields.vtk_arrays import VtkFile
from flowsculpt.pipeline.plugins.fields.vtk_cells import POLYHEDRON, Cells, Faces, faces_of_streams

_LARGEST = 1 << 30
"""Size of the largest file, bytes."""

_MOST = 1 << 28
"""Most points, cells, and corners of cells of a piece."""

_KINDS = {"vtp": "PolyData", "vtu": "UnstructuredGrid"}

_VELOCITIES = ("velocities", "velocity", "vel", "v")
"""Names of velocities, in small or capital letters; and `U`, as OpenFOAM has it."""

_NORMALS = ("normals", "normal", "n")


class _Part(NamedTuple):
    """A piece of a file.

    points      (V, 3)
    cells       its cells
    velocities  (V, 3); None where it has none
    normals     (V, 3); None where it has none
    """

    points: Floats
    cells: Cells
    velocities: Floats | None
    normals: Floats | None


def read_surface(path: Path) -> FileSurface:
    """Read the faces of a file, or of those that it names: of a `.pvd` at its first time.

    Raises MeshError where they cannot be read, MissingInputError where one is not there.
    """
    return surface_of(_first_files(path), path)


def source_files(path: Path) -> SourceFiles:
    """Return the files that a surface is read from. Raises as `read_surface`."""
    return SourceFiles.of(files_and_digests(path, _first_files(path)))


def files_and_digests(path: Path, pieces: Iterable[Path]) -> list[tuple[Path, str]]:
    """Return a file and those of pieces, each once, and their digests.

    Pieces are read again only once they have changed. Raises MissingInputError where a file is not there.
    """
    found = {path: InputFile(path, _LARGEST).digest()}
    for piece in pieces:
        if piece not in found:
            found[piece] = ModelFile(piece).files(keeps_digest=True).digest
    return list(found.items())


def _first_files(path: Path) -> list[Path]:
    """Return the files that hold the pieces of a surface."""
    return collection(path)[0][1] if path.suffix.lower() == ".pvd" else pieces_of(path)


def pieces_of(path: Path) -> list[Path]:
    """Return the files with the pieces of a surface: of a `.pvtp` or `.pvtu` those that it names."""
    suffix = path.suffix.lower().lstrip(".")
    if suffix in _KINDS:
        return [path]
    if suffix.removeprefix("p") not in _KINDS:
        known = ", ".join(f".{known}" for known in (*_KINDS, *(f"p{known}" for known in _KINDS)))
        raise MeshError(f"it names {path.name}; surfaces are read from {known}. Save it as one of these.")
    sources = [piece.get("Source") for piece in _opened(path).head.findall("*/Piece")]
    return [named(path, source, suffix[1:]) for source in sources]


def collection(path: Path) -> list[tuple[float, list[Path]]]:
    """Return the times of a `.pvd`, ascending, and the files of the pieces at each.

    Raises MeshError where there are none, or a time is not a number.
    """
    found: dict[float, list[Path]] = {}
    for entry in _opened(path).head.findall("Collection/DataSet"):
        text = entry.get("timestep", "0")
        try:
            time = float(text)
        except ValueError:
            time = math.nan
        if not math.isfinite(time):
            raise MeshError(f"timestep {shorten(text)!r} is not a number. Correct it.")
        files = found.setdefault(time, [])
        files += [file for file in pieces_of(named(path, entry.get("file"))) if file not in files]
    if not found:
        raise MeshError("it names no files (DataSet). Save it again.")
    return sorted(found.items())


def named(path: Path, name: str | None, suffix: str = "") -> Path:
    """Return the file that another one names, relative to it. Raises MeshError for other addresses."""
    name = (name or "").replace("\\", "/")
    if not name or PurePosixPath(name).is_absolute() or ":" in name.partition("/")[0]:
        raise MeshError(f"it names the file {shorten(name)!r}; write names relative to its own folder.")
    if suffix and not name.lower().endswith(f".{suffix}"):
        raise MeshError(f"it names the file {shorten(name)!r}, which is not a .{suffix}.")
    return path.parent / name


def surface_of(files: Sequence[Path], path: Path) -> FileSurface:
    """Return the surface of all pieces in some files, which are those of the file `path`."""
    parts = list[_Part]()
    for file in files:
        try:
            parts += _parts(file)
        except (MeshError, UsageError, ValueError) as error:
            place = "" if file == path else f"{file.name}: "
            words = str(error).rstrip(".")
            raise MeshError(f"{place}{words}. Save it again, from VTK or ParaView.") from None
    cells = Cells.joined([part.cells for part in parts], [len(part.points) for part in parts])
    points = np.concatenate([np.empty((0, 3)), *(part.points for part in parts)])
    if len(parts) > 1:
        cells = _merged(points, cells)
    faces = cells.skin(points)
    thin = [f"{plural(count, kind)} left out" for count, kind in cells.thin]
    surface = FileSurface.of(points, faces.corners, sides=faces.sides, notes=tuple(thin))
    return surface._replace(
        base=0 if len(parts) == 1 else None,
        velocities=_all([part.velocities for part in parts]),
        normals=_all([part.normals for part in parts]),
        numbers=partial(_numbers, tuple(files)),
    )


def _numbers(files: Sequence[Path], name: str) -> Floats:
    """Return an array of numbers (V,) at the points of all pieces; data at cells are averaged to points.

    Raises MeshError for a name that is none.
    """
    found, names = list[Floats](), set[str]()
    for file in files:
        vtk = _opened(file)
        for piece in vtk.head.findall(f"{vtk.kind}/Piece"):
            given = _Piece(vtk, piece)
            names |= given.number_names
            values = given.numbers(name) if name in given.number_names else None
            found += [] if values is None else [values]
            if values is None:
                raise MeshError(
                    f"{file.name}: it has no numbers {quote(name)}. {suggest(name, sorted(names))}"
                )
    return np.concatenate(found)


def _merged(points: Floats, cells: Cells) -> Cells:
    """Return cells of several pieces, in which points at one place are one."""
    used = np.zeros(len(points), bool)
    used[cells.points] = True
    first = find_coincident(points, used)
    polyhedra = cells.polyhedra._replace(corners=first[cells.polyhedra.corners])
    return cells._replace(points=first[cells.points], polyhedra=polyhedra)


def _all(values: Sequence[Floats | None]) -> Floats | None:
    """Return values of all pieces; None where one has none."""
    present = [rows for rows in values if rows is not None]
    return np.concatenate(present) if present and len(present) == len(values) else None


def _parts(path: Path) -> Iterator[_Part]:
    """Yield the pieces of a file."""
    vtk, kind = _opened(path), _KINDS[path.suffix.lower()[1:]]
    if vtk.kind != kind:
        raise MeshError(f"its type is {vtk.kind}, not {kind}")
    for number, piece in enumerate(vtk.head.findall(f"{kind}/Piece")):
        try:
            yield _Piece(vtk, piece).part()
        except (MeshError, UsageError) as error:
            raise MeshError(f"piece {number}: {error}") from None


def _opened(path: Path) -> VtkFile:
    try:
        return VtkFile.of(InputFile(path, _LARGEST).content())
    except UsageError as error:
        raise MeshError(str(error)) from None


class _Piece(NamedTuple):
    """A piece of a file, whose arrays are read when asked for."""

    vtk: VtkFile
    piece: Element

    def part(self) -> _Part:
        """Read the piece. Raises MeshError or UsageError."""
        count = self._count("NumberOfPoints")
        points = self._array("Points", "", 3 * count).reshape(-1, 3).astype(np.float64)
        cells = self._polygons() if self.vtk.kind == "PolyData" else self._cells()
        cells.require_faces_or_none(count)
        size = len(cells.types)
        ghosts = self._named("CellData", ("vtkghosttype",), size, 1)
        if ghosts is not None:
            cells = cells._replace(shown=ghosts[:, 0] == 0)
        velocities = self._named("PointData", _VELOCITIES, count, 3)
        if velocities is None:
            of_cells = self._named("CellData", _VELOCITIES, size, 3)
            velocities = None if of_cells is None else cells.means(of_cells, count)
        return _Part(points, cells, velocities, self._named("PointData", _NORMALS, count, 3))

    @property
    def number_names(self) -> set[str]:
        """The names of its arrays of one component, at points or cells."""
        arrays = [
            each for place in ("PointData", "CellData") for each in self.piece.findall(f"{place}/DataArray")
        ]
        single = [each for each in arrays if int(each.get("NumberOfComponents") or 1) == 1]
        return {each.get("Name", "") for each in single} - {"vtkGhostType"}

    def numbers(self, name: str) -> Floats:
        """Return an array of one component (V,) at points; data at cells are averaged to points."""
        count = self._count("NumberOfPoints")
        found = self._named("PointData", (name.lower(),), count, 1)
        if found is None:
            cells = self._polygons() if self.vtk.kind == "PolyData" else self._cells()
            of_cells = self._named("CellData", (name.lower(),), len(cells.types), 1)
            assert of_cells is not None, "its names are known"
            found = cells.means(of_cells, count)
        return found[:, 0]

    def _count(self, name: str) -> int:
        text = self.piece.get(name, "0").strip()
        if not text.isdecimal() or int(text) > _MOST:
            raise MeshError(f"{name} is {shorten(text)!r}; it must be a number up to {_MOST}")
        return int(text)

    def _array(self, section: str, name: str, size: int | None) -> np.ndarray:
        """Return an array of a section, flat; the first one if `name` is empty.

        Raises MeshError where it is not there, or has another size; None is any size.
        """
        arrays = self.piece.findall(f"{section}/DataArray")
        chosen = [array for array in arrays if not name or array.get("Name") == name]
        if not chosen and size:
            raise MeshError(f"it has no array {name or 'of points'} in {section}")
        values = self.vtk.numbers(chosen[0], _MOST if size is None else size) if chosen else np.empty(0)
        if size is not None and len(values) != size:
            raise MeshError(f"array {name or 'of points'} in {section} has {len(values)} numbers, not {size}")
        return values if values.dtype.kind == "f" and not name else values.astype(np.int64)

    def _named(self, section: str, names: tuple[str, ...], count: int, width: int) -> np.ndarray | None:
        """Return the rows (count, width) of the first array with one of some names; None if there is none."""
        for array in self.piece.findall(f"{section}/DataArray"):
            name = array.get("Name", "")
            is_named = name.lower() in names or (name == "U" and names is _VELOCITIES)
            if is_named and int(array.get("NumberOfComponents") or 1) == width:
                values = self.vtk.numbers(array, width * count)
                if len(values) != width * count:
                    raise MeshError(f"array {name} has {len(values)} numbers, not {width * count}")
                return values.reshape(count, width).astype(np.float64)
        return None

    def _runs(self, section: str, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return where the points of each cell of a section begin, and the last end (N + 1,), and points."""
        starts = np.concatenate([[0], self._array(section, "offsets", count)]).astype(np.int64)
        if (np.diff(starts) < 0).any() or starts[-1] > _MOST:
            raise MeshError(f"offsets in {section} do not ascend, or go beyond {_MOST}")
        return starts, self._array(section, "connectivity", int(starts[-1]))

    def _polygons(self) -> Cells:
        """Return the cells of polygonal data, in the order in which cells have data."""
        types, starts, points = list[np.ndarray](), [np.zeros(1, np.int64)], list[np.ndarray]()
        for section, kind in (("Verts", 2), ("Lines", 4), ("Polys", 7), ("Strips", 6)):
            own, corners = self._runs(section, self._count(f"NumberOf{section}"))
            types.append(np.full(len(own) - 1, kind))
            starts.append(own[1:] + sum(map(len, points)))
            points.append(corners)
        kinds, places, corners = (np.concatenate(values) for values in (types, starts, points))
        shown = np.ones(len(kinds), bool)
        return Cells(kinds, places, corners.astype(np.int64), Faces.joined([]), shown)

    def _cells(self) -> Cells:
        """Return the cells of an unstructured grid."""
        count = self._count("NumberOfCells")
        types, (starts, points) = self._array("Cells", "types", count), self._runs("Cells", count)
        polyhedra = self._polyhedra(count) if (types == POLYHEDRON).any() else Faces.joined([])
        return Cells(types, starts, points, polyhedra, np.ones(count, bool))

    def _polyhedra(self, count: int) -> Faces:
        """Return the faces of polyhedra, as files of VTK from 9.4 on have them, or older ones."""
        if self.piece.find("Cells/DataArray[@Name='faceoffsets']") is not None:
            ends = self._array("Cells", "faceoffsets", count)
            streams = self._array("Cells", "faces", min(int(ends.max(initial=0)), _MOST))
            return faces_of_streams(streams, ends)
        of_cells = np.diff(self._array("Cells", "polyhedron_offsets", count), prepend=0)
        if (of_cells < 0).any() or of_cells.sum() > _MOST:
            raise MeshError(f"polyhedron_offsets do not ascend, or go beyond {_MOST}")
        chosen = self._array("Cells", "polyhedron_to_faces", int(of_cells.sum()))
        ends = self._array("Cells", "face_offsets", None)
        corners, sides = self._array("Cells", "face_connectivity", None), np.diff(ends, prepend=0)
        if (sides < 3).any() or sides.sum() != len(corners):
            raise MeshError("face_offsets do not ascend, or do not fit face_connectivity")
        if ((chosen < 0) | (chosen >= len(ends))).any():
            raise MeshError(f"polyhedron_to_faces names a face that is not there; there are {len(ends)}")
        rows = np.repeat(ends[chosen] - sides[chosen], sides[chosen])
        first = np.repeat(np.cumsum(sides[chosen]) - sides[chosen], sides[chosen])
        own = corners[rows + np.arange(len(rows)) - first]
        return Faces(sides[chosen], own, np.repeat(np.arange(count), of_cells))


VTK = SurfaceReader(read_surface)
"""The reader of `.vtp` and `.vtu`."""

VTK_OF_FILES = SurfaceReader(read_surface, source_files)
"""The reader of `.pvtp`, `.pvtu` and `.pvd`."""
