"""What the readers of polygon files hand on: the faces as the file has them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from pipeline.arrays import AnyArray, Points


class FileSurface(NamedTuple):
    """Polygons as a file has them, not yet joined or checked.

    points   float64 (V, 3)
    offsets  int64 (F + 1,): face f has the corners ``corners[offsets[f]:offsets[f + 1]]``
    corners  int64 (C,), from 0
    groups   int64 (F,): faces with equal numbers belong together; edges between others are creases
    tagged   int64 (K, 2): edges that the file itself calls creases
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
    """From one sequence of corners a face, or (F, n) where all have n of them.

    Raises ValueError where a face names a vertex that is not there.
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
