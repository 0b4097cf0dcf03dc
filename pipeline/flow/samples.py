"""Velocities on a grid, read from one file or from a sequence of files."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pipeline.arrays import AnyArray, Floats
from pipeline.errors import FlowsculptError, UsageError, reason_of
from pipeline.flow.sample_files import MAX_BYTES, read_npz, read_vtk, require_size
from render.base.input_files import read_input

FORMATS = (".vti", ".vtr", ".npz")

MAX_SPEED = 1e12
"""The limit of any number in a shot file: squares and sums of such numbers stay finite."""


@dataclass(frozen=True)
class Samples:
    """Velocities at the nodes of a grid, at one time or several: equal contents of files, equal samples.

    axes      three float64 arrays, each ascending and of two numbers or more
    times     (T,) seconds, ascending
    velocity  float64 (T, X, Y, Z, 3)
    digests   SHA-256 of each file
    array     the name of the velocities in VTK files; None: the file's only vectors
    interval  seconds from file to file
    """

    axes: tuple[Floats, Floats, Floats] = field(compare=False, repr=False)
    times: Floats = field(compare=False, repr=False)
    velocity: Floats = field(compare=False, repr=False)
    digests: tuple[str, ...]
    array: str | None = None
    interval: float = 1.0

    @property
    def digest(self) -> str:
        """The digest of all files together."""
        return hashlib.sha256("".join(self.digests).encode()).hexdigest()


def read_samples(files: tuple[Path, ...], array: str | None = None, interval: float = 1.0) -> Samples:
    """Return the samples of one file, or of a sequence of files `interval` seconds apart.

    array  the name of the velocities in VTK files; None: the file's active vectors, or its only array

    The digests are of the same bytes that are parsed. The last samples stay in memory: as long as the
    contents of their files do not change, they are not parsed again.

    Raises MissingInputError where a file is missing, UsageError where it is invalid.
    """
    request = (files, array, interval)
    for known, samples in _LAST.items():
        if known == request and all(map(_is_unchanged, files, samples.digests)):
            return samples
    _LAST.clear()  # before others take as much memory
    _LAST[request] = _read(files, array, interval)
    return _LAST[request]


_LAST: dict[tuple[tuple[Path, ...], str | None, float], Samples] = {}


def _is_unchanged(file: Path, digest: str) -> bool:
    return hashlib.sha256(read_input(file, MAX_BYTES)).hexdigest() == digest


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
            raise UsageError(
                f"{file}: its grid is not that of {files[0].name}; all files of a sequence share one"
            )
        _require_one_time(file, part)
        velocity[k] = part[0]
        digests.append(digest)
    return Samples(axes, times, velocity, tuple(digests), array, interval)


def _read_file(file: Path, array: str | None) -> tuple[tuple[Floats, Floats, Floats], Floats, Floats, str]:
    """Return axes, times and velocities of a file, and the digest of the parsed bytes."""
    if file.suffix.lower() not in FORMATS:
        raise UsageError(
            f"{file}: {file.suffix or 'no suffix'} is no format of fields; use {', '.join(FORMATS)}"
        )
    content, times = read_input(file, MAX_BYTES), np.zeros(1)
    if file.suffix.lower() == ".npz":
        if array is not None:
            raise UsageError(
                f"{file}: array {array} does not apply; in .npz it is velocity. Leave array out."
            )
        with reading(file, "an archive of arrays, as numpy.savez writes one"):
            axes, times, velocity = read_npz(file, content, MAX_BYTES)
            require_valid(file, axes, times, velocity)
    else:
        with reading(file, "a grid, as VTK and ParaView write one"):
            axes, velocity = read_vtk(file, content, array, MAX_BYTES)
            require_valid(file, axes, times, velocity)
    x, y, z = (np.ascontiguousarray(axis, np.float64) for axis in axes)
    velocity, times = np.ascontiguousarray(velocity, np.float64), np.asarray(times, np.float64)
    return (x, y, z), times, velocity, hashlib.sha256(content).hexdigest()


def _require_one_time(file: Path, velocity: Floats) -> None:
    if len(velocity) > 1:
        raise UsageError(f"{file}: it holds several times; a sequence has one a file. Name one file.")


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
        raise UsageError(f"{file}: it cannot be read as {kind} ({reason_of(error)})") from error


def require_valid(file: Path, axes: list[AnyArray], times: AnyArray, velocity: AnyArray) -> None:
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
