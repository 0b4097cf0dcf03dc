"""Velocities on a grid, as files hold them: what has to be true of them, and reading them."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.arrays import AnyArray, Floats
from pipeline.errors import MissingInputError, UsageError
from pipeline.flow.samples.foreign import MOST_BYTES, reading, require_room
from pipeline.flow.samples.npz_file import read_npz
from pipeline.flow.samples.vtk_file import read_vtk

FORMATS = (".vti", ".vtr", ".npz")

FASTEST = 1e12
"""As large as any number of a shot file: squares and sums of such stay finite."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Velocities at the places of three axes, at one moment or several.

    axes      three float64 arrays, each ascending and of two numbers or more
    times     (T,) seconds, ascending
    velocity  float64 (T, X, Y, Z, 3)
    digests   SHA-256 of each file: equal digests, equal samples
    """

    axes: tuple[Floats, Floats, Floats]
    times: Floats
    velocity: Floats
    digests: tuple[str, ...]

    @property
    def digest(self) -> str:
        """Of all files together."""
        return hashlib.sha256("".join(self.digests).encode()).hexdigest()


def read_samples(files: tuple[Path, ...], array: str | None = None, interval: float = 1.0) -> Samples:
    """The samples of one file, or of several that follow each other, `interval` seconds apart.

    array  the name of the velocities in VTK files; None: those that the file calls its vectors, or has alone

    What is hashed is what is parsed, and once. The last samples read stay in memory: while their files are
    what they were, these are not parsed again.

    Raises MissingInputError where a file is not there, UsageError where it is not what it must be.
    """
    asked = (files, array, interval)
    for known, samples in _LAST.items():
        if known == asked and all(map(_is_still, files, samples.digests)):
            return samples
    _LAST.clear()  # before others take as much room
    _LAST[asked] = _read(files, array, interval)
    return _LAST[asked]


_LAST: dict[tuple[tuple[Path, ...], str | None, float], Samples] = {}


def _is_still(file: Path, digest: str) -> bool:
    return hashlib.sha256(_content(file)).hexdigest() == digest


def _read(files: tuple[Path, ...], array: str | None, interval: float) -> Samples:
    axes, times, first, seen = _part(files[0], array)
    digests, velocity = [seen], first
    if len(files) > 1:
        _require_one_moment(files[0], first)
        require_room(files[0], (len(files), *first.shape[1:-1]), MOST_BYTES)
        times = np.asarray(interval * np.arange(len(files)), np.float64)
        velocity = np.empty((len(files), *first.shape[1:]))
        velocity[0] = first[0]
    for k, file in enumerate(files[1:], 1):
        others, _, part, seen = _part(file, array)
        if part.shape[1:] != first.shape[1:] or any(map(_differ, axes, others)):
            raise UsageError(
                f"{file}: its grid is not that of {files[0].name}; all files of a sequence share one"
            )
        _require_one_moment(file, part)
        velocity[k] = part[0]
        digests.append(seen)
    return Samples(axes, times, velocity, tuple(digests))


def _content(file: Path) -> bytes:
    try:
        size = file.stat().st_size
        if size > MOST_BYTES:
            raise UsageError(f"{file}: a file of {size >> 30} GiB is too large; 8 GiB are the most")
        return file.read_bytes()
    except OSError as error:
        raise MissingInputError(
            f"{file}: it cannot be read ({error.strerror or error}); look at its name and permissions"
        ) from None


def _part(file: Path, array: str | None) -> tuple[tuple[Floats, Floats, Floats], Floats, Floats, str]:
    """Axes, times and velocities of a file, and the digest of the bytes that they were parsed from."""
    if file.suffix.lower() not in FORMATS:
        raise UsageError(
            f"{file}: {file.suffix or 'no suffix'} is no format of fields; use {', '.join(FORMATS)}"
        )
    content, times = _content(file), np.zeros(1)
    if file.suffix.lower() == ".npz":
        if array is not None:
            raise UsageError(f"{file}: array {array} is asked for; in .npz it is velocity. Leave array out.")
        with reading(file, "an archive of arrays, as numpy.savez writes one"):
            axes, times, velocity = read_npz(file, content, MOST_BYTES)
            _require_sound(file, axes, times, velocity)
    else:
        with reading(file, "a grid, as VTK and ParaView write one"):
            axes, velocity = read_vtk(file, content, array, MOST_BYTES)
            _require_sound(file, axes, times, velocity)
    x, y, z = (np.ascontiguousarray(axis, np.float64) for axis in axes)
    velocity, times = np.ascontiguousarray(velocity, np.float64), np.asarray(times, np.float64)
    return (x, y, z), times, velocity, hashlib.sha256(content).hexdigest()


def _require_one_moment(file: Path, velocity: Floats) -> None:
    if len(velocity) > 1:
        raise UsageError(f"{file}: it holds moments of its own; a sequence has one a file. Name one file.")


def _require_sound(file: Path, axes: list[AnyArray], times: AnyArray, velocity: AnyArray) -> None:
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
            f"{file}: velocity has the shape {shown}; its axes make that {first}. Look at their order."
        )
    finite = np.abs(velocity) <= FASTEST  # and so no NaN
    if not finite.all():
        t, i, j, k, part = np.unravel_index(int(np.argmin(finite)), velocity.shape)
        place = ", ".join(f"{axis[n]:.4g}" for axis, n in zip(axes, (i, j, k), strict=True))
        value = velocity[t, i, j, k, part]
        raise UsageError(
            f"{file}: the velocity at ({place}), index ({i}, {j}, {k}), holds {value:g}; samples must be "
            "finite, and up to 1e12. Fill the gaps, with zeros for one."
        )


def _differ(one: Floats, other: Floats) -> bool:
    return len(one) != len(other) or not np.allclose(one, other, rtol=1e-9, atol=0.0)
