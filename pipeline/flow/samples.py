"""Velocities on a grid, as files hold them: what has to be true of them, and reading them."""

from __future__ import annotations

import hashlib
import zipfile
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from pipeline.arrays import AnyArray, Floats
from pipeline.errors import MissingInputError, UsageError
from pipeline.flow.vtk_file import read_vtk

FORMATS = (".vti", ".vtr", ".npz")

MOST_BYTES = 8 << 30
"""What the samples of a sequence may take in memory."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Velocities at the places of three axes, at one moment or several.

    axes      three float64 arrays, each ascending and of two numbers or more
    times     (T,) seconds, ascending
    velocity  float64 (T, X, Y, Z, 3)
    digest    SHA-256 of the files: equal digests, equal samples
    """

    axes: tuple[Floats, Floats, Floats]
    times: Floats
    velocity: Floats
    digest: str


def digest_of(files: tuple[Path, ...]) -> str:
    """SHA-256 of the contents of files in their order. Raises MissingInputError."""
    digest = hashlib.sha256()
    for file in files:
        try:
            digest.update(hashlib.sha256(file.read_bytes()).digest())
        except OSError as error:
            raise MissingInputError(
                f"{file}: {error.strerror or error}; a field's file has to be there"
            ) from None
    return digest.hexdigest()


def read_samples(files: tuple[Path, ...], array: str | None = None, interval: float = 1.0) -> Samples:
    """The samples of one file, or of several that follow each other, `interval` seconds apart.

    array  the name of the velocities in VTK files; None: those that the file calls its vectors, or has alone

    Raises MissingInputError where a file is not there, UsageError where it is not what it must be.
    """
    return _read(files, array, interval, digest_of(files))


@lru_cache(maxsize=4)
def _read(files: tuple[Path, ...], array: str | None, interval: float, digest: str) -> Samples:
    parts = [_part(file, array) for file in files]
    axes, times, first = parts[0]
    for file, (others, _, velocity) in zip(files[1:], parts[1:], strict=True):
        if velocity.shape[1:] != first.shape[1:] or any(map(_differ, axes, others)):
            raise UsageError(
                f"{file}: its grid is not that of {files[0].name}; all files of a sequence share one"
            )
    if len(files) > 1:
        if any(len(velocity) > 1 for _, _, velocity in parts):
            raise UsageError(
                f"{files[0]}: it holds moments of its own; a sequence has one a file. Name one file."
            )
        times = np.asarray(interval * np.arange(len(files)), np.float64)
    together = np.concatenate([part[2] for part in parts]) if len(parts) > 1 else first
    return Samples(axes, times, together, digest)


def _part(file: Path, array: str | None) -> tuple[tuple[Floats, Floats, Floats], Floats, Floats]:
    if file.suffix.lower() not in FORMATS:
        raise UsageError(
            f"{file}: {file.suffix or 'no suffix'} is no format of fields; use {', '.join(FORMATS)}"
        )
    if file.suffix.lower() == ".npz":
        axes, times, velocity = _read_npz(file)
    else:
        axes, velocity = read_vtk(file, array)
        times = np.zeros(1)
    _require_sound(file, axes, times, velocity)
    x, y, z = (np.ascontiguousarray(axis, np.float64) for axis in axes)
    return (x, y, z), np.asarray(times, np.float64), np.ascontiguousarray(velocity, np.float64)


def _read_npz(file: Path) -> tuple[list[AnyArray], AnyArray, AnyArray]:
    """Arrays x, y, z, and velocity (X, Y, Z, 3); with t, (T, X, Y, Z, 3)."""
    try:
        with np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise UsageError(
            f"{file}: it cannot be read as an archive of arrays ({error}); numpy.savez writes one"
        ) from None
    missing = [name for name in ("x", "y", "z", "velocity") if name not in arrays]
    if missing:
        there = ", ".join(sorted(arrays)) or "nothing"
        raise UsageError(
            f"{file}: array {missing[0]} is missing; a field has x, y, z and velocity. There are: {there}."
        )
    velocity = arrays["velocity"]
    return (
        [arrays[name] for name in "xyz"],
        arrays.get("t", np.zeros(1)),
        velocity if "t" in arrays else velocity[None],
    )


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
    if velocity.size * 8 > MOST_BYTES:
        raise UsageError(
            f"{file}: {velocity.size * 8 >> 30} GiB of velocities are too many; 8 GiB are the most"
        )
    finite = np.isfinite(velocity)
    if not finite.all():
        t, i, j, k, part = np.unravel_index(int(np.argmin(finite)), velocity.shape)
        place = ", ".join(f"{axis[n]:.4g}" for axis, n in zip(axes, (i, j, k), strict=True))
        value = velocity[t, i, j, k, part]
        raise UsageError(
            f"{file}: the velocity at ({place}), index ({i}, {j}, {k}), holds {value}; samples must be "
            "finite. Fill the gaps, with zeros for one."
        )


def _differ(one: Floats, other: Floats) -> bool:
    return len(one) != len(other) or not np.allclose(one, other, rtol=1e-9, atol=0.0)
