"""Meshes of COLLADA geometries: their polygons, in the coordinates of the geometry."""

from __future__ import annotations

from collections import Counter

import numpy as np

from pipeline.arrays import AnyArray, Points
from pipeline.errors import MeshError, brief, shortened
from pipeline.plugins.interchange.placed_meshes import Polygons
from pipeline.plugins.interchange.xml_elements import Element
from pipeline.text_encoding import number_fault

_LINES = ("lines", "linestrips")


def read_geometry(mesh: Element, left_out: Counter[str]) -> Polygons:
    """Return the faces of a `mesh` element; edges between its materials are creases.

    left_out  counts what is not read, by kind

    Raises MeshError, with its line, for what contradicts itself, and for polygons with holes.
    """
    sources = {child.attributes.get("id", ""): child for child in mesh.children}
    points = _points(mesh, sources)
    sides, corners, groups = [np.empty(0, np.int64)], [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    symbols: dict[str, int] = {}
    for element in mesh.children:
        if element.name in _LINES:
            left_out["line set"] += 1
        if element.name not in _PRIMITIVES:
            continue
        numbers = [_vertices(element, text) for text in _index_lists(element)]
        counts, named = _PRIMITIVES[element.name](element, numbers)
        _require_count(element, counts, numbers)
        wrong = np.flatnonzero((named < 0) | (named >= len(points)))
        if len(wrong):
            raise MeshError(
                f"line {element.line}: its {element.name} name vertex {named[wrong[0]]}; the mesh has "
                f"{len(points)}, numbered from 0"
            )
        sides.append(counts)
        corners.append(named)
        group = symbols.setdefault(element.attributes.get("material", ""), len(symbols))
        groups.append(np.full(len(counts), group))
    return Polygons(points, np.concatenate(sides), np.concatenate(corners), groups=np.concatenate(groups))


def _points(mesh: Element, sources: dict[str, Element]) -> Points:
    """Return the positions (V, 3) that the vertices of a mesh name; none where it has none."""
    vertices = mesh.first("vertices")
    named = [] if vertices is None else [i for i in vertices.all("input") if _semantic(i) == "POSITION"]
    if not named:
        return np.empty((0, 3))
    source = sources.get(named[0].attributes.get("source", "").removeprefix("#"))
    array = None if source is None else source.first("float_array")
    if source is None or array is None:
        raise MeshError(f"line {named[0].line}: its vertices name positions that are not there")
    values = _floats(array)
    accessor = source.first("technique_common", "accessor")
    if accessor is None:
        return values[: len(values) // 3 * 3].reshape(-1, 3)
    count, stride, offset = (
        _number(accessor, *given) for given in (("count", 0), ("stride", 1), ("offset", 0))
    )
    if min(count, offset) < 0 or stride < 3 or offset + count * stride > len(values):
        raise MeshError(
            f"line {accessor.line}: its accessor asks for {count} positions of {stride} numbers; "
            f"line {array.line} has {len(values)}"
        )
    names = [param.attributes.get("name", "") for param in accessor.all("param")]
    columns = [names.index(axis) for axis in "XYZ"] if {*"XYZ"} <= set(names) else [0, 1, 2]
    if max(columns) >= stride:
        raise MeshError(f"line {accessor.line}: its accessor has {len(names)} names for {stride} numbers")
    return values[offset : offset + count * stride].reshape(count, stride)[:, columns]


def _index_lists(element: Element) -> list[Element]:
    """Return the `p` elements of a set of faces. Raises MeshError for polygons with holes."""
    for holed in element.all("ph"):
        raise MeshError(
            f"line {holed.line}: a polygon has holes (ph), which are not read. Triangulate the model in the "
            "program that made it."
        )
    return list(element.all("p"))


def _vertices(element: Element, text: Element) -> AnyArray:
    """Return the vertices (C,) that a `p` element names, without the other inputs of its corners."""
    inputs = [(_number(i, "offset", 0), _semantic(i)) for i in element.all("input")]
    offsets = [offset for offset, semantic in inputs if semantic == "VERTEX"]
    numbers = _integers(text)
    if not len(numbers):
        return numbers
    stride = max(offset for offset, _ in inputs) + 1 if inputs else 1
    if len(offsets) != 1 or min(offsets) < 0:
        raise MeshError(f"line {element.line}: its {element.name} have {len(offsets)} inputs VERTEX, not one")
    if len(numbers) % stride:
        raise MeshError(
            f"line {text.line}: it has {len(numbers)} numbers, not a multiple of the {stride} of a corner"
        )
    return numbers.reshape(-1, stride)[:, offsets[0]]


def _require_count(element: Element, sides: AnyArray, numbers: list[AnyArray]) -> None:
    """Raise MeshError where a set of faces has another number of them than it says."""
    promised = _number(element, "count", -1)
    present = len(numbers) if element.name in ("tristrips", "trifans") else len(sides)
    if promised not in (-1, present):
        raise MeshError(
            f"line {element.line}: its {element.name} promise {promised}, and {present} are there"
        )


def _triangles(element: Element, lists: list[AnyArray]) -> tuple[AnyArray, AnyArray]:
    corners = _joined(lists)
    if len(corners) % 3:
        raise MeshError(f"line {element.line}: its triangles have {len(corners)} corners in all")
    return np.full(len(corners) // 3, 3), corners


def _polylist(element: Element, lists: list[AnyArray]) -> tuple[AnyArray, AnyArray]:
    given = element.first("vcount")
    sides = np.empty(0, np.int64) if given is None else _integers(given)
    corners = _joined(lists)
    if (sides < 0).any() or sides.sum() != len(corners):
        raise MeshError(
            f"line {element.line}: its vcount asks for {sides.sum()} corners, and p has {len(corners)}"
        )
    return sides, corners


def _polygons(element: Element, lists: list[AnyArray]) -> tuple[AnyArray, AnyArray]:
    return np.array([len(corners) for corners in lists], np.int64), _joined(lists)


def _strips(element: Element, lists: list[AnyArray]) -> tuple[AnyArray, AnyArray]:
    triangles = [np.empty((0, 3), np.int64)]
    for strip in lists:
        rows = np.column_stack([strip[:-2], strip[1:-1], strip[2:]])
        rows[1::2] = rows[1::2, [1, 0, 2]]  # every other one runs the other way round
        triangles.append(rows)
    corners = np.concatenate(triangles).reshape(-1)
    return np.full(len(corners) // 3, 3), corners


def _fans(element: Element, lists: list[AnyArray]) -> tuple[AnyArray, AnyArray]:
    triangles = [np.empty((0, 3), np.int64)]
    for fan in lists:
        triangles.append(np.column_stack([np.repeat(fan[:1], max(len(fan) - 2, 0)), fan[1:-1], fan[2:]]))
    corners = np.concatenate(triangles).reshape(-1)
    return np.full(len(corners) // 3, 3), corners


_PRIMITIVES = {
    "triangles": _triangles,
    "polylist": _polylist,
    "polygons": _polygons,
    "tristrips": _strips,
    "trifans": _fans,
}


def _joined(lists: list[AnyArray]) -> AnyArray:
    return np.concatenate([np.empty(0, np.int64), *lists])


def _semantic(element: Element) -> str:
    return element.attributes.get("semantic", "")


def _number(element: Element, name: str, default: int) -> int:
    """Return an attribute that is an integer. Raises MeshError for another one."""
    text = element.attributes.get(name, "").strip()
    try:
        return int(text) if text else default
    except ValueError:
        raise MeshError(f"line {element.line}: its {name} {shortened(text)} is not an integer") from None


def _floats(element: Element) -> AnyArray:
    return numbers_in(element, element.text, float).astype(np.float64)


def _integers(element: Element) -> AnyArray:
    return numbers_in(element, element.text, int).astype(np.int64)


def numbers_in(element: Element, text: str, kind: type[float] | type[int]) -> AnyArray:
    """Return the numbers (N,) of a text. Raises MeshError, with the line of its element, for other words."""
    words = text.split()
    try:
        return np.fromiter(map(kind, words), np.float64 if kind is float else np.int64, len(words))
    except (ValueError, OverflowError) as error:
        fault = number_fault([word.encode() for word in words], kind) or brief(error)
        raise MeshError(f"line {element.line}: {fault}") from None
