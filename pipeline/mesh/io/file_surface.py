"""Shared by readers of mesh files: the choice by suffix, and the polygons that readers return."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from pipeline.arrays import AnyArray, Points
from pipeline.errors import FlowsculptError, MeshError, MissingInputError

T = TypeVar("T")


class FileSurface(NamedTuple):
    """Polygons as a file has them, not yet merged or checked.

    points   float64 (V, 3)
    offsets  int64 (F + 1,): face f has the corners ``corners[offsets[f]:offsets[f + 1]]``
    corners  int64 (C,), from 0
    groups   int64 (F,): edges between faces with different numbers are creases
    tagged   int64 (K, 2): edges that the file itself marks as creases
    """

    points: Points
    offsets: AnyArray
    corners: AnyArray
    groups: AnyArray
    tagged: AnyArray


def file_surface(
    points: Points,
    faces: Sequence[Sequence[int]] | AnyArray,
    groups: Sequence[int] | None = None,
    tagged: Sequence[tuple[int, int]] = (),
) -> FileSurface:
    """Return the surface of one corner sequence a face, or (F, n) where all faces have n corners.

    Raises ValueError where a face names a missing vertex.
    """
    if isinstance(faces, np.ndarray):
        offsets, corners = faces.shape[1] * np.arange(len(faces) + 1), faces.reshape(-1).astype(np.int64)
    else:
        offsets = np.cumsum([0, *(len(face) for face in faces)])
        corners = np.fromiter(chain.from_iterable(faces), np.int64)
    outside = (corners < 0) | (corners >= len(points))
    if outside.any():
        c = int(np.argmax(outside))
        face = int(np.searchsorted(offsets, c, side="right")) - 1
        raise ValueError(f"face {face} names vertex {corners[c]} of {len(points)}, numbered from 0")
    alike = np.zeros(len(faces), np.int64) if groups is None else np.array(groups, np.int64)
    return FileSurface(points, offsets, corners, alike, np.array(tagged, np.int64).reshape(-1, 2))


def read_by_suffix(path: Path, readers: Mapping[str, Callable[[Path], T]], kind: str) -> T:
    """Return what the reader for the file's suffix returns.

    Raises MissingInputError where there is no such file, MeshError for another suffix or an unreadable file.
    """
    if not path.is_file():
        raise MissingInputError(f"{path}: there is no such file; check the path")
    suffix = path.suffix.lstrip(".").lower()
    if suffix not in readers:
        raise MeshError(
            f"{path}: {path.suffix or 'no suffix'} is not {kind}; use one of {', '.join(readers)}"
        )
    try:
        return readers[suffix](path)
    except FlowsculptError:
        raise
    except Exception as error:  # readers raise whatever their parsers do
        reason = " ".join(str(error).split()) or type(error).__name__
        short = reason if len(reason) <= 120 else reason[:117] + "…"
        raise MeshError(f"{path}: cannot be read as {suffix.upper()} ({short})") from error
