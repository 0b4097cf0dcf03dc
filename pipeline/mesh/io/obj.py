"""Wavefront OBJ with its polygons, groups and creases; and Object File Format (OFF).

Vertices and faces by the format's specification (Wavefront, Advanced Visualizer, Appendix B); crease tags
as OpenSubdiv writes them: ``t crease 2/1/0 a b sharpness``, vertices numbered from 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from pipeline.mesh.io.file_surface import FileSurface, file_surface

_PARTING = ("o", "g", "s", "usemtl")
"""Statements that begin another object, group, smoothing group or material."""

_UNSMOOTHED = ("off", "0")


def read_wavefront(path: Path) -> FileSurface:
    """Read the faces of an OBJ file, grouped by object, group, smoothing group and material.

    Faces outside all smoothing groups form one group: many writers leave smoothing out, and such a surface
    has no creases. Lines, points, curves and texture coordinates are skipped. Raises ValueError, with its
    line, for unreadable input.
    """
    points: list[list[float]] = []
    faces: list[list[int]] = []
    groups: list[int] = []
    tagged: list[tuple[int, int]] = []
    numbers: dict[tuple[str, ...], int] = {}
    part = dict.fromkeys(_PARTING, "")
    for line, words in _statements(path):
        try:
            match words[0]:
                case "v":
                    points.append([float(word) for word in words[1:4]])
                case "f":
                    faces.append([_vertex(word, len(points)) for word in words[1:]])
                    groups.append(numbers.setdefault(tuple(part.values()), len(numbers)))
                case "s":
                    part["s"] = "" if words[1:2] == [] or words[1] in _UNSMOOTHED else words[1]
                case "o" | "g" | "usemtl":
                    part[words[0]] = " ".join(words[1:])
                case "t" if words[1:2] == ["crease"]:
                    tagged += _creases(words)
        except (ValueError, IndexError) as error:
            raise ValueError(f"line {line}: {' '.join(words)[:40]}: {error}") from error
    short = next((k for k, point in enumerate(points) if len(point) != 3), None)
    if short is not None:
        raise ValueError(f"vertex {short} has {len(points[short])} coordinates, not 3")
    return file_surface(np.array(points, np.float64).reshape(-1, 3), faces, groups, tagged)


def _statements(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield statements as words, with the line where each ends; a backslash continues a line."""
    words: list[str] = []
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, text in enumerate(file, 1):
            text = text.split("#", 1)[0].rstrip()
            words += text.removesuffix("\\").split()
            if not text.endswith("\\") and words:
                yield number, words
                words = []
    if words:
        yield number, words


def _vertex(word: str, points: int) -> int:
    """Return the vertex of ``v``, ``v/vt``, ``v//vn`` or ``v/vt/vn``, from 0; negative ones count back."""
    number = int(word.split("/", 1)[0])
    if number == 0:
        raise ValueError("vertices are numbered from 1")
    return number - 1 if number > 0 else points + number


def _creases(words: list[str]) -> list[tuple[int, int]]:
    """Return the edges of one tag: consecutive pairs of its vertices, unless its sharpness is 0."""
    count = int(words[2].split("/", 1)[0])
    chain = [int(word) for word in words[3 : 3 + count]]
    sharpness = [float(word) for word in words[3 + count :]]
    return list(pairwise(chain)) if any(sharpness) else []


def read_object_file(path: Path) -> FileSurface:
    """Read an OFF text file; normals, colours and edge counts are skipped.

    Raises ValueError for unreadable input.
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
    """Yield the words of each line that has any, without comments."""
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        words = line.split("#", 1)[0].split()
        if words:
            yield words
