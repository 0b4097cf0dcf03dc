"""Velocities on a grid, read from one file or from a sequence of files."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn
from xml.etree import ElementTree

import numpy as np

from flowsculpt import FlowsculptError, UsageError
from flowsculpt.api import shorten, suggest
from flowsculpt.api.files import Archive, InputFile
from flowsculpt.api.flows import Samples
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


NAMES = ("x", "y", "z", "t", "velocity")


def read_npz(
    file: Path, content: bytes, most: int = MAX_BYTES
) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Return arrays x, y, z; times; and velocity (T, X, Y, Z, 3), (X, Y, Z, 3) in a file without t.

    most  bytes of all arrays as float64; checked by their headers before anything is unpacked

    Raises UsageError where an array is missing or they are too large, and the errors of zipfile and numpy.
    """
    archive = Archive(content)
    missing = [name for name in NAMES if name != "t" and name not in archive.names]
    if missing:
        hint = suggest(missing[0], sorted(archive.names)) if archive.names else "It is empty."
        raise UsageError(f"{file}: array {missing[0]} is missing; a field has x, y, z and velocity. {hint}")
    names = [name for name in NAMES if name in archive.names]
    headers = [archive.header(name) for name in names]
    wide = (math.prod(header.shape) * max(1, -(-header.dtype.itemsize // 8)) for header in headers)
    require_size(file, [-(-sum(wide) // 3)], most)
    arrays = {name: archive.array(name) for name in names}
    axes, velocity = [arrays[name] for name in "xyz"], arrays["velocity"]
    return (axes, arrays["t"], velocity) if "t" in arrays else (axes, np.zeros(1), velocity[None])


_LONGEST_AXIS = 1 << 20  # the most numbers on an axis of a rectilinear grid


def read_vtk(
    file: Path, content: bytes, array: str | None = None, most: int = MAX_BYTES
) -> tuple[list[Floats], Floats]:
    """Return three axes, and velocities (1, X, Y, Z, 3), of a file in one piece with point data.

    most  bytes of the velocities; checked by the extent before anything is unpacked

    Raises UsageError where it is no such file, and the errors of the parsers of its parts.
    """
    grid = _Grid.of(file, content)
    axes = grid.axes(most)
    shape = tuple(len(axis) for axis in reversed(axes))
    require_size(file, shape, most)
    count = math.prod(shape)
    values = grid.numbers(grid.velocities(array), 3 * count)
    if values.size != 3 * count:
        grid.fail(f"there are {values.size} numbers for {count} points of three components each")
    return axes, values.astype(np.float64).reshape(1, *shape, 3).transpose(0, 3, 2, 1, 4)


@dataclass(frozen=True)
class _Grid:
    """The parts of a file.

    size   bytes of the file
    vtk    its elements and arrays
    piece  the only piece
    """

    file: Path
    size: int
    vtk: VtkFile
    piece: ElementTree.Element

    @classmethod
    def of(cls, file: Path, content: bytes) -> _Grid:
        try:
            vtk = VtkFile.of(content)
        except UsageError as error:
            raise UsageError(f"{file}: {error}") from None
        pieces = vtk.head.findall("*/Piece")
        if vtk.kind not in ("ImageData", "RectilinearGrid"):
            fact = f"its type is {vtk.kind}; a field is ImageData or RectilinearGrid"
            raise UsageError(f"{file}: {fact}")
        if len(pieces) != 1:
            fact = f"it has {len(pieces)} pieces; a field is read from one. Save it as one."
            raise UsageError(f"{file}: {fact}")
        return cls(file, len(content), vtk, pieces[0])

    def fail(self, fact: str) -> NoReturn:
        raise UsageError(f"{self.file}: {fact}; save it again from VTK or ParaView, with point data")

    def axes(self, most: int) -> list[Floats]:
        if self.vtk.kind == "RectilinearGrid":
            named = self.piece.find("Coordinates")
            arrays = [] if named is None else named.findall("DataArray")
            if len(arrays) != 3:
                self.fail(f"it has {len(arrays)} axes under Coordinates instead of three")
            return [self.numbers(element, _LONGEST_AXIS).astype(np.float64) for element in arrays]
        image = self.vtk.head.find("ImageData")
        assert image is not None, "its piece was found there"
        extent = self._row(self.piece, "Extent", 6, None).tolist()
        if not all(end.is_integer() for end in extent):
            self.fail(f"Extent is {self.piece.get('Extent')!r} and must be 6 whole numbers")
        ends = [(int(extent[k]), int(extent[k + 1]) + 1) for k in (0, 2, 4)]
        lengths = [max(1, end - begin) for begin, end in ends]
        require_size(self.file, lengths, most)
        if 3 * math.prod(lengths) > MOST_A_BYTE.get(self.vtk.compressor, 1) * self.size:
            self.fail(f"Extent is {self.piece.get('Extent')!r}, more points than {self.size} bytes can hold")
        origin, spacing = self._row(image, "Origin", 3, "0 0 0"), self._row(image, "Spacing", 3, "1 1 1")
        direction = self._row(image, "Direction", 9, "1 0 0 0 1 0 0 0 1")
        if not np.array_equal(direction, np.eye(3).ravel()):
            self.fail("its axes are rotated (Direction), and only grids along x, y and z are read")
        return [origin[k] + spacing[k] * np.arange(*ends[k], dtype=np.float64) for k in range(3)]

    def velocities(self, array: str | None) -> ElementTree.Element:
        data = self.piece.find("PointData")
        data = ElementTree.Element("PointData") if data is None else data
        vectors = [element for element in data if element.get("NumberOfComponents") == "3"]
        wanted = array or data.get("Vectors")
        matches = [element for element in vectors if wanted is None or element.get("Name") == wanted]
        if len(matches) != 1:
            names = [element.get("Name", "?") for element in vectors]
            what = f"no array {shorten(wanted)} of" if wanted and not matches else "not one array of"
            hint = f" There are: {', '.join(names)}." if names else ""
            raise UsageError(f"{self.file}: there is {what} three components at its points.{hint}")
        return matches[0]

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


FORMATS = (".vti", ".vtr", ".npz")

MAX_SPEED = 1e12  # the limit of any number in a shot file: squares and sums of such numbers stay finite


def read_samples(files: tuple[Path, ...], array: str | None = None, interval: float = 1.0) -> Samples:
    """Return the samples of one file, or of a sequence of files `interval` seconds apart.

    array  the name of the velocities in VTK files; None: the file's active vectors, or its only array

    The digests are of the same bytes that are parsed. The last samples stay in memory: as long as the
    contents of their files do not change, they are not parsed again.

    Raises MissingInputError where a file is missing, UsageError where it is invalid.
    """
    request = (files, array, interval)
    for known, samples in list(_LAST.items()):  # another thread may replace them
        if known == request and all(map(_is_unchanged, files, samples.digests)):
            return samples
    _LAST.clear()  # before others take as much memory
    _LAST[request] = samples = _read(files, array, interval)
    return samples


_LAST: dict[tuple[tuple[Path, ...], str | None, float], Samples] = {}


def _is_unchanged(file: Path, digest: str) -> bool:
    return hashlib.sha256(InputFile(file, MAX_BYTES).content()).hexdigest() == digest


def _read(files: tuple[Path, ...], array: str | None, interval: float) -> Samples:
    axes, times, first, digest = _read_file(files[0], array)
    digests, velocity = [digest], first
    if len(files) > 1:
        _require_one_time(files[0], first)
        require_size(files[0], (len(files), *first.shape[1:-1]), MAX_BYTES)
        times = np.asarray(interval * np.arange(len(files)), np.float64)
        velocity = np.empty((len(files), *first.shape[1:]))
        velocity[0] = first[0]
    for k, file in enumerate(files[1:], 1):
        others, _, part, digest = _read_file(file, array)
        if part.shape[1:] != first.shape[1:] or any(map(_differ, axes, others)):
            fact = f"its grid differs from that of {files[0].name}"
            raise UsageError(f"{file}: {fact}; all files of a sequence share one grid")
        _require_one_time(file, part)
        velocity[k] = part[0]
        digests.append(digest)
    return Samples(axes, times, velocity, tuple(digests), array, interval)


def _read_file(file: Path, array: str | None) -> tuple[tuple[Floats, Floats, Floats], Floats, Floats, str]:
    """Return axes, times and velocities of a file, and the digest of the parsed bytes."""
    if file.suffix.lower() not in FORMATS:
        raise UsageError(
            f"{file}: {file.suffix or 'no suffix'} is not a format of fields; use {', '.join(FORMATS)}"
        )
    content, times, is_npz = InputFile(file, MAX_BYTES).content(), np.zeros(1), file.suffix.lower() == ".npz"
    if is_npz and array is not None:
        raise UsageError(
            f"{file}: array {array} does not apply; in .npz the array is velocity. Leave out array."
        )
    kind = "an archive of arrays, as numpy.savez writes" if is_npz else "a grid, as VTK and ParaView write"
    with reading(file, f"{kind} one"):
        if is_npz:
            axes, times, velocity = read_npz(file, content)
        else:
            axes, velocity = read_vtk(file, content, array)
        require_valid(file, axes, times, velocity)
    x, y, z = (np.ascontiguousarray(axis, np.float64) for axis in axes)
    velocity, times = np.ascontiguousarray(velocity, np.float64), np.asarray(times, np.float64)
    return (x, y, z), times, velocity, hashlib.sha256(content).hexdigest()


def _require_one_time(file: Path, velocity: Floats) -> None:
    if len(velocity) > 1:
        raise UsageError(f"{file}: it has several times; a sequence has one per file. Name one file.")


def _differ(one: Floats, other: Floats) -> bool:
    return len(one) != len(other) or not np.allclose(one, other, rtol=1e-9, atol=0.0)


@contextmanager
def reading(file: Path, kind: str) -> Iterator[None]:
    """Turn any error of a reader into a UsageError with the file, its expected kind, and the reason."""
    try:
        with np.errstate(all="ignore"):  # numbers that are not finite are reported with their position
            yield
    except FlowsculptError:
        raise
    except Exception as error:  # parsers and decompressors raise anything
        raise UsageError(f"{file}: it cannot be read as {kind} ({shorten(error)})") from error


def require_valid(file: Path, axes: list[np.ndarray], times: np.ndarray, velocity: np.ndarray) -> None:
    """Raise UsageError unless axes and times ascend, and velocities fit them and are finite numbers."""
    for name, axis in zip("xyzt", [*axes, times], strict=True):
        least = 1 if name == "t" else 2
        numeric = axis.ndim == 1 and axis.dtype.kind in "fiu" and bool(np.isfinite(axis).all())
        if not numeric or len(axis) < least or not (np.diff(axis.astype(np.float64)) > 0).all():
            raise UsageError(
                f"{file}: axis {name} (shape {axis.shape}) must be a row of {least} or more ascending numbers"
            )
    wanted = (len(times), *(len(axis) for axis in axes), 3)
    if velocity.shape != wanted or velocity.dtype.kind not in "fiu":
        shown, first = velocity.shape, wanted
        if len(times) == 1 and len(shown) > 1 and shown[0] == 1:
            shown, first = shown[1:], wanted[1:]
        raise UsageError(
            f"{file}: velocity has the shape {shown}; its axes require {first}. Check their order."
        )
    finite = np.abs(velocity) <= MAX_SPEED  # and so no NaN
    if not finite.all():
        t, i, j, k, component = np.unravel_index(int(np.argmin(finite)), velocity.shape)
        point = ", ".join(f"{axis[n]:.4g}" for axis, n in zip(axes, (i, j, k), strict=True))
        value = velocity[t, i, j, k, component]
        raise UsageError(
            f"{file}: the velocity at ({point}), index ({i}, {j}, {k}), is {value:g}; samples must be "
            "finite, and at most 1e12. Fill the gaps, for example with zeros."
        )
