"""Models in COLLADA files, .dae (Khronos, COLLADA 1.4.1 and 1.5.0 specifications), with nodes and instances.

Skeletons, blend shapes and animations are not applied: nodes stand where their elements place them.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from flowsculpt import MeshError
from flowsculpt.api import quote, shorten
from flowsculpt.api.files import InputFile, number_fault
from flowsculpt.api.meshes import FileSurface, Floats, SurfaceReader
from flowsculpt.pipeline.plugins.interchange.scene_readers import (
    PlacedMeshes,
    Polygons,
    bound_note,
    joined,
    known_unit,
    one_file,
    require_vertices,
)
from flowsculpt.pipeline.plugins.interchange.xml_elements import Element, parse_elements

_LINES = ("lines", "linestrips")


def read_geometry(mesh: Element, left_out: Counter[str]) -> Polygons:
    """Return the faces of a `mesh` element; edges between its materials are creases.

    Counts what is not read. Raises MeshError, with its line, for contradictions, and for polygons with holes.
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
        for holed in element.all("ph"):
            raise MeshError(
                f"line {holed.line}: a polygon has holes (ph), which are not read. Triangulate the model in "
                "the program that made it."
            )
        numbers = [_vertices(element, text) for text in element.all("p")]
        counts, named = _PRIMITIVES[element.name](element, numbers)
        _require_count(element, counts, numbers)
        require_vertices(named, counts, len(points), f"line {element.line}")
        sides.append(counts)
        corners.append(named)
        group = symbols.setdefault(element.attributes.get("material", ""), len(symbols))
        groups.append(np.full(len(counts), group))
    return Polygons(points, np.concatenate(sides), np.concatenate(corners), groups=np.concatenate(groups))


def _points(mesh: Element, sources: dict[str, Element]) -> Floats:
    """Return the positions (V, 3) that the vertices of a mesh name; none where it has none."""
    vertices = mesh.first("vertices")
    named = [] if vertices is None else [i for i in vertices.all("input") if _semantic(i) == "POSITION"]
    if not named:
        return np.empty((0, 3))
    source = sources.get(named[0].attributes.get("source", "").removeprefix("#"))
    array = None if source is None else source.first("float_array")
    if source is None or array is None:
        raise MeshError(f"line {named[0].line}: its vertices name positions that are not there")
    values = _numbers(array, float)
    accessor = source.first("technique_common", "accessor")
    if accessor is None:
        return values[: len(values) // 3 * 3].reshape(-1, 3)
    count, stride = _number(accessor, "count", 0), _number(accessor, "stride", 1)
    offset = _number(accessor, "offset", 0)
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


def _vertices(element: Element, text: Element) -> np.ndarray:
    """Return the vertices (C,) that a `p` element names, without the other inputs of its corners."""
    inputs = [(_number(i, "offset", 0), _semantic(i)) for i in element.all("input")]
    offsets = [offset for offset, semantic in inputs if semantic == "VERTEX"]
    numbers = _numbers(text, int)
    if not len(numbers):
        return numbers
    stride = max(offset for offset, _ in inputs) + 1 if inputs else 1
    if len(offsets) != 1 or min(offsets) < 0:
        raise MeshError(f"line {element.line}: its {element.name} have {len(offsets)} inputs VERTEX, not one")
    if len(numbers) % stride:
        raise MeshError(
            f"line {text.line}: its {len(numbers)} numbers cannot be divided into corners of {stride}"
        )
    return numbers.reshape(-1, stride)[:, offsets[0]]


def _require_count(element: Element, sides: np.ndarray, numbers: list[np.ndarray]) -> None:
    """Raise MeshError where a set of faces has another number of them than it says."""
    promised = _number(element, "count", -1)
    present = len(numbers) if element.name in ("tristrips", "trifans") else len(sides)
    if promised not in (-1, present):
        raise MeshError(f"line {element.line}: its {element.name} promise {promised}; there are {present}")


def _triangles(element: Element, lists: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    corners = _joined(lists)
    if len(corners) % 3:
        raise MeshError(f"line {element.line}: its triangles have {len(corners)} corners in all")
    return np.full(len(corners) // 3, 3), corners


def _polylist(element: Element, lists: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    given = element.first("vcount")
    sides = np.empty(0, np.int64) if given is None else _numbers(given, int)
    corners = _joined(lists)
    if (sides < 0).any() or sides.sum() != len(corners):
        raise MeshError(f"line {element.line}: vcount asks for {sides.sum()} corners; p has {len(corners)}")
    return sides, corners


def _polygons(element: Element, lists: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    return np.array([len(corners) for corners in lists], np.int64), _joined(lists)


def _strips(element: Element, lists: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    strips = [np.column_stack([strip[:-2], strip[1:-1], strip[2:]]) for strip in lists]
    for rows in strips:
        rows[1::2] = rows[1::2, [1, 0, 2]]  # every other one runs the other way round
    return _triangles(element, [rows.reshape(-1) for rows in strips])


def _fans(element: Element, lists: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    fans = [np.column_stack([np.repeat(f[:1], max(len(f) - 2, 0)), f[1:-1], f[2:]]) for f in lists]
    return _triangles(element, [rows.reshape(-1) for rows in fans])


_PRIMITIVES = {
    "triangles": _triangles,
    "polylist": _polylist,
    "polygons": _polygons,
    "tristrips": _strips,
    "trifans": _fans,
}


def _joined(lists: list[np.ndarray]) -> np.ndarray:
    return np.concatenate([np.empty(0, np.int64), *lists])


def _semantic(element: Element) -> str:
    return element.attributes.get("semantic", "")


def _number(element: Element, name: str, default: int) -> int:
    """Return an attribute that is an integer. Raises MeshError for another one."""
    text = element.attributes.get(name, "").strip()
    try:
        return int(text) if text else default
    except ValueError:
        raise MeshError(f"line {element.line}: its {name} {quote(text)} is not an integer") from None


def _numbers(element: Element, kind: type[float] | type[int]) -> np.ndarray:
    """Return the numbers (N,) of an element's text. Raises MeshError, with its line, for other words."""
    words = element.text.split()
    try:
        return np.fromiter(map(kind, words), np.float64 if kind is float else np.int64, len(words))
    except (ValueError, OverflowError) as error:
        fault = number_fault([word.encode() for word in words], kind) or shorten(error)
        raise MeshError(f"line {element.line}: {fault}") from None


MOST_NODES = 50_000  # nodes that are visited; those of instances count each time
_DEEPEST = 200  # nodes within nodes

_X_UP = np.array([[0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""Turns coordinates with x up, as row vectors, to y up."""

_NAMED = ("geometry", "controller", "node", "visual_scene")  # elements that others refer to by their ids


def read_collada(content: bytes) -> FileSurface:
    """Read the meshes of a scene as one surface, in the coordinates and units of the file.

    Edges between meshes, and between the materials of each, are creases. A file with x up is turned to y up.
    Raises MeshError, with its line, for a scene that contradicts itself or refers to other files.
    """
    root = parse_elements(content)
    if root.name != "COLLADA":
        raise MeshError(f"its XML is {quote(root.name)}, not COLLADA")
    scene = _Scene(root)
    scene.add_all()
    if not scene.placed.parts:
        words = scene.placed.left_out_words
        others = f" Left out: {words}." if words else ""
        raise MeshError(f"it has no mesh.{others} Export the model as meshes.")
    return joined(scene.placed.parts, scene.notes())._replace(unit=_unit(root))


def up_of_collada(content: bytes) -> str:
    """Return the axis that points up in the coordinates of `read_collada`: y or z."""
    return "z" if _up_axis(parse_elements(content, until="asset")) == "Z_UP" else "y"


def _up_of(path: Path, digest: str) -> str:
    return up_of_collada(InputFile(path, 1 << 30).content())


COLLADA = SurfaceReader.of_content(read_collada, one_file(_up_of), states_up=True)


def _up_axis(root: Element) -> str:
    axis = root.first("asset", "up_axis")
    return "Y_UP" if axis is None else axis.text.strip().upper()


def _unit(root: Element) -> float | None:
    unit = root.first("asset", "unit")
    try:
        return 1.0 if unit is None else known_unit(float(unit.attributes.get("meter", "1").replace(",", ".")))
    except ValueError:
        return None


@dataclass
class _Scene:
    """Collects the meshes of the nodes of a file; a skeleton or blend shapes would move `bound` of them."""

    root: Element
    placed: PlacedMeshes = field(default_factory=PlacedMeshes)
    bound: int = 0
    _named: dict[tuple[str, str], Element] = field(default_factory=dict)
    _read: dict[int, Polygons] = field(default_factory=dict)
    _nodes: int = 0

    def add_all(self) -> None:
        """Add the meshes of the scene, or of all geometries where there is none."""
        waiting = [self.root]
        while waiting:
            element = waiting.pop()
            if element.name in _NAMED and "id" in element.attributes:
                self._named.setdefault((element.name, element.attributes["id"]), element)
            waiting += element.children
        turn = _X_UP if _up_axis(self.root) == "X_UP" else np.eye(4)
        shown = self.root.first("scene", "instance_visual_scene")
        scene = self._target(shown, "visual_scene") if shown is not None else None
        scene = scene or self.root.first("library_visual_scenes", "visual_scene")
        if scene is not None:
            for node in scene.all("node"):
                self._add_node(node, turn, 0)
            return
        for library in self.root.all("library_geometries"):
            for geometry in library.all("geometry"):
                self._add_geometry(geometry, turn)

    def _add_node(self, node: Element, parent: Floats, depth: int) -> None:
        """Add the meshes of a node and those below it; `parent` places its parent, as row vectors."""
        self._nodes += 1
        if depth > _DEEPEST or self._nodes > MOST_NODES:
            raise MeshError(
                f"line {node.line}: over {MOST_NODES} nodes with instances, or {_DEEPEST} within each other, "
                "or nodes that refer to each other. Export the model without instances."
            )
        matrix = parent
        for child in node.children:
            if child.name in _TRANSFORMS:
                matrix = _transform(child) @ matrix
        for child in node.children:
            match child.name:
                case "node":
                    self._add_node(child, matrix, depth + 1)
                case "instance_node":
                    self._add_node(self._target(child, "node"), matrix, depth + 1)
                case "instance_geometry":
                    self._add_geometry(self._target(child, "geometry"), matrix)
                case "instance_controller":
                    self.bound += 1
                    self._add_geometry(self._bound_geometry(child), matrix)

    def _bound_geometry(self, instance: Element) -> Element:
        """Return the geometry that a controller, or a controller of a controller, moves."""
        controller = self._target(instance, "controller")
        for _ in range(_DEEPEST):
            mover = controller.first("skin") or controller.first("morph")
            if mover is None:
                break
            if ("controller", _identifier(mover, "source")) not in self._named:
                return self._target(mover, "geometry", "source")
            controller = self._target(mover, "controller", "source")
        raise MeshError(f"line {instance.line}: its controller has no geometry")

    def _add_geometry(self, geometry: Element, matrix: Floats) -> None:
        mesh = geometry.first("mesh")
        if mesh is None:
            kinds = {child.name for child in geometry.children} & {"spline", "convex_mesh", "brep"}
            self.placed.left_out[min(kinds, default="empty geometry")] += 1
            return
        if id(mesh) not in self._read:
            self._read[id(mesh)] = read_geometry(mesh, self.placed.left_out)
        if len(self._read[id(mesh)].sides):
            self.placed.add(self._read[id(mesh)], matrix)

    def _target(self, element: Element, kind: str, attribute: str = "url") -> Element:
        """Return the element that another refers to. Raises MeshError where it is not in the file."""
        address = element.attributes.get(attribute, "").strip()
        if not address.startswith("#") and ("#" in address or "." in address):
            raise MeshError(
                f"line {element.line}: it refers to {quote(address)}, in another file, which is not "
                "read. Export the model as one file."
            )
        target = self._named.get((kind, _identifier(element, attribute)))
        if target is None:
            raise MeshError(f"line {element.line}: it refers to a missing {kind}, {quote(address)}")
        return target

    def notes(self) -> list[str]:
        """Return lines about what was not read as other programs show it."""
        words = self.placed.left_out_words
        left_out = [f"left out, as they are not meshes: {words}"] if words else []
        return [*([bound_note(self.bound)] if self.bound else []), *left_out]


def _identifier(element: Element, attribute: str) -> str:
    return unquote(element.attributes.get(attribute, "").strip().removeprefix("#"))


_TRANSFORMS = {"matrix": 16, "translate": 3, "rotate": 4, "scale": 3, "lookat": 9, "skew": 7}
"""Elements that place a node, and how many numbers each has."""


def _transform(element: Element) -> Floats:
    """Return the matrix (4, 4) of row vectors of an element that places a node. Raises MeshError."""
    values, count = _numbers(element, float), _TRANSFORMS[element.name]
    if len(values) != count:
        raise MeshError(f"line {element.line}: {element.name} has {len(values)} numbers, not {count}")
    matrix = np.eye(4)
    match element.name:
        case "matrix":
            return values.reshape(4, 4).T
        case "translate":
            matrix[3, :3] = values
        case "scale":
            matrix[[0, 1, 2], [0, 1, 2]] = values
        case "rotate":
            (x, y, z), angle = _unit_vector(values[:3]), np.deg2rad(values[3])
            across = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
            turn = np.sin(angle) * across, (1.0 - np.cos(angle)) * (across @ across)
            matrix[:3, :3] = matrix[:3, :3] + turn[0] + turn[1]
        case "lookat":
            back = _unit_vector(values[:3] - values[3:6])
            right = _unit_vector(np.cross(values[6:], back))
            matrix[:3, :3] = right, np.cross(back, right), back
            matrix[3, :3] = values[:3]
        case _:
            raise MeshError(
                f"line {element.line}: a node has a skew transform, which is not supported. Export it as a "
                "matrix."
            )
    return matrix


def _unit_vector(vector: Floats) -> Floats:
    return vector / (np.linalg.norm(vector) or 1.0)
