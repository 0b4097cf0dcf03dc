"""Object File Format (OFF) with its polygons."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pipeline.mesh.file_surface import FileSurface, file_surface


def read_object_file(path: Path) -> FileSurface:
    """Read an OFF file of text; normals, colours and edge counts are passed over.

    Raises ValueError at what cannot be read.
    """
    rows = _rows(path)
    first = next(rows, [])
    if first and first[0].upper().endswith("OFF"):
        first = first[1:] or next(rows, [])
    vertices, faces = int(first[0]), int(first[1])
    points = [[float(word) for word in next(rows)[:3]] for _ in range(vertices)]
    corners: list[list[int]] = []
    for _ in range(faces):
        row = next(rows)
        count = int(row[0])
        if len(row) <= count:
            raise ValueError(f"face {len(corners)} has {len(row) - 1} of its {count} corners")
        corners.append([int(word) for word in row[1 : count + 1]])
    return file_surface(np.array(points, np.float64).reshape(-1, 3), corners)


def _rows(path: Path) -> Iterator[list[str]]:
    """The words of each line that holds any, comments left out."""
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        words = line.split("#", 1)[0].split()
        if words:
            yield words
