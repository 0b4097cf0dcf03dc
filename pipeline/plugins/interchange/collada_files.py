"""Models in COLLADA files, .dae (Khronos, COLLADA 1.4.1 and 1.5.0 specifications), with nodes and instances.

Skeletons and blend shapes are not applied, animations neither: nodes stand where their elements place them.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from urllib.parse import unquote

import numpy as np

from pipeline.arrays import Floats
from pipeline.errors import MeshError, shortened
from pipeline.mesh.mesh_formats import FileSurface, known_unit
from pipeline.plugins.interchange.collada_meshes import numbers_in, read_geometry
from pipeline.plugins.interchange.placed_meshes import PlacedMeshes, Polygons, bound_note, joined
from pipeline.plugins.interchange.xml_elements import Element, parse_elements
from render.base.plural import plural

MOST_NODES = 50_000
"""Nodes that are visited; those of instances count each time."""

_DEEPEST = 200
"""Nodes within nodes."""

_X_UP = np.array([[0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""Turns coordinates with x up, as row vectors, to y up."""

_NAMED = ("geometry", "controller", "node", "visual_scene")
"""Elements that others refer to by their ids."""


def read_collada(content: bytes) -> FileSurface:
    """Read the meshes of a scene as one surface, in the coordinates and units of the file.

    Edges between meshes, and between the materials of each, are creases. A file with x up is turned to y up.
    Raises MeshError, with its line, for a scene that contradicts itself or refers to other files.
    """
    root = parse_elements(content)
    if root.name != "COLLADA":
        raise MeshError(f"its XML is {shortened(root.name)}, not COLLADA")
    scene = _Scene(root)
    scene.add_all()
    if not scene.placed.parts:
        others = f" Left out: {scene.left_out_words}." if scene.left_out else ""
        raise MeshError(f"it has no mesh.{others} Export the model as meshes.")
    return joined(scene.placed.parts, scene.notes())._replace(unit=_unit(root))


def up_of_collada(content: bytes) -> str:
    """Return the axis that points up in the coordinates of `read_collada`: y or z."""
    return "z" if _up_axis(parse_elements(content, until="asset")) == "Z_UP" else "y"


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
    """Collects the meshes of the nodes of a file.

    placed    the meshes
    left_out  number of elements of each kind that was not read
    bound     meshes that a skeleton or blend shapes would move
    """

    root: Element
    placed: PlacedMeshes = field(default_factory=lambda: PlacedMeshes("export fewer"))
    left_out: Counter[str] = field(default_factory=Counter)
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
        """Add the meshes of a node and those below it.

        parent  matrix (4, 4) of row vectors that places the node's parent
        """
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
            self.left_out[min(kinds, default="empty geometry")] += 1
            return
        if id(mesh) not in self._read:
            self._read[id(mesh)] = read_geometry(mesh, self.left_out)
        if len(self._read[id(mesh)].sides):
            self.placed.add(self._read[id(mesh)], matrix)

    def _target(self, element: Element, kind: str, attribute: str = "url") -> Element:
        """Return the element that another refers to. Raises MeshError where it is not in the file."""
        address = element.attributes.get(attribute, "").strip()
        if not address.startswith("#") and ("#" in address or "." in address):
            raise MeshError(
                f"line {element.line}: it refers to {shortened(address)}, in another file, which is not "
                "read. Export "
                "the model as one file."
            )
        target = self._named.get((kind, _identifier(element, attribute)))
        if target is None:
            raise MeshError(
                f"line {element.line}: it refers to a {kind} {shortened(address)}, which is not there"
            )
        return target

    @property
    def left_out_words(self) -> str:
        """Number and kind of what was left out: `2 line sets, 1 spline`."""
        return ", ".join(plural(count, kind) for kind, count in sorted(self.left_out.items())[:5])

    def notes(self) -> list[str]:
        """Return lines about what was not read as other programs show it."""
        lines = []
        if self.bound:
            lines.append(bound_note(self.bound))
        if self.left_out:
            lines.append(f"left out, as they are not meshes: {self.left_out_words}")
        return lines


def _identifier(element: Element, attribute: str) -> str:
    return unquote(element.attributes.get(attribute, "").strip().removeprefix("#"))


_TRANSFORMS = {"matrix": 16, "translate": 3, "rotate": 4, "scale": 3, "lookat": 9, "skew": 7}
"""Elements that place a node, and how many numbers each has."""


def _transform(element: Element) -> Floats:
    """Return the matrix (4, 4) of row vectors of an element that places a node. Raises MeshError."""
    values = numbers_in(element, element.text, float)
    if len(values) != _TRANSFORMS[element.name]:
        raise MeshError(
            f"line {element.line}: {element.name} has {len(values)} numbers, not {_TRANSFORMS[element.name]}"
        )
    matrix = np.eye(4)
    match element.name:
        case "matrix":
            return values.reshape(4, 4).T
        case "translate":
            matrix[3, :3] = values
        case "scale":
            matrix[[0, 1, 2], [0, 1, 2]] = values
        case "rotate":
            matrix[:3, :3] = _rotation(values[:3], np.deg2rad(values[3]))
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


def _rotation(axis: Floats, angle: float) -> Floats:
    """Return the matrix (3, 3) of row vectors that turns by an angle about an axis, radians."""
    x, y, z = _unit_vector(axis)
    across = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
    return np.eye(3) + np.sin(angle) * across + (1.0 - np.cos(angle)) * (across @ across)


def _unit_vector(vector: Floats) -> Floats:
    return vector / (np.linalg.norm(vector) or 1.0)
