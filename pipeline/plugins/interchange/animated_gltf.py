"""Write moving sculptures as one binary glTF file: keyframes are morph targets, blended in turn.

By default positions are whole steps in 16 bits (KHR_mesh_quantization) and all arrays of vertices are
compressed (EXT_meshopt_compression). Their fallback buffer is declared without content, as the extension
allows where it is required: with content, the file would be several times as large. A plain file needs no
extension.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pipeline.arrays import AnyArray, Floats
from pipeline.errors import UsageError
from pipeline.plugins.interchange.drawn_mesh import KeyPoses
from pipeline.plugins.interchange.exported_frame import preview_surface
from pipeline.plugins.interchange.meshopt_encoder import (
    encode_attributes,
    encode_indices,
    exponential_elements,
)
from render.base.atomic_write import disk_errors
from render.scene.materials import Material

_FLOAT, _SHORT, _WIDE, _UNSIGNED = 5126, 5122, 5125, 5123  # component types
_VERTICES, _INDICES = 34962, 34963  # targets of buffer views

_MESHOPT = "EXT_meshopt_compression"

_NORMAL_EXPONENT = -7  # components of normals are multiples of 1/128, as in bytes

_LARGEST_FILE = 2**32 - 1  # bytes that the header of a GLB can state


class Moving(NamedTuple):
    """A sculpture of a file: its name, motion and look, and its second texture coordinates (W, 2) if any.

    Texture coordinates go to the right and upwards; the second ones to the right and downwards, as in glTF.
    """

    name: str
    keyframes: KeyPoses
    look: Material
    second: Floats | None = None


def write_animated_gltf(path: Path, clip: str, parts: Sequence[Moving], plain: bool = False) -> None:
    """Write sculptures and one animation clip, which begins at the first frame.

    plain  write float32 without extensions

    Raises UsageError where the file would be larger than its format allows, MachineError where the disk
    refuses.
    """
    content = _Content(plain)
    for part in parts:
        content.add(part)
    document, binary = content.document(clip), bytes(content.binary)
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    length = 12 + 8 + len(text) + 8 + len(binary)
    if length > _LARGEST_FILE:
        raise UsageError(
            f"{path.name}: {length / 1e9:.1f} GB, and a GLB holds {_LARGEST_FILE / 1e9:.1f} GB; "
            "use fewer frames, or --vertices for a smaller mesh"
        )
    with disk_errors(path), path.open("wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, length))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", len(binary), b"BIN\0") + binary)


class _Content:
    """The objects of a glTF document and its binary data, as parts are added."""

    def __init__(self, plain: bool) -> None:
        self._plain = plain
        self.binary = bytearray()
        self._decoded = 0  # bytes of the fallback buffer
        self._used: set[str] = set()
        self._lists: dict[str, list[dict[str, Any]]] = {
            kind: [] for kind in ("nodes", "meshes", "materials", "accessors", "bufferViews")
        }
        self._channels: list[dict[str, Any]] = []
        self._samplers: list[dict[str, Any]] = []

    def add(self, part: Moving) -> None:
        """Add a sculpture: its mesh, material, node, and the weights of its keyframes."""
        keys, drawn = part.keyframes, part.keyframes.drawn
        attributes = self._pose(keys.places[0], keys.normals[0], keys, base=True)
        first = part.second if drawn.texture is None else drawn.texture * (1.0, -1.0) + (0.0, 1.0)
        for number, coordinates in enumerate((first, part.second)):
            if coordinates is not None:
                attributes[f"TEXCOORD_{number}"] = self._floats(coordinates, "VEC2")
        if (colours := drawn.colours) is not None:
            attributes["COLOR_0"] = self._colours(colours)
        primitive: dict[str, Any] = {
            "attributes": attributes,
            "indices": self._indices(drawn.faces),
            "material": self._append("materials", self._material(part)),
        }
        mesh: dict[str, Any] = {"name": part.name, "primitives": [primitive]}
        count = len(keys.numbers) - 1
        if count:
            primitive["targets"] = [
                self._pose(place - keys.places[0], normal - keys.normals[0], keys, base=False)
                for place, normal in zip(keys.places[1:], keys.normals[1:], strict=True)
            ]
            mesh["weights"] = [0.0] * count
            mesh["extras"] = {"targetNames": [f"frame {number}" for number in keys.numbers[1:]]}
        node: dict[str, Any] = {"name": part.name, "mesh": self._append("meshes", mesh)}
        if not self._plain:
            node |= {"translation": keys.centre.tolist(), "scale": [keys.step] * 3}
        self._append("nodes", node)
        if count:
            self._animate(len(self._lists["nodes"]) - 1, keys)

    def _animate(self, node: int, keys: KeyPoses) -> None:
        """Add a channel that blends from each pose to the next one; at the first all weights are 0."""
        numbers, mesh = np.array(keys.numbers), keys.drawn.mesh
        times = ((numbers - mesh.frames[0]) / float(mesh.rate.fps)).astype("<f4")
        weights = np.eye(len(numbers), dtype="<f4")[:, 1:]
        sampler = {
            "input": self._accessor(self._raw(times), times, "SCALAR", _FLOAT, bounded=True),
            "output": self._accessor(self._raw(weights), weights.reshape(-1), "SCALAR", _FLOAT),
            "interpolation": "LINEAR",
        }
        self._samplers.append(sampler)
        target = {"node": node, "path": "weights"}
        self._channels.append({"sampler": len(self._samplers) - 1, "target": target})

    def document(self, clip: str) -> dict[str, Any]:
        """Return the JSON of the file, with everything that was added."""
        buffers: list[dict[str, Any]] = [{"byteLength": len(self.binary)}]
        if self._decoded:
            fallback = {"byteLength": self._decoded, "extensions": {_MESHOPT: {"fallback": True}}}
            buffers.append(fallback)
        required = {_MESHOPT, "KHR_mesh_quantization"} & self._used
        document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "flowsculpt"},
            **({"extensionsUsed": sorted(self._used)} if self._used else {}),
            **({"extensionsRequired": sorted(required)} if required else {}),
            "scene": 0,
            "scenes": [{"name": clip, "nodes": list(range(len(self._lists["nodes"])))}],
            **self._lists,
            "buffers": buffers,
        }
        if self._channels:
            animation = {"name": clip, "channels": self._channels, "samplers": self._samplers}
            document["animations"] = [animation]
        return document

    def _pose(self, place: AnyArray, normal: AnyArray, keys: KeyPoses, base: bool) -> dict[str, int]:
        """Add positions and normals of a pose, or of the difference between two."""
        if self._plain:
            offset = keys.centre if base else 0.0
            points = (place * keys.step + offset).astype("<f4")
            return {
                "POSITION": self._accessor(self._vertices(points), points, "VEC3", _FLOAT, bounded=True),
                "NORMAL": self._floats(normal, "VEC3"),
            }
        self._used.add("KHR_mesh_quantization")
        rows = np.zeros((len(place), 4), "<i2")  # elements begin at multiples of four bytes
        rows[:, :3] = place
        position = self._accessor(self._vertices(rows), rows[:, :3], "VEC3", _SHORT, bounded=True)
        if base:
            bytes_ = np.zeros((len(normal), 4), np.int8)
            bytes_[:, :3] = np.rint(normal * 127.0)
            held = self._accessor(self._vertices(bytes_), bytes_, "VEC3", 5120, normalized=True)
        else:  # differences reach from -2 to 2, which normalized bytes cannot hold
            elements = exponential_elements(normal, _NORMAL_EXPONENT)
            held = self._accessor(self._compressed(elements, "EXPONENTIAL"), elements, "VEC3", _FLOAT)
        return {"POSITION": position, "NORMAL": held}

    def _colours(self, colours: AnyArray) -> int:
        """Add colours, linear, with 16 bits a component."""
        rows = np.full((len(colours), 4), 65535, "<u2")
        rows[:, :3] = np.rint(65535.0 * np.clip(colours, 0.0, 1.0))
        return self._accessor(self._vertices(rows), rows, "VEC4", _UNSIGNED, normalized=True)

    def _floats(self, values: AnyArray, kind: str) -> int:
        rows = values.astype("<f4")
        return self._accessor(self._vertices(rows), rows, kind, _FLOAT)

    def _indices(self, faces: AnyArray) -> int:
        indices = faces.reshape(-1).astype("<u4")
        if self._plain:
            view = self._raw(indices, target=_INDICES)
        else:
            view = self._view(encode_indices(indices), len(indices), 4, "INDICES", target=_INDICES)
        return self._accessor(view, indices, "SCALAR", _WIDE)

    def _vertices(self, rows: AnyArray) -> int:
        """Add the rows of an attribute, each a multiple of four bytes long; return the view's number."""
        if self._plain:
            stride = rows.itemsize * rows.shape[1]
            return self._raw(rows, target=_VERTICES, byteStride=stride)
        return self._compressed(np.ascontiguousarray(rows).view(np.uint8))

    def _raw(self, values: AnyArray, **more: int) -> int:
        """Add values without compression; return the number of their view."""
        content = np.ascontiguousarray(values).tobytes()
        view = {"buffer": 0, "byteOffset": self._store(content), "byteLength": len(content), **more}
        return self._append("bufferViews", view)

    def _compressed(self, elements: AnyArray, *filters: str) -> int:
        """Add elements, uint8 (N, stride), compressed; return the number of their view."""
        count, stride = elements.shape
        content = encode_attributes(elements)
        return self._view(content, count, stride, "ATTRIBUTES", *filters, target=_VERTICES, byteStride=stride)

    def _view(self, content: bytes, count: int, stride: int, mode: str, *filters: str, **more: int) -> int:
        self._used.add(_MESHOPT)
        extension: dict[str, Any] = {
            "buffer": 0,
            "byteOffset": self._store(content),
            "byteLength": len(content),
            "byteStride": stride,
            "count": count,
            "mode": mode,
        }
        if filters:
            extension["filter"] = filters[0]
        view = {"buffer": 1, "byteOffset": self._decoded, "byteLength": count * stride, **more}
        self._decoded += -(-count * stride // 4) * 4
        return self._append("bufferViews", view | {"extensions": {_MESHOPT: extension}})

    def _store(self, content: bytes) -> int:
        """Append bytes to the binary data at a multiple of four, and return where they are."""
        at = len(self.binary)
        self.binary += content + bytes(-len(content) % 4)
        return at

    def _accessor(
        self,
        view: int,
        values: AnyArray,
        kind: str,
        component: int,
        bounded: bool = False,
        normalized: bool = False,
    ) -> int:
        accessor: dict[str, Any] = {
            "bufferView": view,
            "componentType": component,
            "count": len(values),
            "type": kind,
        }
        if normalized:
            accessor["normalized"] = True
        if bounded:
            rows = values.reshape(len(values), -1)
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        return self._append("accessors", accessor)

    def _material(self, part: Moving) -> dict[str, Any]:
        """Return the glTF material that is nearest to the look of a part."""
        surface, drawn = preview_surface(part.look), part.keyframes.drawn
        colour = surface.colour if drawn.colours is None else (1.0, 1.0, 1.0)
        material: dict[str, Any] = {
            "pbrMetallicRoughness": {
                "baseColorFactor": [*colour, surface.opacity],
                "metallicFactor": surface.metallic,
                "roughnessFactor": surface.roughness,
            },
            "doubleSided": not drawn.is_closed,
            "alphaMode": "OPAQUE" if surface.opacity == 1.0 else "BLEND",
        }
        extensions = {}
        if surface.clearcoat:
            extensions["KHR_materials_clearcoat"] = {"clearcoatFactor": surface.clearcoat}
        if surface.is_matt:
            extensions["KHR_materials_specular"] = {"specularFactor": 0.0}
        if extensions and not self._plain:
            self._used.update(extensions)
            material["extensions"] = extensions
        return material

    def _append(self, kind: str, entry: dict[str, Any]) -> int:
        self._lists[kind].append(entry)
        return len(self._lists[kind]) - 1


def closes(keyframes: Iterable[KeyPoses]) -> bool:
    """Tell whether the last pose is the first one, so that a clip repeats without a jump."""
    return all((keys.places[0] == keys.places[-1]).all() for keys in keyframes)
