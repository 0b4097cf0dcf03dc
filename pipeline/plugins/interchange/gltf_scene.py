"""The scene of a glTF document: which meshes it shows, where, and which of the file's data these rest on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, reduce
from typing import Any

import numpy as np

from flowsculpt import MeshError
from flowsculpt.api import shorten
from flowsculpt.pipeline.plugins.interchange.gltf_document import MESHOPT, GltfDocument, JsonObject

DRACO, INSTANCING = "KHR_draco_mesh_compression", "EXT_mesh_gpu_instancing"
_QUANTIZATION, _VISIBILITY = "KHR_mesh_quantization", "KHR_node_visibility"

_RESTART = ("KHR_mesh_primitive_restart", "EXT_mesh_primitive_restart")

_READ = {DRACO, INSTANCING, _QUANTIZATION, _VISIBILITY, *MESHOPT, *_RESTART}

_NOT_GEOMETRY = (
    *("KHR_materials_", "KHR_texture_", "KHR_lights_", "KHR_xmp", "KHR_animation_", "KHR_audio"),
    *("KHR_technique", "KHR_node_", "KHR_interactivity", "KHR_physics_"),
    *("EXT_texture_", "EXT_lights_", "EXT_materials_", "EXT_mesh_features", "EXT_instance_features"),
    *("EXT_structural_metadata", "EXT_mesh_manifold", "ADOBE_materials_", "MSFT_texture_", "MSFT_packing_"),
    *("MSFT_lod", "MSFT_audio_", "CESIUM_primitive_outline", "AGI_", "FB_geometry_metadata", "VRM"),
)
"""Beginnings of the names of extensions without which surfaces are the same."""

_MOST_PARTS = 1_000_000  # most primitives, counted at every node that has their mesh

POINTS_AND_LINES = (0, 1, 2, 3)
TRIANGLES, STRIP, FAN = 4, 5, 6


@dataclass(frozen=True)
class PlacedPrimitive:
    """A primitive of triangles, in a mesh that a node of the scene has; `place` is for messages."""

    number: int
    node: JsonObject
    mesh: JsonObject
    primitive: JsonObject
    place: str

    @property
    def mode(self) -> int:
        return self.primitive.whole("mode", TRIANGLES)

    @property
    def is_skinned(self) -> bool:
        return "skin" in self.node and "JOINTS_0" in self.primitive.entry("attributes")

    def influences(self) -> Iterator[tuple[str, str]]:
        """Yield the names of the attributes with four joints a vertex, and with their weights."""
        attributes, k = self.primitive.entry("attributes"), 0
        while self.is_skinned and f"JOINTS_{k}" in attributes:
            yield f"JOINTS_{k}", f"WEIGHTS_{k}"
            k += 1


@dataclass
class DefaultScene:
    """The default scene of a document, or its first; of a file without scenes all nodes.

    parts    in the order in which their surfaces are joined
    skipped  number of primitives that are points or lines
    morphed  number of primitives with morph targets whose weights are not 0
    """

    document: GltfDocument
    parts: list[PlacedPrimitive] = field(default_factory=list)
    skipped: int = 0
    morphed: int = 0
    _parents: dict[int, int | None] = field(default_factory=dict)
    _pose: Mapping[int, Mapping[str, list[float]]] = field(default_factory=dict)
    _locals: dict[int, np.ndarray] = field(default_factory=dict)

    @classmethod
    def of(cls, document: GltfDocument) -> DefaultScene:
        """Find the parts of the scene.

        Raises ValueError for damaged nodes and meshes and for cycles, MeshError for a required extension that
        is unknown.
        """
        for name in map(str, document.root.items("extensionsRequired")):
            if name not in _READ and not name.startswith(_NOT_GEOMETRY):
                raise MeshError(
                    f"it requires the extension {shorten(name)}, which is not read. Export without."
                )
        scene = cls(document)
        scene._find_parts()
        return scene

    def _find_parts(self) -> None:
        roots = dict.fromkeys(self._roots())
        waiting: list[tuple[Any, int | None, bool]] = [(number, None, True) for number in roots]
        while waiting:
            number, parent, is_shown = waiting.pop()
            above = "the scene" if parent is None else f"node {parent}"
            node = self.document.item("nodes", number, above)
            if number in self._parents:
                raise ValueError(f"node {number} is its own ancestor or has two parents; a node has one")
            self._parents[number] = parent
            visibility = node.extension(_VISIBILITY)
            is_shown = is_shown and (visibility is None or visibility.values.get("visible") is not False)
            waiting += [(child, number, is_shown) for child in node.items("children")]
            if is_shown and "mesh" in node:
                self._add_mesh(number, node)

    def _roots(self) -> list[int]:
        root = self.document.root
        if root.items("scenes"):
            return self.document.item("scenes", root.whole("scene", 0), "the file").items("nodes")
        children = {str(child) for node in root.entries("nodes") for child in node.items("children")}
        return [number for number in range(len(root.items("nodes"))) if str(number) not in children]

    def _add_mesh(self, number: int, node: JsonObject) -> None:
        mesh = self.document.item("meshes", node.values["mesh"], node.place)
        for k, primitive in enumerate(mesh.entries("primitives")):
            if len(self.parts) + self.skipped >= _MOST_PARTS:
                raise ValueError(f"its nodes have over {_MOST_PARTS} primitives in all")
            part = PlacedPrimitive(number, node, mesh, primitive, f"primitive {k} of {mesh.place}")
            if part.mode in POINTS_AND_LINES:
                self.skipped += 1
            elif part.mode not in (TRIANGLES, STRIP, FAN):
                raise ValueError(f"{part.place} is of mode {part.mode}; there are 0 to 6")
            elif "POSITION" in primitive.entry("attributes"):  # without, nothing is drawn
                self.parts.append(part)
                weights = node.numbers("weights") or mesh.numbers("weights")
                self.morphed += any(weights) and bool(primitive.items("targets"))

    def joints_of(self, part: PlacedPrimitive) -> tuple[list[int], JsonObject]:
        """Return the joints of a part's skin, by node, and the skin. Raises ValueError."""
        skin = self.document.item("skins", part.node.values["skin"], part.node.place)
        joints = skin.items("joints")
        if not joints:
            raise ValueError(f"{skin.place} has no joints")
        for joint in joints:
            if joint not in self._parents:
                raise ValueError(f"{skin.place} has a joint that is not in the scene, {shorten(repr(joint))}")
        return joints, skin

    def matrix(self, number: int) -> np.ndarray:
        """Return the matrix (4, 4) that takes columns of a node's coordinates to the scene's.

        A nearly rigid one is made rigid: files have rotations in single precision.
        """
        chain: list[np.ndarray] = []
        at: int | None = number
        while at is not None:
            local = self._local(at)
            if np.abs(local - np.eye(4)).max() > 1e-8:
                chain.append(local)
            at = self._parents[at]
        return _rigid(reduce(lambda below, above: np.dot(above, below), chain)) if chain else np.eye(4)

    def pose(self, values: Mapping[int, Mapping[str, list[float]]]) -> None:
        """Give nodes other values than the file does: `translation` and so on, by the numbers of nodes."""
        self._pose = values
        self._locals.clear()

    def posed(self, number: int) -> JsonObject:
        """Return a node with the values that `pose` gave it."""
        node = self.document.item("nodes", number, "the scene")
        return JsonObject({**node.values, **self._pose.get(number, {})}, node.place)

    def _local(self, number: int) -> np.ndarray:
        if number not in self._locals:
            node = self.posed(number)
            matrix = np.eye(4)
            if "matrix" in node:
                matrix = np.array(node.numbers("matrix", 16), np.float64).reshape(4, 4).T
            if "translation" in node:
                matrix = np.dot(matrix, translations(np.array([node.numbers("translation", 3)]))[0])
            if "rotation" in node:
                matrix = np.dot(matrix, rotations(np.array([node.numbers("rotation", 4)], np.float64))[0])
            if "scale" in node:
                matrix = np.dot(matrix, np.diag([*node.numbers("scale", 3), 1.0]))
            self._locals[number] = matrix
        return self._locals[number]

    @cached_property
    def distinct(self) -> list[PlacedPrimitive]:
        """Parts that rest on other data than those before: many nodes may show one mesh."""
        known: dict[tuple[Any, ...], PlacedPrimitive] = {}
        for part in self.parts:
            own = id(part.node.values) if {"skin", "extensions"} & part.node.values.keys() else 0
            known.setdefault((id(part.primitive.values), own), part)
        return list(known.values())

    @cached_property
    def views(self) -> frozenset[int]:
        """The buffer views that hold what the surface is made from."""
        found: set[int] = set()
        for part in self.distinct:
            draco = self.draco_of(part)
            if draco is not None:
                found.add(draco.whole("bufferView"))
            for index in self._accessors_of(part, draco):
                found |= self.views_of(index, part.place)
        return frozenset(found)

    def views_of(self, index: object, place: str) -> set[int]:
        """Return the buffer views of an accessor; `place` names it."""
        accessor = self.document.item("accessors", index, place)
        sparse = accessor.entry("sparse")
        holders = [accessor, *(sparse.entry(name) for name in ("indices", "values"))]
        return {holder.whole("bufferView") for holder in holders if "bufferView" in holder}

    def _accessors_of(self, part: PlacedPrimitive, draco: JsonObject | None) -> Iterator[object]:
        """Yield the accessors that a part is read from."""
        attributes, instances = part.primitive.entry("attributes"), part.node.extension(INSTANCING)
        names = ["POSITION", *(name for pair in part.influences() for name in pair)]
        packed = draco.entry("attributes") if draco is not None else JsonObject({}, "")
        yield from (attributes.values.get(name) for name in names if name not in packed)
        if draco is None and "indices" in part.primitive:
            yield part.primitive.values["indices"]
        if part.is_skinned:
            _, skin = self.joints_of(part)
            if "inverseBindMatrices" in skin:
                yield skin.values["inverseBindMatrices"]
        elif instances is not None:
            given = instances.entry("attributes").values
            yield from (given[name] for name in ("TRANSLATION", "ROTATION", "SCALE") if name in given)

    def draco_of(self, part: PlacedPrimitive) -> JsonObject | None:
        """Return the Draco data of a part, where it has no other: it may be there besides."""
        draco = part.primitive.extension(DRACO)
        if draco is None:
            return None
        return None if "bufferView" in self._position_of(part) else draco

    def _position_of(self, part: PlacedPrimitive) -> JsonObject:
        position = part.primitive.entry("attributes").values["POSITION"]
        return self.document.item("accessors", position, part.place)

    @cached_property
    def buffers(self) -> frozenset[int]:
        """The buffers that hold what the surface is made from."""
        views = [self.document.item("bufferViews", index, "an accessor") for index in self.views]
        return frozenset((view.extension(*MESHOPT) or view).whole("buffer") for view in views)

    @property
    def was_misread(self) -> bool:
        """True where the file has features that trimesh ignored, by which files were read before."""
        item, root = self.document.item, self.document.root
        nodes = list(root.entries("nodes"))
        return (
            not root.items("scenes")
            or any("camera" in node and "mesh" in node for node in nodes)
            or any(node.extension(INSTANCING, _VISIBILITY) is not None for node in nodes)
            or any(item("bufferViews", view, "").extension(*MESHOPT) is not None for view in self.views)
            or any(self._was_part_misread(part) for part in self.distinct)
        )

    def _was_part_misread(self, part: PlacedPrimitive) -> bool:
        if part.mode == FAN or part.is_skinned or self._position_of(part).values.get("normalized"):
            return True
        indices = self._accessors_of(part, None)
        used = (self.document.item("accessors", index, part.place) for index in indices)
        return any("sparse" in accessor or "bufferView" not in accessor for accessor in used)


def translations(vectors: np.ndarray) -> np.ndarray:
    """Return matrices (N, 4, 4) of vectors (N, 3)."""
    matrices = np.tile(np.eye(4), (len(vectors), 1, 1))
    matrices[:, :3, 3] = vectors
    return matrices


def rotations(quaternions: np.ndarray) -> np.ndarray:
    """Return matrices (N, 4, 4) of quaternions (N, 4), x y z w, of any length; length 0 turns nothing."""
    q = quaternions[:, [3, 0, 1, 2]].astype(np.float64)
    squares = np.dot(q * q, np.ones(4))
    turns = squares >= np.finfo(np.float64).eps * 4.0
    q[turns] *= np.sqrt(2.0 / squares[turns, None])
    q = q[:, None, :] * q[:, :, None]
    matrices = np.tile(np.eye(4), (len(q), 1, 1))
    rows = [
        [1.0 - q[:, 2, 2] - q[:, 3, 3], q[:, 1, 2] - q[:, 3, 0], q[:, 1, 3] + q[:, 2, 0]],
        [q[:, 1, 2] + q[:, 3, 0], 1.0 - q[:, 1, 1] - q[:, 3, 3], q[:, 2, 3] - q[:, 1, 0]],
        [q[:, 1, 3] - q[:, 2, 0], q[:, 2, 3] + q[:, 1, 0], 1.0 - q[:, 1, 1] - q[:, 2, 2]],
    ]
    matrices[turns, :3, :3] = np.array(rows).transpose(2, 0, 1)[turns]
    return matrices


def _rigid(matrix: np.ndarray) -> np.ndarray:
    """Return a matrix whose 3 × 3 part is orthogonal where it almost was."""
    turn = matrix[:3, :3]
    error = np.abs(np.dot(turn, turn.T) - np.eye(3)).max()
    if not 1e-13 < error < 1e-5:
        return matrix
    left, _, right = np.linalg.svd(turn)
    rigid = np.eye(4)
    rigid[:3, :3], rigid[:3, 3] = np.dot(left, right), matrix[:3, 3]
    return rigid
