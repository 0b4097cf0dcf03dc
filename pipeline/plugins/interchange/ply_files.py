"""Surfaces and points in the Polygon File Format, PLY (Turk 1994), as text or binary."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flowsculpt import MeshError
from flowsculpt.api import plural
from flowsculpt.api.files import InputFile, number_fault, text_content
from flowsculpt.api.meshes import FileSurface, Floats, SurfaceReader
from flowsculpt.pipeline.plugins.interchange.scene_readers import early_end

AnyArray = NDArray[Any]

MOST_BYTES = 1 << 30  # size of the largest file

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
_STRIPS, _GRID = "tristrips", "range_grid"

_END = re.compile(rb"[\r\n][ \t]*end_header[ \t]*(?=[\r\n]|\Z)")
_FIRST_LINE = re.compile(rb"(?:\xef\xbb\xbf)?\s*ply[ \t]*(\r\n|\n\r|\r|\n)")

_LONGEST_WORD = 64  # characters of a number in a text file, which numpy reserves for each of them


class Lists(NamedTuple):
    """A property that is a list in every row.

    lengths  (rows,)
    values   those of all rows, one after another; (rows, n) where all lists have n
    """

    lengths: AnyArray
    values: AnyArray

    def joined(self, others: Lists) -> Lists:
        """Return these lists and then others."""
        values = np.concatenate([self.values.reshape(-1), others.values.reshape(-1)])
        return Lists(np.concatenate([self.lengths, others.lengths]), values)


Column = AnyArray | Lists
Table = dict[str, Column]


class _Property(NamedTuple):
    name: str
    kind: str
    length: str = ""  # the type of a list's length; empty for a single number


class _Element(NamedTuple):
    name: str
    rows: int
    properties: list[_Property]


def read_polygon_file(content: bytes) -> FileSurface:
    """Read vertices, faces and triangle strips of a PLY file; other elements are skipped.

    Raises ValueError for unreadable input, MeshError for a range grid without faces.
    """
    tables = read_elements(content)
    faces = Lists(*np.empty((2, 0), np.int64))
    if _rows(tables, "face"):
        faces = _corners("face", tables["face"])
    if _rows(tables, _STRIPS):
        faces = faces.joined(_triangles_of(_corners(_STRIPS, tables[_STRIPS], restarts=True)))
    if not len(faces.lengths) and _rows(tables, _GRID):
        fact = f"it has a scanner's grid of ranges ({_GRID}) and no faces"
        raise MeshError(f"{fact}. Export faces from the scanner's program.")
    surface = FileSurface.of(_vertex_positions(tables), faces.values.reshape(-1), sides=faces.lengths)
    vertex = tables.get("vertex", {})
    normals, creases = _vectors(vertex, "nx", "ny", "nz"), vertex.get("crease")
    if normals is not None and isinstance(creases, np.ndarray):
        normals[creases != 0] = 0.0  # there one normal is wrong on either side
    return surface._replace(velocities=_velocities(vertex), normals=normals)


def _read_vertices(path: Path) -> tuple[Floats, dict[str, AnyArray]]:
    """Return the positions (V, 3) of the vertices of a PLY file, and its other numbers of each (V,), by name.

    Raises ValueError for unreadable input, and where vertices have no positions.
    """
    tables = read_elements(InputFile(path, MOST_BYTES).content())
    others = {
        name: column
        for name, column in tables.get("vertex", {}).items()
        if name not in ("x", "y", "z") and isinstance(column, np.ndarray)
    }
    return _vertex_positions(tables), others


_VELOCITIES = (
    *((f"{name}x", f"{name}y", f"{name}z") for name in ("v", "velocity_", "velocity", "velocities_", "vel_")),
    *((f"{name}{k}", f"{name}{k + 1}", f"{name}{k + 2}") for name in ("velocity_", "v_") for k in (0, 1)),
)
"""Names of the components of velocities, as programs write them as three properties of vertices."""


def _velocities(vertex: Table) -> Floats | None:
    """Return the velocities (V, 3) of vertices; None where the file has none."""
    named = {name.lower().lstrip("."): column for name, column in vertex.items()}
    for name in ("velocity", "velocities", "v"):
        column = named.get(name)
        if isinstance(column, Lists) and column.values.ndim == 2 and column.values.shape[1] == 3:
            return np.asarray(column.values, np.float64)
    return next((found for names in _VELOCITIES if (found := _vectors(named, *names)) is not None), None)


def _vectors(vertex: Table, *names: str) -> Floats | None:
    """Return the vectors (V, 3) whose components three properties of vertices are; None without them."""
    columns = [column for name in names if isinstance(column := vertex.get(name), np.ndarray)]
    return np.column_stack(columns).astype(np.float64) if len(columns) == 3 else None


def _rows(tables: dict[str, Table], element: str) -> int:
    """Return how many rows an element has; 0 where there is none."""
    column = next(iter(tables.get(element, {}).values()), ())
    return len(column.lengths) if isinstance(column, Lists) else len(column)


def _vertex_positions(tables: dict[str, Table]) -> Floats:
    """Return the positions (V, 3) of the vertices. Raises ValueError where they have none."""
    vertex = tables.get("vertex", {})
    columns = [column for axis in "xyz" if isinstance(column := vertex.get(axis), np.ndarray)]
    if len(columns) < 3:
        raise ValueError("its vertices have no x, y and z")
    return np.column_stack([np.asarray(column, np.float64) for column in columns])


def _corners(element: str, table: Table, restarts: bool = False) -> Lists:
    """Return the vertices that the rows of an element name. Raises ValueError where they name none.

    restarts  whether the largest number of an unsigned type stands for -1
    """
    lists = next((table[name] for name in _CORNERS if name in table), None)
    if not isinstance(lists, Lists):
        raise ValueError(f"its header gives {element} no list of {' or '.join(_CORNERS)}")
    vertices = lists.values.astype(np.int64)
    if lists.values.dtype.kind == "f" and (vertices != lists.values).any():
        raise ValueError(f"its {element} names vertices by numbers that are not integers")
    if restarts and lists.values.dtype.kind == "u":
        vertices[vertices == np.iinfo(lists.values.dtype).max] = -1
    return Lists(lists.lengths, vertices)


def _triangles_of(strips: Lists) -> Lists:
    """Return the triangles of strips: every second one is turned over, and -1 begins another strip.

    Triangles that name a vertex twice only lead the strip elsewhere, and are left out.
    """
    ends = np.full(len(strips.lengths), -1)  # each list is a strip of its own too
    vertices = np.insert(strips.values.reshape(-1), np.cumsum(strips.lengths), ends)
    places = np.arange(len(vertices))
    begins = np.maximum.accumulate(np.where(vertices == -1, places + 1, 0))
    a, b, c = vertices[:-2], vertices[1:-1], vertices[2:]
    odd = (places[:-2] - begins[:-2]) % 2 == 1
    triangles = np.column_stack([np.where(odd, b, a), np.where(odd, a, b), c])
    whole = (triangles != -1).all(axis=1) & (a != b) & (b != c) & (a != c)
    return Lists(np.full(int(whole.sum()), 3), triangles[whole])


def read_elements(content: bytes) -> dict[str, Table]:
    """Return every element of a PLY file by name: its properties, each an array or lists.

    Counts are compared with the bytes that are there before any array is made.

    Raises ValueError for unreadable input.
    """
    if not _FIRST_LINE.match(content):  # it may be text of two or four bytes a character
        content = text_content(content)
    first, end = _FIRST_LINE.match(content), _END.search(content)
    if not first or not end:
        raise ValueError("it has no PLY header")
    order, elements = _header(content[first.end() : end.start()].splitlines())
    starts = _body_starts(content[end.end() : end.end() + 2], first[1])
    if order == "=":
        return _text(elements, _words(content[end.end() :]))
    for start in starts:
        try:
            return _binary(elements, content, order, end.end() + start)
        except ValueError:
            if start == starts[-1]:
                raise
    raise AssertionError("a header has an end")


def _body_starts(after: bytes, line_end: bytes) -> list[int]:
    """Return how many bytes may end the header; of two numbers, the one that leaves a whole body is right.

    after     two bytes behind `end_header`
    line_end  of the header's first line; the body of a file whose lines end in CR may begin with LF
    """
    if after not in (b"\r\n", b"\n\r"):
        return [min(1, len(after))]
    if line_end == after:
        return [2]
    return [1, 2] if line_end == after[:1] else [2, 1]


def _words(body: bytes) -> list[bytes]:
    words = body.split()
    longest = max(words, key=len, default=b"")
    if len(longest) > _LONGEST_WORD:
        raise ValueError(f"{longest[:20].decode('ascii', 'replace')}… has {len(longest)} digits")
    return words


def _header(lines: list[bytes]) -> tuple[str, list[_Element]]:
    order, elements = "", list[_Element]()
    for line in (line.decode("utf-8", "replace") for line in lines):
        match line.split():
            case ["format", name, *_]:
                order = _ORDERS.get(name, "")
                if not order:
                    raise ValueError(f"its format {name[:40]} is not one of {', '.join(_ORDERS)}")
            case ["element", name, rows] if rows.isdecimal() and all(e.name != name for e in elements):
                elements.append(_Element(name, int(rows), []))
            case ["property", *_] if not elements:
                raise ValueError("its header has a property before the first element")
            case ["property", "list", length, kind, name]:
                elements[-1].properties.append(_Property(name, _type(kind), _type(length)))
            case ["property", kind, name] if kind != "list":
                elements[-1].properties.append(_Property(name, _type(kind)))
            case ["format" | "element" | "property", *_]:
                raise ValueError(f"its header has the line {' '.join(line.split())[:60]}")
    if not order:
        raise ValueError("its header names no format")
    for element in elements:
        names = [p.name for p in element.properties]
        if len(set(names)) < len(names):
            raise ValueError(f"its header names a property of {element.name[:40]} twice")
        if any(np.dtype(p.length).kind == "f" for p in element.properties if p.length):
            raise ValueError(f"its header gives lists of {element.name[:40]} lengths that are not integers")
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


def _require_end(elements: list[_Element], rest: int, item: str) -> None:
    """Raise ValueError where something follows the last element."""
    if rest and elements:
        raise ValueError(
            f"its header promises less than it holds: {plural(rest, item)} after {elements[-1].name[:40]} "
            f"{elements[-1].rows - 1}"
        )


def _text(elements: list[_Element], words: list[bytes]) -> dict[str, Table]:
    tables: dict[str, Table] = {}
    at = 0
    for element in elements:
        _require_rows(element, [1 for _ in element.properties], len(words) - at)
        tables[element.name], at = _even_text(element, words, at) or _uneven_text(element, words, at)
    _require_end(elements, len(words) - at, "number")
    return tables


def _even_text(element: _Element, words: list[bytes], at: int) -> tuple[Table, int] | None:
    """Read all rows at once, if each list is as long in every row as in the first; None otherwise."""
    places: list[int] = []
    width = 0
    for p in element.properties:
        places.append(width)
        if at + width >= len(words):
            return None
        size = _length(words[at + width], p) if p.length else 0
        width += 1 + size
    if not element.rows or at + width * element.rows > len(words):
        return None
    cells = np.array(words[at : at + width * element.rows]).reshape(element.rows, width)
    table: Table = {}
    for p, start, end in zip(element.properties, places, [*places[1:], width], strict=True):
        if not p.length:
            table[p.name] = _numbers(cells[:, start], p.kind, f"{element.name} {{}}")
            continue
        if (cells[:, start] != cells[0, start]).any():
            return None
        lengths = np.full(element.rows, end - start - 1)
        table[p.name] = Lists(lengths, _numbers(cells[:, start + 1 : end], p.kind, p.name))
    return table, at + width * element.rows


def _uneven_text(element: _Element, words: list[bytes], at: int) -> tuple[Table, int]:
    values: dict[str, list[bytes]] = {p.name: [] for p in element.properties}
    lengths: dict[str, list[int]] = {p.name: [] for p in element.properties if p.length}
    for row in range(element.rows):
        for p in element.properties:
            size = 1
            if p.length and at < len(words):
                size = _length(words[at], p)
                lengths[p.name].append(size)
                at += 1
            if at + size > len(words):
                raise early_end(element.rows, element.name, row)
            values[p.name] += words[at : at + size]
            at += size
    table: Table = {}
    for p in element.properties:
        numbers = _numbers(np.array(values[p.name], bytes), p.kind, p.name)
        table[p.name] = Lists(np.array(lengths[p.name], np.int64), numbers) if p.length else numbers
    return table, at


def _length(word: bytes, p: _Property) -> int:
    if fault := number_fault([word], int):
        raise ValueError(f"the length of a list of {p.name[:40]}: {fault}")
    return _require_length(int(word), p)


def _require_length(size: int, p: _Property) -> int:
    if size < 0:
        raise ValueError(f"a list of {p.name[:40]} has the length {size}")
    return size


def _numbers(words: AnyArray, kind: str, place: str) -> AnyArray:
    """Return words as numbers of a kind, or as float64 where integers are written as 255.0 or are too large.

    place  of the words, for a message; braces stand for the number of a row
    """
    for wanted in (kind, "f8"):
        try:
            return words.astype(wanted)
        except (ValueError, OverflowError):
            continue
    flat = words.reshape(-1).tolist()
    row = next(k for k, word in enumerate(flat) if number_fault([word]))
    raise ValueError(f"{place.format(row)[:60]}: {number_fault([flat[row]])}")


def _binary(elements: list[_Element], content: bytes, order: str, at: int) -> dict[str, Table]:
    tables: dict[str, Table] = {}
    for element in elements:
        sizes = [np.dtype(p.length or p.kind).itemsize for p in element.properties]
        _require_rows(element, sizes, len(content) - at)
        even = _even_rows(element, content, order, at)
        tables[element.name], at = even or _uneven_rows(element, content, order, at)
    rest = content[at:]
    _require_end(elements, len(rest) if rest.strip(b"\0 \r\n\x1a") else 0, "byte")
    return tables


def _even_rows(element: _Element, content: bytes, order: str, at: int) -> tuple[Table, int] | None:
    """Read all rows at once, if each list is as long in every row as in the first; None otherwise."""
    fields: list[tuple[str, str, tuple[int, ...]]] = []
    for p in element.properties:
        if not p.length:
            fields.append((p.name, order + p.kind, ()))
            continue
        place = at + np.dtype(fields).itemsize
        if place + np.dtype(p.length).itemsize > len(content):
            return None
        size = int(np.frombuffer(content, order + p.length, 1, place)[0]) if element.rows else 0
        if place + _require_length(size, p) > len(content):
            return None
        fields += [(_length_of(p), order + p.length, ()), (p.name, order + p.kind, (size,))]
    row = np.dtype(fields)
    if at + row.itemsize * element.rows > len(content):
        return None
    rows = np.frombuffer(content, row, element.rows, at)
    table: Table = {}
    for p in element.properties:
        if not p.length:
            table[p.name] = rows[p.name]
            continue
        lengths = rows[_length_of(p)]
        if (lengths != row[p.name].shape[0]).any():
            return None
        table[p.name] = Lists(lengths, rows[p.name])
    return table, at + rows.nbytes


def _length_of(p: _Property) -> str:
    return f"length of {p.name}"  # no property has a name with blanks


def _uneven_rows(element: _Element, content: bytes, order: str, at: int) -> tuple[Table, int]:
    values: dict[str, list[bytes]] = {p.name: [] for p in element.properties}
    lengths: dict[str, list[int]] = {p.name: [] for p in element.properties if p.length}
    endian: Literal["little", "big"] = "little" if order == "<" else "big"
    sizes = [(p, np.dtype(p.kind).itemsize, np.dtype(p.length or "u1")) for p in element.properties]
    for row in range(element.rows):
        for p, width, length in sizes:
            size = 1
            if p.length:
                after = at + length.itemsize
                size = int.from_bytes(content[at:after], endian, signed=length.kind == "i")
                lengths[p.name].append(_require_length(size, p))
                at = after
            end = at + size * width
            if end > len(content):
                raise early_end(element.rows, element.name, row)
            values[p.name].append(content[at:end])
            at = end
    table: Table = {}
    for p in element.properties:
        numbers: AnyArray = np.frombuffer(b"".join(values[p.name]), order + p.kind)
        table[p.name] = Lists(np.array(lengths[p.name], np.int64), numbers) if p.length else numbers
    return table, at


PLY = SurfaceReader.of_content(  # a reader left out strips of triangles
    read_polygon_file, vertices=_read_vertices, misread=re.compile(rb"[\r\n]element[ \t]+tristrips[ \t]")
)
