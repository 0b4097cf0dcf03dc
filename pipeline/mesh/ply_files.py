"""Surfaces and points in the Polygon File Format, PLY (Turk 1994), as text or binary."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.mesh.file_surface import FileSurface, early_end, file_surface

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

_LONGEST_WORD = 64
"""Characters of a number in a text file, which numpy reserves for each of them."""

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


def read_polygon_file(content: bytes) -> FileSurface:
    """Read vertices and faces of a PLY file; other elements are skipped.

    Raises ValueError for unreadable input.
    """
    tables = read_elements(content)
    vertex, face = tables.get("vertex", {}), tables.get("face", {})
    if not {"x", "y", "z"} <= set(vertex):
        raise ValueError("its vertices have no x, y and z")
    corners: Column = next((face[name] for name in _CORNERS if name in face), [])
    points = np.column_stack([np.asarray(vertex[axis], np.float64) for axis in "xyz"])
    if isinstance(corners, np.ndarray):
        return file_surface(points, corners)
    return file_surface(points, [part.tolist() for part in corners])


def read_elements(content: bytes) -> dict[str, dict[str, Column]]:
    """Return every element of a PLY file by name: its properties, each an array or a list of arrays.

    Counts are compared with the bytes that are there before any array is made.

    Raises ValueError for unreadable input.
    """
    head, mark, body = content.partition(b"end_header")
    lines = head.decode("ascii", "replace").splitlines()
    if not mark or not lines or lines[0].strip() != "ply":
        raise ValueError("it has no PLY header")
    order, elements = _header(lines[1:])
    body = body.partition(b"\n")[2]
    return dict(_text(elements, _words(body)) if order == "=" else _binary(elements, body, order))


def _words(body: bytes) -> list[bytes]:
    words = body.split()
    longest = max(words, key=len, default=b"")
    if len(longest) > _LONGEST_WORD:
        raise ValueError(f"{longest[:20].decode('ascii', 'replace')}… has {len(longest)} digits")
    return words


def _header(lines: list[str]) -> tuple[str, list[_Element]]:
    order, elements = "", list[_Element]()
    for line in lines:
        match line.split():
            case ["format", name, *_]:
                order = _ORDERS.get(name, "")
            case ["element", name, rows]:
                if not rows.isdecimal() or any(element.name == name for element in elements):
                    raise ValueError(f"its header has the line {' '.join(line.split())[:60]}")
                elements.append(_Element(name, int(rows), []))
            case ["property", *_] if not elements:
                raise ValueError("its header has a property before the first element")
            case ["property", "list", length, kind, name]:
                elements[-1].properties.append(_Property(name, _type(kind), _type(length)))
            case ["property", kind, name]:
                elements[-1].properties.append(_Property(name, _type(kind)))
    if not order:
        raise ValueError("its header names no format")
    for element in elements:
        names = [p.name for p in element.properties]
        if len(set(names)) < len(names):
            raise ValueError(f"its header names a property of {element.name[:40]} twice")
        if any(np.dtype(p.length).kind == "f" for p in element.properties if p.length):
            raise ValueError(f"its header gives lists of {element.name[:40]} lengths that are no integers")
    return order, [element for element in elements if element.properties]


def _type(name: str) -> str:
    """Return numpy's short name of a type, without its byte order."""
    known = _OLD_NAMES.get(name, name)
    if known not in _OLD_NAMES.values():
        raise ValueError(f"its header has the unknown type {name[:20]}")
    return np.dtype(known).str[1:]


def _require_rows(element: _Element, sizes: list[int], present: int) -> None:
    """Raise ValueError where rows of these least sizes, one a property, are more than what is present."""
    if element.rows * sum(sizes) > present:
        raise early_end(element.rows, element.name[:40], present // sum(sizes))


def _text(elements: list[_Element], words: list[bytes]) -> Iterator[tuple[str, dict[str, Column]]]:
    at = 0
    for element in elements:
        name, rows, properties = element
        _require_rows(element, [1 for _ in properties], len(words) - at)
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
                _require_length(size, p)
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


def _require_length(size: int, p: _Property) -> None:
    if size < 0:
        raise ValueError(f"a list of {p.name[:40]} has the length {size}")


def _column(p: _Property, cells: list[AnyArray]) -> Column:
    return cells if p.length else np.concatenate([*cells, np.empty(0, p.kind)])


def _binary(elements: list[_Element], body: bytes, order: str) -> Iterator[tuple[str, dict[str, Column]]]:
    at = 0
    for element in elements:
        sizes = [np.dtype(p.length or p.kind).itemsize for p in element.properties]
        _require_rows(element, sizes, len(body) - at)
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
            _require_length(size, p)
            if at + before + size > len(body):
                return None
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
                _require_length(size, p)
            if at + size * np.dtype(p.kind).itemsize > len(body):
                raise early_end(element.rows, element.name, row)
            cell = np.frombuffer(body, order + p.kind, size, at)
            at += cell.nbytes
            columns[p.name].append(cell)
    return {p.name: _column(p, columns[p.name]) for p in element.properties}, at
