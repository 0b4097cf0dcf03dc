"""Surfaces in text files with their polygons: Wavefront OBJ and Object File Format (OFF).

OBJ by its specification (Wavefront, Advanced Visualizer, Appendix B), with crease tags as OpenSubdiv writes
them: ``t crease 2/1/0 a b sharpness``, vertices numbered from 0.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from itertools import islice, pairwise

import numpy as np

from pipeline.mesh.file_surface import FileSurface, early_end, file_surface

_PARTING = ("o", "g", "s", "usemtl")
"""Statements that begin another object, group, smoothing group or material."""

_UNSMOOTHED = ("off", "0")


def read_wavefront(content: bytes) -> FileSurface:
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
    for line, words in _statements(content):
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
        raise ValueError(f"vertex {short + 1} has {len(points[short])} coordinates, not 3")
    return file_surface(np.array(points, np.float64).reshape(-1, 3), faces, groups, tagged, base=1)


def _statements(content: bytes) -> Iterator[tuple[int, list[str]]]:
    """Yield statements as words, with the line where each ends; a backslash continues a line."""
    words: list[str] = []
    file, number = io.TextIOWrapper(io.BytesIO(content), encoding="utf-8", errors="replace"), 0
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


def read_object_file(content: bytes) -> FileSurface:
    """Read an OFF text file; normals, colours and edge counts are skipped.

    Raises ValueError for unreadable input.
    """
    rows = (words for _, words in _statements(content))
    first = next(rows, [])
    if first and first[0].upper().endswith("OFF"):
        first = first[1:] or next(rows, [])
    if len(first) < 2:
        raise ValueError("it has no OFF header")
    vertices, faces = int(first[0]), int(first[1])
    if min(vertices, faces) < 0 or max(vertices, faces) > len(content):
        raise ValueError(f"its header promises {vertices} vertices and {faces} faces; they do not fit in it")
    points = [[float(word) for word in row[:3]] for row in islice(rows, vertices)]
    short = next((k for k, point in enumerate(points) if len(point) < 3), None)
    if short is not None:
        raise ValueError(f"vertex {short} has {len(points[short])} coordinates, not 3")
    if len(points) < vertices:
        raise early_end(vertices, "vertex", len(points))
    corners: list[list[int]] = []
    for row in islice(rows, faces):
        count = int(row[0])
        if not 0 <= count < len(row):
            raise ValueError(f"face {len(corners)} has {len(row) - 1} of its {count} corners")
        corners.append([int(word) for word in row[1 : count + 1]])
    if len(corners) < faces:
        raise early_end(faces, "face", len(corners))
    return file_surface(np.array(points, np.float64).reshape(-1, 3), corners)
