"""Write FBX files, text and binary (version 7.4), from nodes: for tests, and samples of damaged files."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

CORNERS = [(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


@dataclass
class N:
    """A node of FBX; values are integers, floats, text, bytes, or lists of integers or floats."""

    name: str
    values: Sequence[Any] = ()
    children: list[N] = field(default_factory=list)


def properties(**given: Any) -> N:
    """Return the properties of an element; double underscores in names stand for spaces."""
    rows = []
    for name, value in given.items():
        row = value if isinstance(value, tuple | list) else (value,)
        kind = "Vector3D" if len(row) == 3 else "int" if isinstance(value, int) else "double"
        rows.append(N("P", (name.replace("__", " "), kind, "", "A", *row)))
    return N("Properties70", (), rows)


def box_geometry(number: int, *layers: N, sides: Sequence[Sequence[int]] = SIDES) -> N:
    """Return a box of quads from -1 to 1, with its faces outwards."""
    ends = [corner for side in sides for corner in (*side[:-1], -1 - side[-1])]
    points = [value for corner in CORNERS for value in corner]
    children = [N("Vertices", (points,)), N("PolygonVertexIndex", (ends,)), *layers]
    return N("Geometry", (number, "Geometry::", "Mesh"), children)


def layer(kind: str, mapping: str, name: str, values: list[Any]) -> N:
    """Return a layer element of a geometry: smoothing, materials, creases."""
    children = [N("MappingInformationType", (mapping,)), N("ReferenceInformationType", ("Direct",))]
    return N(kind, (0,), [*children, N(name, (values,))])


def coordinates(name: str, values: Sequence[float], index: int = 0) -> N:
    """Return texture coordinates (C, 2) of the corners of a geometry, which may have several sets."""
    element = layer("LayerElementUV", "ByPolygonVertex", "UV", list(values))
    return N("LayerElementUV", (index,), [N("Name", (name,)), *element.children])


def material(number: int, kind: str = "Lambert", **given: Any) -> N:
    """Return a material; `kind` is its shading model."""
    children = [N("ShadingModel", (kind,)), properties(**given)]
    return N("Material", (number, f"Material::{number}", ""), children)


def texture(number: int, name: str, uv_set: str = "default", **given: Any) -> N:
    """Return a texture of a picture's file."""
    rows = [*properties(**given).children, N("P", ("UVSet", "KString", "", "", uv_set))]
    children = [N("Type", ("TextureVideoClip",)), N("FileName", (name,)), N("RelativeFilename", (name,))]
    return N("Texture", (number, f"Texture::{number}", ""), [*children, N("Properties70", (), rows)])


def video(number: int, name: str, content: bytes) -> N:
    """Return a picture within a file."""
    children = [N("Type", ("Clip",)), N("Filename", (name,)), N("Content", (content,))]
    return N("Video", (number, f"Video::{number}", "Clip"), children)


def model(number: int, name: str, kind: str = "Mesh", **given: Any) -> N:
    """Return a node of the scene."""
    return N("Model", (number, f"Model::{name}", kind), [properties(**given)])


def scene(
    objects: Iterable[N], links: Iterable[tuple[Any, ...]], creator: str = "", **settings: Any
) -> list[N]:
    """Return a scene.

    links     child and parent by number, and the property of the parent if it is one; 0 is the root
    creator   the program that wrote it
    settings  global ones, as UpAxis
    """
    return [
        N("FBXHeaderExtension", (), [N("FBXVersion", (7400,)), N("Creator", (creator,))]),
        N("GlobalSettings", (), [properties(**settings)]),
        N("Objects", (), list(objects)),
        N("Connections", (), [N("C", ("OP" if link[2:] else "OO", *link)) for link in links]),
    ]


def text(nodes: Iterable[N]) -> bytes:
    """Return the nodes as a text file."""
    return b"; FBX 7.4.0 project file\n" + "".join(_text(node, "") for node in nodes).encode()


def _text(node: N, indent: str) -> str:
    if node.values and isinstance(node.values[0], list):
        numbers = ",".join(map(repr, node.values[0]))
        return f"{indent}{node.name}: *{len(node.values[0])} {{\n{indent}\ta: {numbers}\n{indent}}}\n"
    values = ",".join(f'"{value}"' if isinstance(value, str) else repr(value) for value in node.values)
    below = "".join(_text(child, indent + "\t") for child in node.children)
    return f"{indent}{node.name}: {values}" + (f" {{\n{below}{indent}}}\n" if node.children else "\n")


def binary(nodes: Iterable[N]) -> bytes:
    """Return the nodes as a binary file."""
    content = b"Kaydara FBX Binary  \x00\x1a\x00" + struct.pack("<I", 7400)
    for node in nodes:
        content += _binary(node, len(content))
    return content + bytes(13) + bytes(16 + 4) + struct.pack("<I", 7400) + bytes(120 + 16)


def _binary(node: N, start: int) -> bytes:
    name = node.name.encode()
    values = b"".join(map(_value, node.values))
    content = name + values
    at = start + 13 + len(content)
    for child in node.children:
        below = _binary(child, at)
        content, at = content + below, at + len(below)
    if node.children:
        content += bytes(13)
    end = start + 13 + len(content)
    return struct.pack("<IIIB", end, len(node.values), len(values), len(name)) + content


def _value(value: Any) -> bytes:
    match value:
        case int():
            return b"L" + struct.pack("<q", value)
        case float():
            return b"D" + struct.pack("<d", value)
        case bytes():
            return b"R" + struct.pack("<I", len(value)) + value
        case str():
            name, _, kind = value.partition("::")  # binary files have name, then class
            word = (f"{kind}\x00\x01{name}" if kind or "::" in value else value).encode()
            return b"S" + struct.pack("<I", len(word)) + word
    is_float = any(isinstance(number, float) for number in value)
    plain = struct.pack(f"<{len(value)}{'d' if is_float else 'i'}", *value)
    packed = zlib.compress(plain) if is_float else plain  # files have arrays of both kinds
    return (b"d" if is_float else b"i") + struct.pack("<III", len(value), is_float, len(packed)) + packed
