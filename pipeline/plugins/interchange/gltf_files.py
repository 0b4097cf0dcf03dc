"""Surfaces in glTF files, .gltf and .glb (Khronos, glTF 2.0), read in a process of its own.

A scene may hold counts that no file can hold, and data that a library decompresses.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flowsculpt import MissingInputError
from flowsculpt.api import plural, shorten
from flowsculpt.api.files import InputFile, Parser
from flowsculpt.api.meshes import (
    FileSurface,
    Floats,
    SourceFiles,
    SurfaceReader,
)
from flowsculpt.pipeline.plugins.interchange.gltf_document import (
    MESHOPT,
    MOST_BYTES,
    GltfDocument,
    JsonObject,
)
from flowsculpt.pipeline.plugins.interchange.gltf_scene import (
    FAN,
    INSTANCING,
    TRIANGLES,
    DefaultScene,
    PlacedPrimitive,
    rotations,
    translations,
)
from flowsculpt.pipeline.plugins.interchange.meshopt import FILTERS, MODES
from flowsculpt.pipeline.plugins.interchange.scene_readers import (
    packed_surface,
    require_package,
    unpacked_surface,
)

_COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_SIZES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}

_MOST_CORNERS = 200_000_000
"""Most corners of triangles, and most points, counted in every copy that instancing makes."""

_MOST_ZEROS = 50_000_000  # most elements of a sparse accessor that has nothing but its exceptions


class Triangles(NamedTuple):
    """Points float64 (V, 3), and triangles int64 (F, 3) of them."""

    points: Floats
    faces: np.ndarray


class SceneArrays:
    """Reads the arrays of a scene from the buffer views that the scene names, and from no others."""

    def __init__(self, scene: DefaultScene) -> None:
        self.scene, self.document = scene, scene.document
        self._buffers: dict[int, bytes] = {}
        self._views: dict[int, np.ndarray] = {}
        self._known: dict[tuple[int, bool], tuple[Floats, np.ndarray, dict[str, np.ndarray]]] = {}

    def surface(self) -> Triangles:
        """Return the triangles of all parts, in the coordinates of the scene. Raises ValueError."""
        points, faces, corners, first = [np.empty((0, 3))], [np.empty((0, 3), np.int64)], 0, 0
        for part in self.scene.parts:
            own, matrices = self._own(part), self._matrices(part)
            corners += len(matrices) * max(own.faces.size, len(own.points))
            if corners > _MOST_CORNERS:
                raise ValueError(f"its parts and their copies have over {_MOST_CORNERS} corners of triangles")
            shown = placed(own, matrices)
            points.append(shown.points)
            faces.append(shown.faces + first)
            first += len(shown.points)
        return Triangles(np.concatenate(points), np.concatenate(faces))

    def _own(self, part: PlacedPrimitive) -> Triangles:
        """Return the triangles of a part in its node's coordinates, or in the scene's where it is skinned.

        They are read once where many nodes show its mesh.
        """
        primitive = id(part.primitive.values), part.is_skinned
        if primitive not in self._known:
            self._known[primitive] = self._triangles(part)
        points, faces, others = self._known[primitive]
        points = self._morphed(part, points)
        return Triangles(self._skinned(part, points, others) if part.is_skinned else points, faces)

    def _morphed(self, part: PlacedPrimitive, points: Floats) -> Floats:
        """Return the points (V, 3) of a part where its morph targets take them: still surfaces have none."""
        return points

    def _triangles(self, part: PlacedPrimitive) -> tuple[Floats, np.ndarray, dict[str, np.ndarray]]:
        """Return the points of a part at rest, its triangles, and other attributes that Draco has packed."""
        draco = self.scene.draco_of(part)
        if draco is not None:
            points, faces, others = self._from_draco(part, draco)
        else:
            points, faces, others = self._positions(part), None, {}
        if faces is None:
            faces = _faces(self._corners(part, len(points)), part)
        if faces.size and not 0 <= faces.min() <= faces.max() < len(points):
            face = int(np.argmax(((faces < 0) | (faces >= len(points))).any(axis=1)))
            wrong = next(int(v) for v in faces[face] if not 0 <= v < len(points))
            raise ValueError(f"face {face} of {part.place} names vertex {wrong} of {len(points)}, from 0")
        return points, faces, others

    def _positions(self, part: PlacedPrimitive) -> Floats:
        index = part.primitive.entry("attributes").values["POSITION"]
        values, accessor = self._elements(index, part.place, "VEC3")
        if values.dtype == np.uint32:  # floats under a wrong name, or no positions
            raise ValueError(
                f"{accessor.place} of {part.place} has positions of componentType 5125, which glTF allows "
                "only for indices"
            )
        return _as_floats(values, accessor)

    def _corners(self, part: PlacedPrimitive, vertices: int) -> np.ndarray:
        """Return the vertices (C,) that the mode of a part joins; -1 where a strip or fan begins again."""
        if "indices" not in part.primitive:
            return np.arange(vertices)
        values, _ = self._elements(part.primitive.values["indices"], part.place, "SCALAR")
        if values.dtype.kind == "f":
            raise ValueError(f"the indices of {part.place} are not whole numbers")
        corners = values.reshape(-1).astype(np.int64)
        if part.mode != TRIANGLES:
            corners[corners == np.iinfo(values.dtype).max] = -1
        return corners

    def _from_draco(
        self, part: PlacedPrimitive, draco: JsonObject
    ) -> tuple[Floats, np.ndarray, dict[str, np.ndarray]]:
        """Return points, triangles, and other attributes by name. Raises ValueError."""
        import DracoPy

        data = self._view(draco.whole("bufferView"), part.place).tobytes()
        try:
            mesh = DracoPy.decode(data)
            faces = np.asarray(mesh.faces, np.int64).reshape(-1, 3)
        except Exception as error:  # the library raises whatever it likes
            raise ValueError(f"the Draco data of {part.place} is damaged ({shorten(error)})") from None
        values = {}
        packed, attributes = draco.entry("attributes"), part.primitive.entry("attributes").values
        for name in ("POSITION", *(name for pair in part.influences() for name in pair)):
            found = mesh.get_attribute_by_unique_id(packed.whole(name)) if name in packed else None
            if found is not None:
                accessor = self.document.item("accessors", attributes[name], part.place)
                values[name] = _as_floats(found["data"], accessor)
        if "POSITION" not in values or values["POSITION"].shape[1:] != (3,):
            raise ValueError(f"the Draco data of {part.place} has no positions")
        return values["POSITION"], faces, values

    def _skinned(self, part: PlacedPrimitive, points: Floats, decoded: dict[str, np.ndarray]) -> Floats:
        """Return points (V, 3) where the joints of their skin take them, in the coordinates of the scene."""
        joints, skin = self.scene.joints_of(part)
        matrices = np.array([self.scene.matrix(joint) for joint in joints]).reshape(-1, 4, 4)
        if "inverseBindMatrices" in skin:
            inverse = self._numbers(skin.values["inverseBindMatrices"], skin.place, "MAT4")
            if len(inverse) < len(joints):
                raise ValueError(f"{skin.place} has {len(joints)} joints and {len(inverse)} matrices")
            matrices = matrices @ inverse[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1)
        attributes = part.primitive.entry("attributes").values
        summed, total = np.zeros((len(points), 3, 4)), np.zeros(len(points))
        for names in part.influences():
            of_joint, weights = (
                decoded[name] if name in decoded else self._numbers(attributes.get(name), part.place, "VEC4")
                for name in names
            )
            if of_joint.shape != weights.shape or len(weights) != len(points):
                raise ValueError(f"{part.place} has other numbers of joints, weights and vertices")
            of_joint = of_joint.astype(np.int64)
            if of_joint.size and (of_joint.min() < 0 or of_joint[weights > 0].max(initial=0) >= len(joints)):
                raise ValueError(f"{part.place} names joint {of_joint.max()}; {skin.place} has {len(joints)}")
            for column, weight in zip(np.minimum(of_joint, len(joints) - 1).T, weights.T, strict=True):
                summed += weight[:, None, None] * matrices[column, :3]
                total += weight
        moves = total > 0
        summed[moves] /= total[moves, None, None]
        summed[~moves] = matrices[0, :3]
        return np.einsum("vij,vj->vi", summed[:, :, :3], points) + summed[:, :, 3]

    def _matrices(self, part: PlacedPrimitive) -> Floats:
        """Return where a part is: matrices (N, 4, 4), one for each copy of it."""
        instances = part.node.extension(INSTANCING)
        if part.is_skinned and instances is not None:
            raise ValueError(f"{part.node.place} has a skin and instances, which is not supported")
        if part.is_skinned:
            return np.eye(4)[None]
        own = self.scene.matrix(part.number)
        if instances is None:
            return own[None]
        given, place = instances.entry("attributes").values, f"the instances of {part.node.place}"
        kinds = {"TRANSLATION": "VEC3", "ROTATION": "VEC4", "SCALE": "VEC3"}
        values = {name: self._numbers(given[name], place, kinds[name]) for name in kinds if name in given}
        counts = {len(numbers) for numbers in values.values()}
        if len(counts) != 1:
            raise ValueError(f"{place} have {' or '.join(map(str, sorted(counts))) or 'no'} transforms")
        if counts.pop() * 16 > _MOST_CORNERS:
            raise ValueError(f"{place} are over {_MOST_CORNERS // 16}")
        matrices = own[None]
        if "TRANSLATION" in values:
            matrices = matrices @ translations(values["TRANSLATION"])
        if "ROTATION" in values:
            matrices = matrices @ rotations(values["ROTATION"])
        if "SCALE" in values:
            scales = np.concatenate([values["SCALE"], np.ones((len(values["SCALE"]), 1))], axis=1)
            matrices = matrices * scales[:, None, :]
        return matrices

    def _numbers(self, index: object, place: str, kind: str) -> Floats:
        """Return an accessor as float64 (N, k), divided where it is normalized. Raises ValueError."""
        return _as_floats(*self._elements(index, place, kind))

    def _elements(self, index: object, place: str, kind: str) -> tuple[np.ndarray, JsonObject]:
        """Return the elements (N, k) of an accessor as the file has them. Raises ValueError."""
        accessor = self.document.item("accessors", index, place)
        if accessor.text("type") != kind:
            raise ValueError(f"{accessor.place} of {place} is of type {accessor.text('type')}, not {kind}")
        count, sparse = accessor.whole("count"), accessor.entry("sparse")
        if "bufferView" in accessor:
            values = self._strided(accessor, accessor, count, _SIZES[kind])
        elif not sparse.values:
            raise ValueError(f"{accessor.place} of {place} has no bufferView, nor data that is compressed")
        elif count > _MOST_ZEROS:
            raise ValueError(f"{accessor.place} has {count} elements without a bufferView")
        else:
            values = np.zeros((count, _SIZES[kind]), _component(accessor))
        if sparse.values:
            exceptions = sparse.whole("count")
            at = self._strided(sparse.entry("indices"), sparse.entry("indices"), exceptions, 1).reshape(-1)
            if at.dtype.kind != "u" or (len(at) and at.max() >= count):
                raise ValueError(f"the sparse indices of {accessor.place} are not below its count, {count}")
            values = values.copy()
            values[at] = self._strided(sparse.entry("values"), accessor, exceptions, _SIZES[kind])
        return values, accessor

    def _strided(self, source: JsonObject, typed: JsonObject, count: int, size: int) -> np.ndarray:
        """Return `count` elements (N, size) of a buffer view; `typed` names the type of their numbers."""
        dtype = np.dtype(_component(typed))
        index = source.whole("bufferView")
        view = self.document.item("bufferViews", index, source.place)
        data = self._view(index, source.place)
        width = size * dtype.itemsize
        stride, start = view.whole("byteStride", 0) or width, source.whole("byteOffset", 0)
        if stride < width:
            raise ValueError(f"byteStride of {view.place} is {stride}; {source.place} needs {width} bytes")
        end = start + stride * (count - 1) + width if count else start
        if end > len(data):
            raise ValueError(f"{source.place} ends at byte {end} of {view.place}, which has {len(data)}")
        rows = np.lib.stride_tricks.as_strided(data[start:], (count, width), (stride, 1), writeable=False)
        return np.ascontiguousarray(rows).view(dtype)

    def _view(self, index: int, place: str) -> np.ndarray:
        """Return the bytes of a buffer view as uint8 (N,), decompressed. Raises ValueError."""
        if index not in self._views:
            if index not in self.scene.views:
                raise AssertionError(f"buffer view {index} decides no key")
            view = self.document.item("bufferViews", index, place)
            packed = view.extension(*MESHOPT)
            source = packed or view
            number = source.whole("buffer")
            if number not in self._buffers:
                self._buffers[number] = self.document.buffer(number)
            content = np.frombuffer(self._buffers[number], np.uint8)
            start, length = source.whole("byteOffset", 0), source.whole("byteLength")
            if start + length > len(content):
                raise ValueError(
                    f"{view.place} ends at byte {start + length} of buffer {number}, which has {len(content)}"
                )
            data = content[start : start + length]
            self._views[index] = data if packed is None else _unpacked(data.tobytes(), packed, view.place)
        return self._views[index]


def _component(accessor: JsonObject) -> str:
    kind = accessor.values.get("componentType")
    if kind not in _COMPONENTS:
        raise ValueError(f"componentType of {accessor.place} is {shorten(repr(kind))}; not one of glTF's")
    return _COMPONENTS[kind]


def _as_floats(values: np.ndarray, accessor: JsonObject) -> Floats:
    """Return values as float64; normalized whole numbers are then from -1 or 0 to 1."""
    if values.dtype.kind == "f" or not accessor.values.get("normalized"):
        return values.astype(np.float64)
    return np.maximum(values / np.iinfo(values.dtype).max, -1.0)


def _unpacked(data: bytes, packed: JsonObject, place: str) -> np.ndarray:
    """Return the bytes of a buffer view that meshoptimizer compressed. Raises ValueError."""
    mode, name = packed.text("mode"), packed.text("filter", "NONE")
    if mode not in MODES:
        raise ValueError(f"{place} is compressed by meshoptimizer in mode {shorten(mode)}, which is not read")
    if name not in FILTERS:
        raise ValueError(f"{place} has vertices of meshoptimizer's filter {shorten(name)}, which is not read")
    try:
        elements = MODES[mode](data, packed.whole("count"), packed.whole("byteStride"))
        return FILTERS[name](elements).view(np.uint8).reshape(-1)
    except ValueError as error:
        raise ValueError(f"{place}, compressed by meshoptimizer, is damaged: {error}") from None


def _faces(corners: np.ndarray, part: PlacedPrimitive) -> np.ndarray:
    """Return the triangles (F, 3) that the mode of a part makes of its corners (C,). Raises ValueError."""
    if part.mode == TRIANGLES:
        if len(corners) % 3:
            raise ValueError(f"{part.place} has {len(corners)} corners; those of triangles come in threes")
        return corners.reshape(-1, 3)
    runs = np.split(corners, np.flatnonzero(corners < 0))
    triangles = _fan if part.mode == FAN else _strip
    faces = np.concatenate([triangles(run[run >= 0]) for run in runs])
    a, b, c = faces.T
    return faces[(a != b) & (b != c) & (c != a)]  # a strip turns corners by triangles without area


def _strip(run: np.ndarray) -> np.ndarray:
    faces = np.stack([run[:-2], run[1:-1], run[2:]], axis=1)
    faces[1::2] = faces[1::2, ::-1].copy()
    return faces


def _fan(run: np.ndarray) -> np.ndarray:
    return np.stack([run[1:-1], run[2:], np.repeat(run[:1], max(len(run) - 2, 0))], axis=1)


def placed(triangles: Triangles, matrices: Floats) -> Triangles:
    """Return the triangles where matrices (N, 4, 4) take them, wound as before where one mirrors them."""
    points, faces = triangles
    if len(matrices) != 1:
        moved = points @ matrices[:, :3, :3].transpose(0, 2, 1) + matrices[:, None, :3, 3]
        of_copy = np.tile(faces, (len(matrices), 1, 1))
        mirrored = np.linalg.det(matrices[:, :3, :3]) < 0.0
        of_copy[mirrored] = of_copy[mirrored, :, ::-1]
        of_copy += len(points) * np.arange(len(matrices))[:, None, None]
        return Triangles(moved.reshape(-1, 3), of_copy.reshape(-1, 3))
    matrix = np.ascontiguousarray(matrices[0])
    off = np.abs(matrix - np.eye(4))
    if off.max() <= 1e-8:
        return triangles
    if off[:3, :3].max() > 1e-6 and np.linalg.det(matrix[:3, :3]) < 0.0:
        faces = np.ascontiguousarray(faces[:, ::-1])
    columns = np.column_stack((points, np.ones(len(points))))
    return Triangles(np.dot(matrix, columns.T).T[:, :3], faces)


def read_gltf(path: Path) -> FileSurface:
    """Read the default scene of a file as one surface.

    Raises ValueError where it cannot be read, MissingInputError for a missing buffer.
    """
    scene = DefaultScene.of(GltfDocument.read(path))
    require_draco(scene)
    files_of_buffers(scene)
    surface = unpacked_surface(Parser("flowsculpt.pipeline.plugins.interchange.gltf_files").answer(path))
    return surface._replace(notes=tuple(_notes(scene)))


def require_draco(scene: DefaultScene) -> None:
    """Raise MachineError where the package that reads Draco data is needed and not installed."""
    if any(scene.draco_of(part) is not None for part in scene.distinct):
        require_package("glTF files with Draco data", "DracoPy", "DracoPy", "models")


def _files(path: Path) -> SourceFiles:
    """Return a file and the buffers that its surface is read from. Raises as `read_gltf`."""
    scene = DefaultScene.of(GltfDocument.read(path))
    files = [(file, InputFile(file).digest()) for file in (path, *files_of_buffers(scene))]
    reader = ["glTF reader 2"] if scene.was_misread else []  # an earlier one read this file otherwise
    return SourceFiles.of(files, readers=reader)


def files_of_buffers(scene: DefaultScene) -> tuple[Path, ...]:
    """Return the files of a scene's buffers. Raises MissingInputError where one is not there."""
    document = scene.document
    files = {index: document.buffer_file(index) for index in sorted(scene.buffers)}
    for index, file in files.items():
        try:
            if file is not None:
                InputFile(file, MOST_BYTES).size()
        except MissingInputError as error:
            raise MissingInputError(f"{document.path}: its buffer {index} refers to {error}") from None
    return tuple(dict.fromkeys(file for file in files.values() if file is not None))


GLTF = SurfaceReader(read_gltf, _files)


def _notes(scene: DefaultScene) -> Iterator[str]:
    """Yield lines to tell the user about what is not read as other programs show it."""
    if not (scene.parts or scene.skipped) and scene.document.root.items("meshes"):
        yield "no node of its default scene has a mesh with triangles"
    if scene.skipped:
        there = "is" if scene.skipped == 1 else "are"
        yield f"{plural(scene.skipped, 'primitive')} of points or lines {there} left out"
    if scene.morphed:
        yield (
            f"the morph targets of {plural(scene.morphed, 'primitive')} are not applied, though their weights"
            " are not 0; if they should show, apply them in the program that made the file"
        )


def _answer(path: str) -> bytes:
    """Return the surface of a file, packed."""
    scene = DefaultScene.of(GltfDocument.read(Path(path)))
    files = (Path(path), *files_of_buffers(scene))
    Parser.allow_memory(Parser.MEMORY + 40 * sum(InputFile(file, MOST_BYTES).size() for file in files))
    points, faces = SceneArrays(scene).surface()
    return packed_surface(FileSurface.of(points, faces, base=None))


if __name__ == "__main__":
    Parser.serve(_answer)
