"""glTF 1.0: its JSON, rewritten as that of glTF 2.0. Its objects have names in place of numbers."""

from __future__ import annotations

from typing import Any

from pipeline.errors import MeshError, brief

_BINARY = ("binary_glTF", "KHR_binary_glTF")
"""Names of the buffer that a GLB holds itself."""

_MOST_PRIMITIVES = 1_000_000
"""Most primitives of the meshes that nodes join."""

_KINDS = ("buffers", "bufferViews", "accessors", "meshes", "nodes", "scenes")


def as_version_2(root: dict[str, Any]) -> dict[str, Any]:
    """Return the JSON of a 1.0 file as that of a 2.0 file; what is not about surfaces is left out.

    Raises MeshError for skins and quantized attributes, ValueError for a name that is not there.
    """
    for name in root.get("extensionsUsed", []):
        if str(name).startswith("WEB3D_"):
            raise MeshError(f"it uses the extension {brief(name)}, which is not read. Export it as glTF 2.0.")
    try:
        return _rewritten(root)
    except KeyError as error:
        raise ValueError(f"it names {brief(str(error))}, which it does not define") from None
    except (TypeError, AttributeError) as error:
        raise ValueError(f"its JSON is not as glTF 1.0 defines it ({error})") from None


def _rewritten(root: dict[str, Any]) -> dict[str, Any]:
    numbers = {kind: {name: k for k, name in enumerate(_names(root, kind))} for kind in _KINDS}
    rewriter = _Rewriter(root, numbers)
    scenes = root.get("scenes", {}).values()
    return {
        "asset": {"version": "2.0"},
        **({"scene": numbers["scenes"][root["scene"]]} if "scene" in root else {}),
        "scenes": [
            {"nodes": [numbers["nodes"][node] for node in scene.get("nodes", [])]} for scene in scenes
        ],
        "nodes": [rewriter.node(node) for node in root.get("nodes", {}).values()],
        "meshes": rewriter.meshes,
        "accessors": [rewriter.accessor(accessor) for accessor in root.get("accessors", {}).values()],
        "bufferViews": rewriter.views,
        "buffers": [_buffer(name, root["buffers"][name]) for name in numbers["buffers"]],
    }


def _names(root: dict[str, Any], kind: str) -> list[str]:
    """Return the names of objects in the order of their numbers; the buffer of a GLB comes first."""
    return sorted(root.get(kind, {}), key=lambda name: kind != "buffers" or name not in _BINARY)


def _buffer(name: str, buffer: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in buffer.items() if key != "uri" or name not in _BINARY}


class _Rewriter:
    """The lists that grow while objects are rewritten: nodes may have several meshes, accessors a stride."""

    def __init__(self, root: dict[str, Any], numbers: dict[str, dict[str, int]]) -> None:
        self._root, self._numbers = root, numbers
        self.meshes: list[dict[str, Any]] = []
        self.views: list[dict[str, Any]] = []
        self._joined: dict[tuple[str, ...], int] = {}
        self._count = 0

    def node(self, node: dict[str, Any]) -> dict[str, Any]:
        if "skin" in node or "skeletons" in node:
            raise MeshError("it is glTF 1.0 with a skin, which is not read. Export it as glTF 2.0.")
        placed: dict[str, Any] = {
            name: node[name] for name in ("matrix", "translation", "rotation", "scale") if name in node
        }
        placed["children"] = [self._numbers["nodes"][child] for child in node.get("children", [])]
        if node.get("meshes"):
            placed["mesh"] = self._mesh(tuple(node["meshes"]))
        return placed

    def _mesh(self, names: tuple[str, ...]) -> int:
        """Return the number of the mesh that joins those of these names."""
        if names not in self._joined:
            shown: list[dict[str, Any]] = []
            for name in names:
                shown += self._root["meshes"][name].get("primitives", [])
                if self._count + len(shown) > _MOST_PRIMITIVES:
                    raise ValueError(f"its nodes join over {_MOST_PRIMITIVES} primitives")
            self._count += len(shown)
            self._joined[names] = len(self.meshes)
            self.meshes.append({"primitives": [self._primitive(part) for part in shown]})
        return self._joined[names]

    def _primitive(self, primitive: dict[str, Any]) -> dict[str, Any]:
        numbers = self._numbers["accessors"]
        attributes = {name: numbers[accessor] for name, accessor in primitive["attributes"].items()}
        indices = {"indices": numbers[primitive["indices"]]} if "indices" in primitive else {}
        return {"attributes": attributes, "mode": primitive.get("mode", 4), **indices}

    def accessor(self, accessor: dict[str, Any]) -> dict[str, Any]:
        view = self._root["bufferViews"][accessor["bufferView"]]
        place = {
            "buffer": self._numbers["buffers"][view["buffer"]],
            "byteStride": accessor.get("byteStride", 0),
        }
        self.views.append({**view, **place})
        return {**accessor, "bufferView": len(self.views) - 1}
