"""Velocities on a grid, read from one file or from a sequence of files."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flowsculpt import FlowsculptError, UsageError
from flowsculpt.api import shorten, suggest
from flowsculpt.api.files import Archive, InputFile
from flowsculpt.api.flows import Samples
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.fields.grid_layout import FLAT, TURNED
from flowsculpt.pipeline.plugins.fields.stored_arrays import SUFFIXES
from flowsculpt.pipeline.plugins.fields.vtk_grids import (
    MAX_BYTES,
    VtkGrid,
    collection,
    piece_files,
    read_vtk,
    require_size,
)
from flowsculpt.pipeline.plugins.fields.vtk_meshes import RESAMPLED, read_resampled
from flowsculpt.pipeline.plugins.fields.windowed_samples import (
    MAX_SPEED,
    SourceFiles,
    WindowedSamples,
    file_digest,
)


def read_npz(
    file: Path, content: bytes, most: int = MAX_BYTES, name: str = "velocity"
) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Return arrays x, y, z; times; and velocity (T, X, Y, Z, 3), (X, Y, Z, 3) in a file without t.

    most  bytes of all arrays as float64; checked by their headers before anything is unpacked
    name  of the array of velocities, or of numbers

    Raises UsageError where an array is missing or they are too large, and the errors of zipfile and numpy.
    """
    archive = Archive(content)
    missing = [each for each in (*"xyz", name) if each not in archive.names]
    if missing:
        hint = suggest(missing[0], sorted(archive.names)) if archive.names else "It is empty."
        raise UsageError(f"{file}: array {missing[0]} is missing; a field has x, y, z and {name}. {hint}")
    names = [each for each in (*"xyzt", name) if each in archive.names]
    headers = [archive.header(name) for name in names]
    wide = (math.prod(header.shape) * max(1, -(-header.dtype.itemsize // 8)) for header in headers)
    require_size(file, [-(-sum(wide) // 3)], most)
    arrays = {name: archive.array(name) for name in names}
    axes, velocity = [arrays[name] for name in "xyz"], arrays[name]
    return (axes, arrays["t"], velocity) if "t" in arrays else (axes, np.zeros(1), velocity[None])


FORMATS = (".vti", ".vtr", ".pvti", ".pvtr", ".pvd", *RESAMPLED, ".npz")

EVEN_VERSION = 1
"""Raised when equal meshes give other velocities on an even grid."""

IN_MEMORY = 1 << 30
"""Bytes of a sequence up to which all of its times are read with the shot, and checked; of a longer one those
around a frame are in memory."""


class FieldFiles(NamedTuple):
    """Samples, the files that decide them with their digests, and notes for the user."""

    samples: Samples
    files: SourceFiles
    notes: tuple[str, ...] = ()


def read_samples(
    files: tuple[Path, ...],
    array: str | None = None,
    interval: float = 1.0,
    resolution: int | None = None,
    is_number: bool = False,
) -> FieldFiles:
    """Return the samples of one file, or of a sequence of files `interval` seconds apart.

    array       the name of the velocities in VTK files; None: the file's active vectors, or its only array
    resolution  nodes along the longest side of the even grid in place of a mesh or a bent grid
    is_number   True if the array has numbers: samples are these, 0 where they are NaN, 1 or 0 there, and 1

    The digests are of the same bytes that are parsed. The last samples stay in memory: as long as the
    contents of their files do not change, they are not parsed again.

    Raises MissingInputError where a file is missing, UsageError where it is invalid.
    """
    request = (files, array, interval, resolution, is_number)
    for known, read in list(_LAST.items()):  # another thread may replace them
        if known == request and all(_is_unchanged(file, digest) for file, digest in read.files):
            return read
    if not is_number:
        _LAST.clear()  # before others take as much memory
    _LAST[request] = read = _read(files, array, interval, _Kind(resolution, is_number))
    return read


class _Kind(NamedTuple):
    """How files are read: `resolution` and `is_number` of `read_samples`."""

    resolution: int | None = None
    is_number: bool = False


_LAST: dict[tuple[tuple[Path, ...], str | None, float, int | None, bool], FieldFiles] = {}


def _is_unchanged(file: Path, digest: str) -> bool:
    return hashlib.sha256(InputFile(file, MAX_BYTES).content()).hexdigest() == digest


def _read(files: tuple[Path, ...], array: str | None, interval: float, kind: _Kind) -> FieldFiles:
    times, listed = np.asarray(interval * np.arange(len(files)), np.float64), tuple[tuple[Path, str], ...]()
    if files[0].suffix.lower() == ".pvd":
        if len(files) > 1:
            raise UsageError(f"{files[0]}: a collection has times of its own. Name one file.")
        content = InputFile(files[0], MAX_BYTES).content()
        with reading(files[0], "a collection, as ParaView writes one"):
            moments, paths = collection(files[0], content)
        listed = ((files[0], hashlib.sha256(content).hexdigest()),)
        times, files = np.array(moments), tuple(paths)
    first = _read_file(files[0], array, kind)
    if len(files) == 1:
        samples: Samples = _in_memory(first, first.times, first.velocity, (first.digest,), array, interval)
        return FieldFiles(samples, (*listed, *first.files), first.notes)
    _require_one_time(files[0], first.velocity)
    if len(files) * first.velocity.nbytes > IN_MEMORY:
        windowed = GridFileSamples(files, array, kind, first.axes, times, first.turn)
        return FieldFiles(windowed, (*listed, *first.files), first.notes)
    velocity, digests, read = (
        np.empty((len(files), *first.velocity.shape[1:])),
        [first.digest],
        list(first.files),
    )
    velocity[0] = first.velocity[0]
    for k, file in enumerate(files[1:], 1):
        part = _read_file(file, array, kind)
        _require_same_grid(file, part, files[0], first.axes, first.turn)
        velocity[k] = part.velocity[0]
        digests.append(part.digest)
        read += part.files
    samples = _in_memory(first, times, velocity, tuple(digests), array, interval)
    return FieldFiles(samples, (*listed, *read), first.notes)


class _FieldFile(NamedTuple):
    """The content of a file: axes, times, velocities (T, X, Y, Z, 3), and files with their digests."""

    axes: tuple[Floats, Floats, Floats]
    times: Floats
    velocity: Floats
    turn: Floats | None
    files: SourceFiles
    notes: tuple[str, ...]
    resampling: str = ""

    @property
    def digest(self) -> str:
        own = [digest for _, digest in self.files] + ([self.resampling] if self.resampling else [])
        return own[0] if len(own) == 1 else hashlib.sha256("\n".join(own).encode()).hexdigest()


def _in_memory(
    first: _FieldFile,
    times: Floats,
    velocity: Floats,
    digests: tuple[str, ...],
    array: str | None,
    interval: float,
) -> Samples:
    return Samples.of_arrays(first.axes, times, velocity, digests, array, interval, first.turn)


@dataclass(frozen=True)
class GridFileSamples(WindowedSamples):
    """Files with a time each, all on the grid of the first."""

    paths: tuple[Path, ...]
    velocity_name: str | None
    kind: _Kind
    axes: tuple[Floats, Floats, Floats] = field(compare=False, repr=False)
    times: Floats = field(compare=False, repr=False)
    turn: Floats | None = field(compare=False, repr=False)

    @property
    def geometry(self) -> int:  # type: ignore[override]
        return FLAT if self.turn is None else TURNED

    @property
    def settings(self) -> Any:
        more = [] if self.kind.resolution is None else [self.kind.resolution]
        return ["grid", self.velocity_name, *more, *(["numbers"] if self.kind.is_number else [])]

    def place(self, index: int) -> Any:
        return 0

    def current_files(self, index: int, has_velocities: bool = True) -> SourceFiles:
        path = self.paths[index]
        return tuple((each, file_digest(each)) for each in (path, *piece_files(path)))

    def read(self, index: int) -> np.ndarray:
        part = _read_file(self.paths[index], self.velocity_name, self.kind)
        _require_same_grid(self.paths[index], part, self.paths[0], self.axes, self.turn)
        return np.ascontiguousarray(part.velocity[0], np.float32)


def _require_same_grid(
    file: Path, part: _FieldFile, name: Path, axes: tuple[Floats, Floats, Floats], turn: Floats | None
) -> None:
    one, other = (np.eye(3) if each is None else each for each in (part.turn, turn))
    if not np.allclose(one, other) or any(map(_differ, axes, part.axes)):
        fact = f"its grid differs from that of {name.name}"
        raise UsageError(f"{file}: {fact}; all files of a sequence share one grid")
    _require_one_time(file, part.velocity)


def _read_file(file: Path, array: str | None, kind: _Kind) -> _FieldFile:
    resolution, is_number = kind
    if file.suffix.lower() not in FORMATS:
        InputFile(file, MAX_BYTES).size()
        remedy = OTHER_FORMATS.get(file.suffix.lower(), "Save it as one of these.")
        raise UsageError(
            f"{file}: {file.suffix or 'no suffix'} is not a format of fields; use "
            f"{', '.join((*FORMATS, *SUFFIXES))}. {remedy}"
        )
    content, times, is_npz = InputFile(file, MAX_BYTES).content(), np.zeros(1), file.suffix.lower() == ".npz"
    if is_npz and array is not None and not is_number:
        raise UsageError(
            f"{file}: array {array} does not apply; in .npz the array is velocity. Leave out array."
        )
    is_resampled = file.suffix.lower() in RESAMPLED
    if resolution is not None and not is_resampled:
        raise UsageError(f"{file}: resolution does not apply; it is for curved grids and meshes. Remove it.")
    sort = "an archive of arrays, as numpy.savez writes" if is_npz else "a grid, as VTK and ParaView write"
    with reading(file, f"{sort} one"):
        if is_npz:
            axes, times, velocity = (
                read_npz(file, content, name=str(array)) if is_number else read_npz(file, content)
            )
            grid = VtkGrid(axes, velocity)
        elif is_resampled:
            grid = read_resampled(file, content, array, resolution, 1 if is_number else 3)
            velocity = grid.velocity[None]
        else:
            grid = read_vtk(file, content, array, components=1 if is_number else 3)
            velocity = grid.velocity[None]
        if is_number:
            velocity = _numbers(velocity.reshape(velocity.shape[:4]))
        require_valid(file, grid.axes, times, velocity)
    x, y, z = (np.ascontiguousarray(axis, np.float64) for axis in grid.axes)
    velocity, times = np.ascontiguousarray(velocity, np.float64), np.asarray(times, np.float64)
    files = [(file, hashlib.sha256(content).hexdigest())]
    files += [(piece, file_digest(piece)) for piece in piece_files(file)]
    how = f"even {EVEN_VERSION} {velocity.shape}" if is_resampled else ""
    return _FieldFile((x, y, z), times, velocity, grid.turn, tuple(files), grid.notes, how)


def _numbers(values: np.ndarray) -> np.ndarray:
    """Return what fields of numbers are at nodes, (T, X, Y, Z, 3), of values (T, X, Y, Z)."""
    known = np.isfinite(values)
    return np.stack([np.where(known, values, 0.0), known, np.ones(values.shape)], axis=-1)


OTHER_FORMATS = {
    **dict.fromkeys((".pvtu", ".pvts", ".vtk", ".vtp"), "Resample it (Resample To Image), save it as .vti."),
    ".series": "Name the files that it lists, as 'NAME_*.vti', or save a .pvd in ParaView.",
    ".zip": "Unzip it, and name the file or Zarr store in it.",
}
"""Suffixes of other files that hold fields, and what to do with them."""


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
    if velocity.dtype.kind not in "fiu":
        raise UsageError(f"{file}: velocity holds {velocity.dtype}; it must be real numbers")
    if velocity.shape != wanted:
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
