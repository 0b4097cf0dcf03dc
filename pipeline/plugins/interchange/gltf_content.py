"""The content of a binary glTF file: objects of its document and binary data, as they are added.

By default positions are whole steps in 16 bits (KHR_mesh_quantization) and all arrays of vertices are
compressed (EXT_meshopt_compression). Their fallback buffer is declared without content, as the extension
allows where it is required: with content, the file would be several times as large. A plain file needs no
extension.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt import UsageError
from flowsculpt.api.files import disk_errors
from flowsculpt.api.materials import Material, Texture
from flowsculpt.api.meshes import Indices
from flowsculpt.pipeline.plugins.interchange.embedded_pictures import EmbeddedPicture
from flowsculpt.pipeline.plugins.interchange.exported_materials import (
    COMPACT,
    ExportedMaterial,
    exported_materials,
)
from flowsculpt.pipeline.plugins.interchange.meshopt_encoder import encode_attributes, encode_indices
from flowsculpt.pipeline.plugins.interchange.one_mesh import OneMesh

FLOAT, SHORT, WIDE, UNSIGNED = 5126, 5122, 5125, 5123  # component types
_VERTICES, _INDICES = 34962, 34963  # targets of buffer views

_MESHOPT = "EXT_meshopt_compression"

_FILTERS = {"magFilter": 9729, "minFilter": 9987}
"""Of samplers: linear, with mipmaps."""

_WRAPS = {"repeat": 10497, "clamp": 33071, "mirror": 33648, "black": 33071}
"""What is shown beyond the sides of a picture; black is the border (`bordered`)."""

_LARGEST_FILE = 2**32 - 1  # bytes that the header of a GLB can state


class GltfContent:
    """The objects of a glTF document and its binary data, as they are added.

    plain       True for float32 without extensions
    compresses  False for whole steps without compression, to be compressed as a whole
    """

    def __init__(self, plain: bool, compresses: bool = True) -> None:
        self.plain = plain
        self.compresses = compresses and not plain
        self.binary = bytearray()
        self._decoded = 0  # bytes of the fallback buffer
        self.used: set[str] = set()
        self.lists: dict[str, list[dict[str, Any]]] = {
            kind: []
            for kind in (
                *("nodes", "meshes", "materials", "accessors", "bufferViews"),
                *("images", "samplers", "textures"),
            )
        }
        self.timing: dict[str, float] = {}
        self.channels: list[dict[str, Any]] = []
        self.channel_samplers: list[dict[str, Any]] = []
        self._textures: dict[EmbeddedPicture, int] = {}

    def write(self, path: Path, scene: str) -> None:
        """Write the file. Raises what `glb` raises, and MachineError where the disk refuses."""
        content = self.glb(path.name, scene)
        with disk_errors(path):
            path.write_bytes(content)

    def glb(self, name: str, scene: str) -> bytes:
        """Return the content of a file. Raises UsageError where it is larger than its format allows."""
        text = json.dumps(self.document(scene), separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        length = 12 + 8 + len(text) + 8 + len(self.binary)
        if length > _LARGEST_FILE:
            raise UsageError(
                f"{name}: {length / 1e9:.1f} GB, and a GLB holds {_LARGEST_FILE / 1e9:.1f} GB; "
                "use fewer frames, or --vertices for a smaller mesh"
            )
        head = struct.pack("<4sIII4s", b"glTF", 2, length, len(text), b"JSON")
        return b"".join([head, text, struct.pack("<I4s", len(self.binary), b"BIN\0"), self.binary])

    def primitives(
        self,
        attributes: dict[str, int],
        faces: Indices,
        materials: np.ndarray | None,
        look: Material,
        is_closed: bool | None = None,
    ) -> list[dict[str, Any]]:
        """Return the primitives of a mesh, one a material; they share the arrays of vertices.

        materials  (F,): the material of each face, ascending; None where all have the first
        is_closed  tells whether nobody sees the inside; None where it is not known
        """
        parts = exported_materials(look, Texture.WIDEST if self.plain else COMPACT)
        numbers = np.zeros(len(faces), np.int64) if materials is None else materials
        found = []
        for number in np.unique(numbers).tolist():
            shows_colours = parts[number].is_coloured and "COLOR_0" in attributes
            own = {name: at for name, at in attributes.items() if shows_colours or name != "COLOR_0"}
            material = self._material(parts[number], shows_colours, is_closed)
            found.append(
                {
                    "attributes": own,
                    "indices": self.indices(faces[numbers == number]),
                    "material": self.append("materials", material),
                }
            )
        return found

    def times(self, mesh: OneMesh, numbers: NDArray[np.integer]) -> NDArray[np.float32]:
        """Return the seconds of frames from the first one of a mesh; note its rate, which a clip has not."""
        rate = float(mesh.rate.fps)
        self.timing = {"rate": rate, "first": mesh.frames[0], "last": mesh.frames[-1]}
        return ((numbers - mesh.frames[0]) / rate).astype("<f4")

    def animate(self, node: int, path: str, when: int, output: int) -> None:
        """Add a channel of the clip; `when` and `output` are accessors."""
        self.channel_samplers.append({"input": when, "output": output, "interpolation": "LINEAR"})
        target = {"node": node, "path": path}
        self.channels.append({"sampler": len(self.channel_samplers) - 1, "target": target})

    def document(self, name: str) -> dict[str, Any]:
        """Return the JSON of the file, with everything that was added."""
        buffers: list[dict[str, Any]] = [{"byteLength": len(self.binary)}]
        if self._decoded:
            fallback = {"byteLength": self._decoded, "extensions": {_MESHOPT: {"fallback": True}}}
            buffers.append(fallback)
        required = {_MESHOPT, "KHR_mesh_quantization"} & self.used
        document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "flowsculpt"},
            **({"extensionsUsed": sorted(self.used)} if self.used else {}),
            **({"extensionsRequired": sorted(required)} if required else {}),
            "scene": 0,
            "scenes": [{"name": name, "nodes": list(range(len(self.lists["nodes"])))}],
            **{kind: entries for kind, entries in self.lists.items() if entries},
            "buffers": buffers,
        }
        if self.channels:
            animation = {"name": name, "channels": self.channels, "samplers": self.channel_samplers}
            document["animations"] = [animation | {"extras": self.timing}]
        return document

    def colours(self, colours: np.ndarray) -> int:
        """Add colours, linear, with 16 bits a component."""
        rows = np.full((len(colours), 4), 65535, "<u2")
        rows[:, :3] = np.rint(65535.0 * np.clip(colours, 0.0, 1.0))
        return self.accessor(self.vertices(rows), rows, "VEC4", UNSIGNED, normalized=True)

    def floats(self, values: np.ndarray, kind: str, bounded: bool = False) -> int:
        """Add the values of an attribute, float32."""
        rows = values.astype("<f4")
        return self.accessor(self.vertices(rows), rows, kind, FLOAT, bounded=bounded)

    def indices(self, faces: np.ndarray) -> int:
        """Add the corners of faces (F, 3)."""
        indices = faces.reshape(-1).astype("<u4")
        if self.compresses:
            view = self._view(encode_indices(indices), len(indices), 4, "INDICES", target=_INDICES)
        else:
            view = self.raw(indices, target=_INDICES)
        return self.accessor(view, indices, "SCALAR", WIDE)

    def vertices(self, rows: np.ndarray) -> int:
        """Add the rows of an attribute, each a multiple of four bytes long; return the view's number."""
        if not self.compresses:
            stride = rows.itemsize * rows.shape[1]
            return self.raw(rows, target=_VERTICES, byteStride=stride)
        return self.compressed(np.ascontiguousarray(rows).view(np.uint8))

    def raw(self, values: np.ndarray, **more: int) -> int:
        """Add values without compression; return the number of their view."""
        content = np.ascontiguousarray(values).tobytes()
        view = {"buffer": 0, "byteOffset": self._store(content), "byteLength": len(content), **more}
        return self.append("bufferViews", view)

    def compressed(self, elements: np.ndarray, *filters: str) -> int:
        """Add elements, uint8 (N, stride), compressed; return the number of their view."""
        count, stride = elements.shape
        content = encode_attributes(elements)
        return self._view(content, count, stride, "ATTRIBUTES", *filters, target=_VERTICES, byteStride=stride)

    def _view(self, content: bytes, count: int, stride: int, mode: str, *filters: str, **more: int) -> int:
        self.used.add(_MESHOPT)
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
        return self.append("bufferViews", view | {"extensions": {_MESHOPT: extension}})

    def _store(self, content: bytes) -> int:
        """Append bytes to the binary data at a multiple of four, and return where they are."""
        at = len(self.binary)
        self.binary += content + bytes(-len(content) % 4)
        return at

    def accessor(
        self,
        view: int,
        values: np.ndarray,
        kind: str,
        component: int,
        bounded: bool = False,
        normalized: bool = False,
    ) -> int:
        """Add an accessor for values that a view holds; return its number."""
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
        return self.append("accessors", accessor)

    def _material(
        self, part: ExportedMaterial, shows_colours: bool, is_closed: bool | None
    ) -> dict[str, Any]:
        """Return the glTF material that is nearest to a material."""
        surface = part.surface
        colour = (1.0, 1.0, 1.0) if shows_colours else surface.colour
        inputs: dict[str, Any] = {
            "baseColorFactor": [*colour, surface.opacity],
            "metallicFactor": surface.metallic,
            "roughnessFactor": surface.roughness,
        }
        for name, picture in ("baseColorTexture", part.colour), ("metallicRoughnessTexture", part.numbers):
            if picture is not None:
                inputs[name] = {"index": self._texture(picture)}
        material: dict[str, Any] = {
            "pbrMetallicRoughness": inputs,
            **({} if is_closed is None else {"doubleSided": not is_closed}),
            "alphaMode": "BLEND" if surface.opacity < 1.0 or part.is_cut_out else "OPAQUE",
        }
        if part.cutoff is not None:
            material |= {"alphaMode": "MASK", "alphaCutoff": part.cutoff}
        if part.normals is not None:
            material["normalTexture"] = {"index": self._texture(part.normals), "scale": part.bump}
        extensions = {}
        if surface.clearcoat:
            extensions["KHR_materials_clearcoat"] = {"clearcoatFactor": surface.clearcoat}
        if surface.is_matt:
            extensions["KHR_materials_specular"] = {"specularFactor": 0.0}
        if extensions and not self.plain:
            self.used.update(extensions)
            material["extensions"] = extensions
        return material

    def _texture(self, picture: EmbeddedPicture) -> int:
        """Add a texture, unless it is there; return its number."""
        if picture not in self._textures:
            wraps = zip(("wrapS", "wrapT"), (_WRAPS[mode] for mode in picture.wrap), strict=True)
            sampler = {**_FILTERS, **dict(wraps)}
            if sampler not in self.lists["samplers"]:
                self.append("samplers", sampler)
            view = self.raw(np.frombuffer(picture.content, np.uint8))
            image = self.append("images", {"bufferView": view, "mimeType": picture.kind})
            self._textures[picture] = self.append(
                "textures", {"sampler": self.lists["samplers"].index(sampler), "source": image}
            )
        return self._textures[picture]

    def append(self, kind: str, entry: dict[str, Any]) -> int:
        """Add an object of the document; return its number."""
        self.lists[kind].append(entry)
        return len(self.lists[kind]) - 1
