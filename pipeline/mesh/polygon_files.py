"""Surfaces in files with their polygons: Wavefront OBJ, Object File Format (OFF), Polygon File Format (PLY).

OBJ by its specification (Wavefront, Advanced Visualizer, Appendix B), with crease tags as OpenSubdiv writes
them: ``t crease 2/1/0 a b sharpness``, vertices numbered from 0. PLY (Turk 1994) as text or binary.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain, islice, pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.arrays import AnyArray, Points
from pipeline.mesh.early_ends import early_end


class FileSurface(NamedTuple):
    """Polygons as a file has them, not yet merged or checked.

    points   float64 (V, 3)
    offsets  int64 (F + 1,): face f has the corners ``corners[offsets[f]:offsets[f + 1]]``
    corners  int64 (C,), from 0
    groups   int64 (F,): edges between faces with different numbers are creases
    tagged   int64 (K, 2): edges that the file itself marks as creases
    base     number of the first vertex and the first face in the file; None in formats without numbers, whose
             faces share no vertices
    """

    points: Points
    offsets: AnyArray
    corners: AnyArray
    groups: AnyArray
    tagged: AnyArray
    base: int | None = 0

    @property
    def shares_vertices(self) -> bool:
        return self.base is not None


def file_surface(
    points: Points,
    faces: Sequence[Sequence[int]] | AnyArray,
    groups: Sequence[int] | None = None,
    tagged: Sequence[tuple[int, int]] = (),
    base: int | None = 0,
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
        first = base or 0
        raise ValueError(
            f"face {face + first} names vertex {corners[c] + first}; the file has {len(points)} vertices, "
            f"numbered from {first}"
        )
    alike = np.zeros(len(faces), np.int64) if groups is None else np.array(groups, np.int64)
    return FileSurface(points, offsets, corners, alike, np.array(tagged, np.int64).reshape(-1, 2), base)


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
        raise ValueError(f"vertex {short + 1} has {len(points[short])} coordinates, not 3")
    return file_surface(np.array(points, np.float64).reshape(-1, 3), faces, groups, tagged, base=1)


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
    rows = (words for _, words in _statements(path))
    first = next(rows, [])
    if first and first[0].upper().endswith("OFF"):
        first = first[1:] or next(rows, [])
    if len(first) < 2:
        raise ValueError("it has no OFF header")
    vertices, faces = int(first[0]), int(first[1])
    points = [[float(word) for word in row[:3]] for row in islice(rows, vertices)]
    if len(points) < vertices:
        raise early_end(vertices, "vertex", len(points))
    corners: list[list[int]] = []
    for row in islice(rows, faces):
        count = int(row[0])
        if len(row) <= count:
            raise ValueError(f"face {len(corners)} has {len(row) - 1} of its {count} corners")
        corners.append([int(word) for word in row[1 : count + 1]])
    if len(corners) < faces:
        raise early_end(faces, "face", len(corners))
    return file_surface(np.array(points, np.float64).reshape(-1, 3), corners)


_OLD_NAMES = {
    "char": "int8",
    "uchar": "uint8",
    "short": "int16",
    "ushort": "uint16",
    "int": "int32",
    "uint": "uint32",
    "float": "float32",
    "double": "float64",
}
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_CORNERS = ("vertex_indices", "vertex_index")

Column = AnyArray | list[AnyArray]


class _Property(NamedTuple):
    """`length` is the type of a list's length, or empty for a single number."""

    name: str
    kind: str
    length: str = ""


class _Element(NamedTuple):
    name: str
    rows: int
    properties: list[_Property]


def read_polygon_file(path: Path) -> FileSurface:
    """Read vertices and faces of a PLY file; other elements are skipped.

    Raises ValueError for unreadable input.
    """
    tables = read_elements(path)
    vertex, face = tables.get("vertex", {}), tables.get("face", {})
    if not {"x", "y", "z"} <= set(vertex):
        raise ValueError("its vertices have no x, y and z")
    corners: Column = next((face[name] for name in _CORNERS if name in face), [])
    points = np.column_stack([np.asarray(vertex[axis], np.float64) for axis in "xyz"])
    if isinstance(corners, np.ndarray):
        return file_surface(points, corners)
    return file_surface(points, [part.tolist() for part in corners])


def read_elements(path: Path) -> dict[str, dict[str, Column]]:
    """Return every element of a PLY file by name: its properties, each an array or a list of arrays.

    Raises ValueError for unreadable input.
    """
    data = path.read_bytes()
    head, mark, body = data.partition(b"end_header")
    lines = head.decode("ascii", "replace").splitlines()
    if not mark or not lines or lines[0].strip() != "ply":
        raise ValueError("it has no PLY header")
    order, elements = _header(lines[1:])
    body = body[body.index(b"\n") + 1 :]
    return dict(_text(elements, body.split()) if order == "=" else _binary(elements, body, order))


def _header(lines: list[str]) -> tuple[str, list[_Element]]:
    order, elements = "", []
    for line in lines:
        match line.split():
            case ["format", name, *_]:
                order = _ORDERS[name]
            case ["element", name, rows]:
                elements.append(_Element(name, int(rows), []))
            case ["property", "list", length, kind, name]:
                elements[-1].properties.append(_Property(name, _type(kind), _type(length)))
            case ["property", kind, name]:
                elements[-1].properties.append(_Property(name, _type(kind)))
    if not order:
        raise ValueError("its header names no format")
    return order, elements


def _type(name: str) -> str:
    """Return numpy's short name of a type, without its byte order."""
    return np.dtype(_OLD_NAMES.get(name, name)).str[1:]


def _text(elements: list[_Element], words: list[bytes]) -> Iterator[tuple[str, dict[str, Column]]]:
    at = 0
    for element in elements:
        name, rows, properties = element
        table = _even_text(element, words, at)
        if table is not None:
            at += rows * sum(1 if values.ndim == 1 else 1 + values.shape[1] for values in table.values())
            yield name, dict(table)
            continue
        columns: dict[str, list[AnyArray]] = {p.name: [] for p in properties}
        for row in range(rows):
            for p in properties:
                size = int(words[at]) if p.length and at < len(words) else 1
                at += bool(p.length)
                if at + size > len(words):
                    raise early_end(rows, name, row)
                columns[p.name].append(np.array(words[at : at + size]).astype(p.kind))
                at += size
        yield name, {p.name: _column(p, columns[p.name]) for p in properties}


def _even_text(element: _Element, words: list[bytes], at: int) -> dict[str, AnyArray] | None:
    """Read all rows at once, if each list is as long in every row as in the first; None otherwise."""
    places: dict[str, int] = {}
    width = 0
    for p in element.properties:
        places[p.name] = width
        if at + width >= len(words):
            return None
        size = int(words[at + width]) if p.length else 0
        if size < 0:
            return None
        width += 1 + size
    if not element.rows or at + width * element.rows > len(words):
        return None
    table = np.array(words[at : at + width * element.rows]).reshape(element.rows, width)
    ends = [*list(places.values())[1:], width]
    columns: dict[str, AnyArray] = {}
    for p, end in zip(element.properties, ends, strict=True):
        start = places[p.name]
        if p.length and (table[:, start].astype(np.int64) != end - start - 1).any():
            return None
        columns[p.name] = (
            table[:, start + 1 : end].astype(p.kind) if p.length else table[:, start].astype(p.kind)
        )
    return columns


def _column(p: _Property, cells: list[AnyArray]) -> Column:
    return cells if p.length else np.concatenate([*cells, np.empty(0, p.kind)])


def _binary(elements: list[_Element], body: bytes, order: str) -> Iterator[tuple[str, dict[str, Column]]]:
    at = 0
    for element in elements:
        table = _even_rows(element, body, order, at)
        if table is None:
            columns, at = _uneven_rows(element, body, order, at)
        else:
            columns, at = {p.name: table[p.name] for p in element.properties}, at + table.nbytes
        yield element.name, columns


def _even_rows(element: _Element, body: bytes, order: str, at: int) -> AnyArray | None:
    """Read all rows at once, if each list is as long in every row as in the first; None otherwise."""
    fields: list[tuple[str, str, int]] = []
    for p in element.properties:
        size = 1
        if p.length:
            before = np.dtype([(name, kind, (count,)) for name, kind, count in fields]).itemsize
            if at + before + np.dtype(p.length).itemsize > len(body):
                return None
            size = int(np.frombuffer(body, order + p.length, 1, at + before)[0]) if element.rows else 0
            fields.append((f"length of {p.name}", order + p.length, 1))
        fields.append((p.name, order + p.kind, size))
    row = np.dtype([(n, k, (count,) if count != 1 or n in _lists(element) else ()) for n, k, count in fields])
    if at + row.itemsize * element.rows > len(body):
        return None
    table = np.frombuffer(body, row, element.rows, at)
    even = all((table[f"length of {name}"] == row[name].shape[0]).all() for name in _lists(element))
    return table if even else None


def _lists(element: _Element) -> set[str]:
    return {p.name for p in element.properties if p.length}


def _uneven_rows(element: _Element, body: bytes, order: str, at: int) -> tuple[dict[str, Column], int]:
    columns: dict[str, list[AnyArray]] = {p.name: [] for p in element.properties}
    for row in range(element.rows):
        for p in element.properties:
            size = 1
            if p.length and at + np.dtype(p.length).itemsize <= len(body):
                length = np.frombuffer(body, order + p.length, 1, at)
                at, size = at + length.nbytes, int(length[0])
            if at + size * np.dtype(p.kind).itemsize > len(body):
                raise early_end(element.rows, element.name, row)
            cell = np.frombuffer(body, order + p.kind, size, at)
            at += cell.nbytes
            columns[p.name].append(cell)
    return {p.name: _column(p, columns[p.name]) for p in element.properties}, at
