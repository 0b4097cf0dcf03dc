"""The document of a glTF file: its JSON, checked as it is read, and its buffers, wherever they are.

The JSON of glTF 1.0, whose objects have names in place of numbers, is rewritten as that of glTF 2.0.
"""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from sys import float_info
from typing import Any, BinaryIO
from urllib.parse import unquote, unquote_to_bytes

from flowsculpt import MeshError
from flowsculpt.api import shorten
from flowsculpt.api.files import InputFile
from flowsculpt.pipeline.plugins.interchange.scene_readers import early_end

_LARGEST = float_info.max

_BINARY = ("binary_glTF", "KHR_binary_glTF")  # names of the buffer that a GLB holds itself
_MOST_PRIMITIVES = 1_000_000  # most primitives of the meshes that nodes join

_KINDS = ("buffers", "bufferViews", "accessors", "meshes", "nodes", "scenes")


def as_version_2(root: dict[str, Any]) -> dict[str, Any]:
    """Return the JSON of a 1.0 file as that of a 2.0 file; what is not about surfaces is left out.

    Raises MeshError for skins and quantized attributes, ValueError for a name that is not there.
    """
    for name in root.get("extensionsUsed", []):
        if str(name).startswith("WEB3D_"):
            raise MeshError(
                f"it uses the extension {shorten(name)}, which is not read. Export it as glTF 2.0."
            )
    try:
        return _rewritten(root)
    except KeyError as error:
        raise ValueError(f"it names {shorten(str(error))}, which it does not define") from None
    except (TypeError, AttributeError) as error:
        raise ValueError(f"its JSON is not as glTF 1.0 defines it ({error})") from None


def _rewritten(root: dict[str, Any]) -> dict[str, Any]:
    numbers = {kind: {name: k for k, name in enumerate(_names(root, kind))} for kind in _KINDS}
    rewriter = _Rewriter(root, numbers)
    scenes = root.get("scenes", {}).values()
    return {
        "asset": {"version": "2.0", "rewritten": True},
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


MOST_BYTES = 1 << 30  # size of the largest file, and of the largest buffer

MOST_JSON = 64 << 20
"""Size of the largest JSON, without the data in its addresses: parsed, it may take 25 times as much."""

_DATA = re.compile(rb'"data:[^"]{64,}"')

_NOT_RELATIVE = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+:|[/\\]|[A-Za-z]:[/\\]")

MESHOPT = ("KHR_meshopt_compression", "EXT_meshopt_compression")


class JsonObject:
    """An object of the JSON, and its place for messages: `accessor 3`. Every getter raises ValueError."""

    def __init__(self, values: object, place: str) -> None:
        if not isinstance(values, dict):
            raise ValueError(f"{place} is {shorten(repr(values))}; it must be an object")
        self.values: dict[str, Any] = values
        self.place = place

    def __contains__(self, name: str) -> bool:
        return name in self.values

    def entry(self, name: str) -> JsonObject:
        """Return an object; an empty one where it is not there."""
        return JsonObject(self.values.get(name, {}), f"{name} of {self.place}")

    def extension(self, *names: str) -> JsonObject | None:
        """Return the first of the named extensions that is there."""
        there = self.entry("extensions")
        return next((there.entry(name) for name in names if name in there), None)

    def items(self, name: str) -> list[Any]:
        """Return a list; an empty one where it is not there."""
        values = self.values.get(name, [])
        if not isinstance(values, list):
            raise self._wrong(name, "a list")
        return values

    def entries(self, name: str) -> Iterator[JsonObject]:
        """Yield the objects of a list."""
        for number, values in enumerate(self.items(name)):
            yield JsonObject(values, f"{name}[{number}] of {self.place}")

    def whole(self, name: str, default: int | None = None) -> int:
        """Return a whole number from 0; without a default it must be there."""
        value = self.values.get(name, default)
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if not isinstance(value, int) or isinstance(value, bool) or value < 0:
            raise self._wrong(name, "a whole number")
        return value

    def numbers(self, name: str, count: int | None = None) -> list[float]:
        """Return a list of finite numbers, `count` of them."""
        values = self.items(name)
        if not all(
            isinstance(v, int | float) and not isinstance(v, bool) and abs(v) <= _LARGEST for v in values
        ):
            raise self._wrong(name, "finite numbers")
        if count is not None and len(values) != count:
            raise self._wrong(name, f"{count} numbers")
        return values

    def number(self, name: str, default: float) -> float:
        """Return a finite number."""
        (value,) = JsonObject({name: [self.values.get(name, default)]}, self.place).numbers(name)
        return float(value)

    def text(self, name: str, default: str = "") -> str:
        value = self.values.get(name, default)
        if not isinstance(value, str):
            raise self._wrong(name, "text")
        return value

    def _wrong(self, name: str, wanted: str) -> ValueError:
        there = f"is {shorten(repr(self.values[name]))}" if name in self.values else "is not there"
        return ValueError(f"{name} of {self.place} {there}; it must be {wanted}")


@dataclass(frozen=True)
class GltfDocument:
    """A glTF file, from whose buffers nothing is read yet.

    root      its JSON, of version 2.0
    binary    offset and size of the binary chunk of a GLB
    embedded  addresses with data, which were cut from the JSON before it was parsed
    """

    path: Path
    root: JsonObject
    binary: tuple[int, int] | None
    embedded: tuple[bytes, ...]

    @classmethod
    def read(cls, path: Path) -> GltfDocument:
        """Read a .gltf or .glb, by its content. Raises ValueError where it is neither, or ends early."""
        with InputFile(path, MOST_BYTES).open() as (file, size):
            head = file.read(min(size, 12))
            if head[:4] == b"glTF":
                promised = max(int.from_bytes(head[8:12], "little"), 12)
                if size < promised:
                    raise early_end(promised, "byte", size)
                (start, length), binary = _places(file, int.from_bytes(head[4:8], "little"), promised)
                file.seek(start)
                return cls._parsed(path, file.read(length).rstrip(b"\0"), binary)
        if path.suffix.lower() == ".glb":
            raise ValueError("it has no GLB header")
        return cls._parsed(path, InputFile(path, MOST_BYTES).content(), None)

    @classmethod
    def _parsed(cls, path: Path, text: bytes, binary: tuple[int, int] | None) -> GltfDocument:
        embedded: list[bytes] = []

        def cut(address: re.Match[bytes]) -> bytes:
            embedded.append(address[0][1:-1])
            return b'"data:%d"' % (len(embedded) - 1)

        text = _DATA.sub(cut, text)
        if len(text) > MOST_JSON:
            raise ValueError(f"its JSON has {len(text) >> 20} MiB; up to {MOST_JSON >> 20} MiB are read")
        root = JsonObject(_parsed_json(text), "the file")
        asset = root.entry("asset").values
        version, least = str(asset.get("version", "2.0")), str(asset.get("minVersion", "2.0"))
        if version.startswith("1") or isinstance(root.values.get("meshes"), dict):
            root = JsonObject(as_version_2(root.values), "the file")
        elif not version.startswith("2") or least not in ("2", "2.0"):
            raise _other_version(version if least in ("2", "2.0") else least)
        return cls(path, root, binary, tuple(embedded))

    def item(self, kind: str, index: object, named_by: str) -> JsonObject:
        """Return an object of one of the lists of the file: `item("nodes", 3, "scene 0")`."""
        there, singular = self.root.items(kind), kind.removesuffix("es" if kind == "meshes" else "s")
        if not isinstance(index, int) or isinstance(index, bool) or not 0 <= index < len(there):
            raise ValueError(
                f"{named_by} names {singular} {shorten(repr(index))}; there are {len(there)}, from 0"
            )
        return JsonObject(there[index], f"{singular} {index}")

    def buffer_file(self, index: int) -> Path | None:
        """Return the file of a buffer; None where it is in the glTF file itself.

        Raises ValueError for an address on the network or from the root of the file system.
        """
        buffer = self.item("buffers", index, "a buffer view")
        if "uri" not in buffer or buffer.text("uri").startswith("data:"):
            return None
        address = buffer.text("uri")
        if _NOT_RELATIVE.match(address):
            raise ValueError(
                f"the address of {buffer.place} is {shorten(address)}; only files at addresses relative to "
                "this one are read"
            )
        names = (unquote(address), address, unquote(address).replace("\\", "/"))
        paths = [self.path.parent / name for name in names]
        return next((path for path in paths if _is_there(path)), paths[0])

    def buffer(self, index: int) -> bytes:
        """Return the content of a buffer. Raises ValueError, and what `read_input` raises."""
        buffer = self.item("buffers", index, "a buffer view")
        file = self.buffer_file(index)
        if file is not None:
            return InputFile(file, MOST_BYTES).content()
        if "uri" in buffer:
            return self.embedded_content(buffer)
        if index > 0 or self.binary is None:
            raise ValueError(f"{buffer.place} has no address, and is not the binary chunk of a GLB")
        offset, size = self.binary
        with InputFile(self.path, MOST_BYTES).open() as (opened, _):
            opened.seek(offset)
            return opened.read(size)

    def embedded_content(self, buffer: JsonObject) -> bytes:
        """Return the bytes of an address with data, as base64 or with percent signs."""
        address = buffer.text("uri").encode()
        cut = address.removeprefix(b"data:")
        if cut.isdigit() and int(cut) < len(self.embedded):
            address = self.embedded[int(cut)]
        head, comma, data = address.partition(b",")
        if not comma:
            raise ValueError(f"the address of {buffer.place} has no data")
        if not head.endswith(b";base64"):
            return unquote_to_bytes(data)
        data = unquote_to_bytes(data).replace(b"\\/", b"/")
        return base64.b64decode(data + b"=" * (-len(data) % 4), altchars=b"-_" if b"-" in data else None)


def _parsed_json(text: bytes) -> object:
    """Return the value of JSON. Raises ValueError, also where it is nested too deeply to be read."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("its JSON has brackets within brackets, too deep to be read") from None
    except ValueError as error:
        if "set_int_max_str_digits" in str(error):
            raise ValueError("its JSON has a number of over 4300 digits") from None
        raise


def _places(file: BinaryIO, version: int, end: int) -> tuple[tuple[int, int], tuple[int, int] | None]:
    """Return the offset and size of the JSON in a GLB, and those of its binary data if it has some."""
    if version == 1:
        file.seek(12)
        length = int.from_bytes(file.read(4), "little")
        return (20, min(length, max(end - 20, 0))), (20 + length, max(end - 20 - length, 0))
    if version != 2:
        raise _other_version(version)
    chunks: dict[bytes, tuple[int, int]] = {}
    at = 12
    while at + 8 <= end:
        file.seek(at)
        length, kind = int.from_bytes(file.read(4), "little"), file.read(4)
        chunks.setdefault(kind, (at + 8, min(length, end - at - 8)))
        at += 8 + length
    if b"JSON" not in chunks:
        raise ValueError("it is a GLB without JSON")
    return chunks[b"JSON"], chunks.get(b"BIN\0")


def _is_there(path: Path) -> bool:
    with suppress(OSError, ValueError):
        return path.is_file()
    return False


def _other_version(version: object) -> MeshError:
    return MeshError(f"it is glTF {shorten(version)}; glTF 1.0 and 2.0 are read. Export it as 2.0.")
