"""Polygon File Format (PLY, Turk 1994), text or binary, with its polygons."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.mesh.io.file_surface import FileSurface, file_surface

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
    for name, rows, properties in elements:
        columns: dict[str, list[AnyArray]] = {p.name: [] for p in properties}
        for _ in range(rows):
            for p in properties:
                size = int(words[at]) if p.length else 1
                at += bool(p.length)
                if at + size > len(words):
                    raise ValueError("it ends too early")
                columns[p.name].append(np.array(words[at : at + size]).astype(p.kind))
                at += size
        yield name, {p.name: _column(p, columns[p.name]) for p in properties}


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
    for _ in range(element.rows):
        for p in element.properties:
            size = 1
            if p.length:
                length = np.frombuffer(body, order + p.length, 1, at)
                at, size = at + length.nbytes, int(length[0])
            cell = np.frombuffer(body, order + p.kind, size, at)
            at += cell.nbytes
            columns[p.name].append(cell)
    return {p.name: _column(p, columns[p.name]) for p in element.properties}, at
