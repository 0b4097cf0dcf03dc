"""Checks of files with sampled velocities: their size, their form, and errors of their parsers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.errors import FlowsculptError, UsageError

MAX_BYTES = 8 << 30
"""Memory for the samples of a field, or of a sequence."""

MAX_SPEED = 1e12
"""The limit of any number in a shot file: squares and sums of such numbers stay finite."""


@contextmanager
def reading(file: Path, kind: str) -> Iterator[None]:
    """Turn any error of a reader into a UsageError with the file, its expected kind, and the reason."""
    try:
        with np.errstate(all="ignore"):  # numbers that are not finite are reported with their position
            yield
    except FlowsculptError:
        raise
    except Exception as error:  # parsers and decompressors raise anything
        raise UsageError(f"{file}: it cannot be read as {kind} ({_brief(error)})") from error


def require_size(file: Path, lengths: Iterable[int], most: int = MAX_BYTES) -> None:
    """Raise UsageError where float64 velocities on axes of these lengths take more than `most` bytes."""
    wanted = 24 * math.prod(lengths)
    if wanted > most:
        raise UsageError(f"{file}: {_size(wanted)} of velocities are too many; {_size(most)} are the most")


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


def _size(count: int) -> str:
    return f"{count >> 30} GiB" if count >> 30 else f"{count} bytes"


def _brief(error: Exception) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 120 else text[:117] + "…"
