"""Surfaces in the Object File Format, OFF, as text or binary (Geomview manual, *OFF Files*)."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple

import numpy as np

from flowsculpt import MeshError
from flowsculpt.api.files import number_fault, text_content
from flowsculpt.api.meshes import FileSurface, Floats, SurfaceReader
from flowsculpt.pipeline.plugins.interchange.scene_readers import early_end

_KEYWORD = re.compile(rb"((?:ST|C|N|4|n)*)OFF(\d*)")
"""The first word, perhaps with the number of vertices behind it, as ModelNet has it."""

_BINARY = re.compile(rb"\s*((?:ST|C|N|4|n)*)OFF[ \t]+BINARY[ \t]*(?:\r\n|\n|\r)")

_HEADER_ROWS = 5
"""Most rows of a header: keyword, dimension, and the numbers of vertices, faces and edges."""

Row = list[bytes]


class _Layout(NamedTuple):
    """The columns of a vertex, by the prefixes of the keyword.

    weighted   it has a homogeneous coordinate, w (`4`)
    dimension  number of its other coordinates (`n`)
    beside     numbers of its normal (`N`), colour (`C`) and texture coordinates (`ST`)
    """

    weighted: bool
    dimension: int
    beside: int

    @classmethod
    def of(cls, prefixes: bytes, dimension: int) -> _Layout:
        """Return the layout. Raises MeshError for vertices that are not in space."""
        if dimension != 3:
            raise MeshError(f"its vertices have {dimension} dimensions (nOFF); only 3 are read")
        beside = sum(width for mark, width in ((b"ST", 2), (b"C", 4), (b"N", 3)) if mark in prefixes)
        return cls(b"4" in prefixes, dimension, beside)

    @property
    def numbers(self) -> int:
        """The number of coordinates of its position."""
        return self.dimension + self.weighted

    def points(self, positions: Floats) -> Floats:
        """Return points (V, 3) of positions (V, numbers). Raises MeshError for points at infinity."""
        if not self.weighted:
            return positions
        w = positions[:, 3:]
        if not w.all():
            raise MeshError(
                f"vertex {int(np.argmin(w != 0.0))} has w 0 (4OFF), so it is infinitely far. Remove it."
            )
        return positions[:, :3] / w


def read_object_file(content: bytes) -> FileSurface:
    """Read an OFF file; normals, colours, texture coordinates and the number of edges are skipped.

    Raises ValueError for unreadable input, MeshError for vertices that are not in space.
    """
    binary = _BINARY.match(content)
    if binary:
        return _read_binary(content[binary.end() :], binary[1])
    text = text_content(content)
    head = list(islice(_rows(text), _HEADER_ROWS + 1))
    is_one_row = len(head) == 1
    if is_one_row:
        head = [[word] for word in head[0]]
    keyword = _keyword(head[0][0]) if head else None
    prefixes = keyword[1] if keyword else b""
    if keyword:
        head[0] = [*([keyword[2]] if keyword[2] else []), *head[0][1:]]
    dimension, vertices, faces, start = _counts(head, b"n" in prefixes)
    if min(vertices, faces) < 0 or max(vertices, faces) > len(content):
        raise ValueError(
            f"its header promises {vertices} vertices and {faces} faces; the file is too short for them"
        )
    layout = _Layout.of(prefixes, dimension)
    if is_one_row:
        return _read_words(head[start:], layout, vertices, faces)
    try:
        return _read_rows(islice(_rows(text), start, None), layout, vertices, faces)
    except ValueError as error:
        try:
            return _read_words(list(islice(_rows(text), start, None)), layout, vertices, faces)
        except ValueError:
            raise error from None


def _rows(text: bytes) -> Iterator[Row]:
    for line in io.BytesIO(text):
        words = (line.partition(b"#")[0] if b"#" in line else line).split()
        if words:
            yield words


def _keyword(word: bytes) -> re.Match[bytes] | None:
    return _KEYWORD.fullmatch(word) or _KEYWORD.fullmatch(word.upper())


def _counts(rows: list[Row], has_dimension: bool) -> tuple[int, int, int, int]:
    """Return dimension, vertices and faces, and the row after them; each may have a row of its own."""
    wanted, numbers, at = 2 + has_dimension, list[int](), 0
    while len(numbers) < wanted:
        if at == len(rows) or number_fault(rows[at], int):
            raise ValueError("it has no OFF header")
        numbers += map(int, rows[at])
        at += 1
    alone = [len(row) == 1 for row in rows[max(0, at - 2) : at + 1]]
    if len(numbers) == wanted and len(alone) == 3 and all(alone):
        at += 1  # the number of edges has a row of its own too
    return (numbers[0] if has_dimension else 3), numbers[wanted - 2], numbers[wanted - 1], at


def _read_rows(rows: Iterator[Row], layout: _Layout, vertices: int, faces: int) -> FileSurface:
    """Read a row for each vertex and each face, as nearly all files have them."""
    positions: list[float] = []
    width = layout.numbers
    for k, row in enumerate(islice(rows, vertices)):
        if len(row) < width:
            raise ValueError(f"vertex {k} has {len(row)} coordinates, not {width}")
        try:
            positions += map(float, row[:width])
        except ValueError:
            raise ValueError(f"vertex {k}: {number_fault(row)}") from None
    if len(positions) < vertices * width:
        raise early_end(vertices, "vertex", len(positions) // width)
    sides: list[int] = []
    corners: list[int] = []
    for k, row in enumerate(islice(rows, faces)):
        try:
            count = int(row[0])
            corners += map(int, row[1 : count + 1])
        except ValueError:
            raise ValueError(f"face {k}: {number_fault(row, int)}") from None
        if not 0 <= count < len(row):
            raise ValueError(f"face {k} has {len(row) - 1} of its {count} corners")
        sides.append(count)
    _require_faces(faces, len(sides), sum(1 for _ in rows), "row")
    points = layout.points(np.array(positions, np.float64).reshape(-1, width))
    return FileSurface.of(points, np.array(corners, np.int64), sides=sides)


def _require_faces(promised: int, present: int, more: int, item: str) -> None:
    if present < promised:
        raise early_end(promised, "face", present)
    if more > 0:
        rest = f"{more} {item} follows" if more == 1 else f"{more} {item}s follow"
        raise ValueError(f"its header promises {promised} faces, and {rest} the last of them")


def _read_words(rows: list[Row], layout: _Layout, vertices: int, faces: int) -> FileSurface:
    """Read numbers that any white space separates; only a colour of a face ends with its row."""
    words = [word for row in rows for word in row]
    row_of = [k for k, row in enumerate(rows) for _ in row]
    width = layout.numbers + layout.beside
    if len(words) < vertices * width:
        raise early_end(vertices, "vertex", len(words) // width)
    table = np.array(words[: vertices * width], np.float64).reshape(vertices, width)
    at = vertices * width
    sides: list[int] = []
    corners: list[int] = []
    for _ in range(faces):
        count = int(words[at]) if at < len(words) else 0
        end = at + 1 + count
        if count < 1 or end > len(words):
            raise early_end(faces, "face", len(sides))
        sides.append(count)
        corners += map(int, words[at + 1 : end])
        at = end
        while at < len(words) and row_of[at] == row_of[end - 1]:
            at += 1
    _require_faces(faces, len(sides), len(words) - at, "number")
    points = layout.points(table[:, : layout.numbers])
    return FileSurface.of(points, np.array(corners, np.int64), sides=sides)


def _read_binary(body: bytes, prefixes: bytes) -> FileSurface:
    """Read big-endian numbers of four bytes; a face has its corners and then the numbers of its colour."""
    numbers: np.ndarray = np.frombuffer(body, ">i4", len(body) // 4)
    wanted = 4 if b"n" in prefixes else 3
    if len(numbers) < wanted:
        raise ValueError("it ends within its header")
    vertices, faces = int(numbers[wanted - 3]), int(numbers[wanted - 2])
    layout = _Layout.of(prefixes, int(numbers[0]) if wanted == 4 else 3)
    width, at = layout.numbers + layout.beside, wanted
    if min(vertices, faces) < 0:
        raise ValueError(f"its header promises {vertices} vertices and {faces} faces")
    if at + vertices * width > len(numbers):
        raise early_end(vertices, "vertex", (len(numbers) - at) // width)
    table = np.frombuffer(body, ">f4", vertices * width, 4 * at).reshape(vertices, width).astype(np.float64)
    at += vertices * width
    words, at = numbers[at:].tolist(), 0
    sides: list[int] = []
    corners: list[int] = []
    while len(sides) < faces:
        count = words[at] if at < len(words) else -1
        colours = at + 1 + count
        if count < 0 or colours >= len(words) or words[colours] < 0:
            raise early_end(faces, "face", len(sides))
        sides.append(count)
        corners += words[at + 1 : colours]
        at = colours + 1 + words[colours]
    if at > len(words):
        raise early_end(faces, "face", len(sides) - 1)
    _require_faces(faces, len(sides), 4 * (len(words) - at), "byte")
    points = layout.points(table[:, : layout.numbers])
    return FileSurface.of(points, np.array(corners, np.int64), sides=sides)


OFF = SurfaceReader.of_content(
    read_object_file,
    misread=re.compile(rb"^[ \t]*(?:ST|C|N)*4n?OFF", re.MULTILINE),  # a reader divided by no w
)
