"""glTF files that tests write: a scene from arrays, as a .glb, or as a .gltf and its buffer."""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.pipeline.mesh import TriangleMesh

_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
_COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}


@dataclass
class GltfScene:
    """A scene under construction; every method that adds something returns its number."""

    json: dict[str, Any] = field(
        default_factory=lambda: {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            "nodes": [],
            "meshes": [],
            "accessors": [],
            "bufferViews": [],
        }
    )
    data: bytearray = field(default_factory=bytearray)

    def view(self, content: bytes, **more: Any) -> int:
        self.data += bytes(-len(self.data) % 4)
        place = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(content)}
        self.data += content
        self.json["bufferViews"].append(place | more)
        return len(self.json["bufferViews"]) - 1

    def accessor(self, array: Any, view: int | None = None, **more: Any) -> int:
        """Add an accessor for an array, which is stored unless a view holds it already."""
        array = np.asarray(array)
        if array.dtype == np.float64:
            array = array.astype(np.float32)
        values = {
            "bufferView": self.view(array.tobytes()) if view is None else view,
            "componentType": _COMPONENTS[array.dtype.str[1:]],
            "count": len(array),
            "type": _TYPES[array[0].size if len(array) else 1],
        }
        self.json["accessors"].append(values | more)
        return len(self.json["accessors"]) - 1

    def mesh(self, *primitives: Mapping[str, Any]) -> int:
        self.json["meshes"].append({"primitives": list(primitives)})
        return len(self.json["meshes"]) - 1

    def triangles(self, mesh: TriangleMesh, **more: Any) -> int:
        """Add a mesh of triangles, with positions in single precision."""
        primitive = {
            "attributes": {"POSITION": self.accessor(mesh.vertices)},
            "indices": self.accessor(mesh.faces.reshape(-1).astype(np.uint32)),
        }
        return self.mesh(primitive | more)

    def node(self, root: bool = True, **values: Any) -> int:
        self.json["nodes"].append(values)
        if root:
            self.json["scenes"][0]["nodes"].append(len(self.json["nodes"]) - 1)
        return len(self.json["nodes"]) - 1

    def require(self, *extensions: str) -> None:
        self.json["extensionsUsed"] = self.json["extensionsRequired"] = list(extensions)

    def glb(self, path: Path) -> Path:
        self._name_buffer()
        text = json.dumps(self.json).encode()
        text += b" " * (-len(text) % 4)
        binary = bytes(self.data) + bytes(-len(self.data) % 4)
        chunks = struct.pack("<I", len(text)) + b"JSON" + text
        chunks += struct.pack("<I", len(binary)) + b"BIN\0" + binary
        path.write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks)
        return path

    def gltf(self, path: Path, address: str | None = None, file: str | None = None) -> Path:
        """Write a .gltf; its buffer is in a file at an address, or without one in the .gltf itself."""
        inside = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        self._name_buffer(uri=address or inside)
        if address is not None:
            place = path.parent / (file or address)
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(self.data)
        path.write_text(json.dumps(self.json), encoding="utf-8")
        return path

    def _name_buffer(self, **more: str) -> None:
        first = {"byteLength": len(self.data)} | more
        self.json["buffers"] = [first, *self.json.get("buffers", [])[1:]]


def box_scene(mesh: TriangleMesh, **node: Any) -> GltfScene:
    """Return the scene of one mesh at a node."""
    scene = GltfScene()
    scene.node(mesh=scene.triangles(mesh), **node)
    return scene


def with_instances(scene: GltfScene, **arrays: AnyArray) -> dict[str, Any]:
    """Return the extensions of a node whose mesh stands where arrays say: TRANSLATION, ROTATION, SCALE."""
    given = {name: scene.accessor(array) for name, array in arrays.items()}
    return {"EXT_mesh_gpu_instancing": {"attributes": given}}
