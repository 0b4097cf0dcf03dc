"""Files of others that hold fields: how much they may hold, and how what is wrong with them is told."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from pipeline.errors import FlowsculptError, UsageError

MOST_BYTES = 8 << 30
"""What the samples of a field, or of a sequence, may take in memory."""


@contextmanager
def reading(file: Path, kind: str) -> Iterator[None]:
    """Whatever a reader raises becomes a UsageError with the file, what it should be, and the reason."""
    try:
        with np.errstate(all="ignore"):  # numbers that are not finite are told by their place
            yield
    except FlowsculptError:
        raise
    except Exception as error:  # parsers and decompressors raise whatever they do
        raise UsageError(f"{file}: it cannot be read as {kind} ({_brief(error)})") from error


def require_room(file: Path, lengths: Iterable[int], most: int = MOST_BYTES) -> None:
    """Raises UsageError where float64 velocities at so many places along the axes are too many."""
    wanted = 24 * math.prod(lengths)
    if wanted > most:
        raise UsageError(f"{file}: {_size(wanted)} of velocities are too many; {_size(most)} are the most")


def _size(count: int) -> str:
    return f"{count >> 30} GiB" if count >> 30 else f"{count} bytes"


def _brief(error: Exception) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 120 else text[:117] + "…"
