"""Texture coordinates, vertex colours and materials of Wavefront OBJ files.

Materials are those of the MTL files that the OBJ names, by its specification (Wavefront, Advanced Visualizer)
with the roughness, metalness and normal map that Blender, Substance and others add (``Pr``, ``Pm``,
``norm``), and ``Tr``. Colours are sRGB.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from flowsculpt import MeshError
from flowsculpt.api import shorten
from flowsculpt.api.files import InputFile, number_fault, text_content
from flowsculpt.api.materials import Opacity, Texture, linear_of_srgb
from flowsculpt.api.meshes import ModelMaterials, PaintReader
from flowsculpt.pipeline.plugins.interchange.model_paint import ModelPaint
from flowsculpt.pipeline.plugins.interchange.obj_files import statements
from flowsculpt.pipeline.plugins.interchange.painted_materials import (
    GREY,
    FileMaterial,
    file_beside,
    found_beside,
    mask_of,
    opacity_of,
    painted,
    picture,
)

_NAMES = re.compile(rb"^[ \t]*(usemtl|mtllib)[ \t]+([^\r\n]*)", re.MULTILINE)

_MOST_BYTES = 1 << 30  # size of the largest file

_PLACES = {b"-o": "0", b"-s": "1", b"-t": "0"}
"""Options of up to three numbers that move a texture, and the numbers that move nothing."""


def _read_paint(path: Path) -> ModelPaint:
    """Read the paint of an OBJ file. Raises ValueError, with its line, for unreadable input."""
    reader = _Paint()
    for line, words in statements(text_content(InputFile(path, _MOST_BYTES).content()), 1):
        try:
            reader.add(words)
        except (ValueError, IndexError) as error:
            raise ValueError(f"line {line}: {error}") from None
    return reader.paint()


class _Paint:
    """Collects points, colours, texture coordinates and materials from the statements of a file."""

    def __init__(self) -> None:
        self._points: list[list[float]] = []
        self._colours: list[list[float]] = []
        self._coordinates: list[list[float]] = [[0.0, 0.0]]  # that of corners without one
        self._corners: list[int] = []
        self._placed: list[int] = []
        self._sides: list[int] = []
        self._materials: list[int] = []
        self._numbers: dict[bytes, int] = {}
        self._material = b""

    def add(self, words: list[bytes]) -> None:
        """Add what a statement says. Raises ValueError."""
        match words[0]:
            case b"v":
                self._points.append([float(word) for word in words[1:4]])
                self._colours.append([float(word) for word in words[4:7]] if len(words) >= 7 else [])
            case b"vt":
                numbers = [float(word) for word in words[1:3]]
                self._coordinates.append([*numbers, 0.0][:2])
            case b"f" | b"fo" if len(words) > 3:
                self._sides.append(len(words) - 1)
                self._materials.append(self._numbers.setdefault(self._material, len(self._numbers)))
                for word in words[1:]:
                    vertex, _, rest = word.partition(b"/")
                    placed = rest.partition(b"/")[0]
                    self._corners.append(_index(vertex, len(self._points)))
                    self._placed.append(_index(placed, len(self._coordinates) - 1) + 1 if placed else 0)
            case b"usemtl":
                self._material = b" ".join(words[1:])

    def paint(self) -> ModelPaint:
        """Return the paint. Raises ValueError where a face names what is not there."""
        corners, placed = np.array(self._corners, np.int64), np.array(self._placed, np.int64)
        points, coordinates = np.array(self._points).reshape(-1, 3), np.array(self._coordinates)
        for name, used, there in ("v", corners, len(points)), ("vt", placed, len(coordinates)):
            if used.size and not 0 <= used.min() <= used.max() < there:
                raise ValueError(f"a face names a {name} that the file does not have")
        colours = None
        if self._colours and all(self._colours):
            colours = linear_of_srgb(np.clip(np.array(self._colours), 0.0, 1.0))[corners]
        sides, materials = np.array(self._sides, np.int64), np.array(self._materials, np.int64)
        return ModelPaint.of(points, sides, corners, coordinates[placed], materials, colours)


def _index(word: bytes, count: int) -> int:
    """Return the number, from 0, of what a corner names; negative numbers count back from the last."""
    number = int(word)
    return number - 1 if number > 0 else count + number


def _materials(path: Path) -> ModelMaterials:
    """Return the materials of a file in the order of its paint.

    Raises MissingInputError where none of the files that it names is there, MeshError for damaged numbers.
    """
    content = text_content(InputFile(path, _MOST_BYTES).content())
    used: dict[bytes, None] = {}
    libraries: dict[bytes, None] = {}
    current, at = b"", 0
    faces = re.compile(rb"^[ \t]*fo?[ \t]", re.MULTILINE)
    for match in [*_NAMES.finditer(content), None]:
        if faces.search(content, at, match.start() if match else len(content)):
            used[current] = None
        if match is None:
            break
        at, name = match.end(), match[2].partition(b"#")[0].strip()
        if match[1] == b"usemtl":
            current = b" ".join(name.split())
        else:
            libraries[name] = None
    known: dict[bytes, tuple[Path, dict[bytes, list[bytes]]]] = {}
    files: dict[Path, str] = {}
    found, missing = _libraries(path, [name.decode("utf-8", "replace") for name in libraries])
    for library in found:
        files[library] = InputFile(library).digest()
        for material, entries in _entries(library):
            known.setdefault(material, (library, entries))
    notes = [f"it names its materials {shorten(name)}, which is not there" for name in missing]
    unknown = [name for name in used if name and name not in known]
    for name in unknown[:_MOST_NOTES]:
        notes.append(f"its material {_text(name)} is in none of its files of materials")
    has_colours = bool(re.search(rb"^[ \t]*v(?:[ \t]+[^\s]+){6}", content, re.MULTILINE))
    parts = []
    for name in used:
        library, entries = known.get(name, (path, {}))
        parts.append(_material(library, _text(name), entries, files, has_colours))
        notes += [f"material {_text(name)}: {note}" for note in _notes(entries)]
    return ModelMaterials(tuple(parts), files, tuple(notes))


_MOST_NOTES = 3  # of materials that no file defines


def _text(name: bytes) -> str:
    return shorten(name.decode("utf-8", "replace"))


def _libraries(model: Path, statements: list[str]) -> tuple[list[Path], list[str]]:
    """Return the files of materials that statements name, and the names of those that are not there.

    The name of a file may have spaces, and a statement name several files: the longest names of files that
    are there count. Raises MissingInputError where none is there.
    """
    found, missing = list[Path](), list[str]()
    for statement in statements:
        words = [quoted or word for quoted, word in re.findall(r'"([^"]+)"|(\S+)', statement)]
        if (whole := found_beside(model, statement.strip('"'))) is not None:
            found.append(whole)
            continue
        first = 0
        while first < len(words):
            for end in range(len(words), first, -1):
                if (path := found_beside(model, " ".join(words[first:end]))) is not None:
                    found.append(path)
                    break
            else:
                missing.append(words[first])
            first = end
    if missing and not found:
        file_beside(model, statements[0].strip('"'), "materials")
    return found, missing


def _entries(library: Path) -> Iterator[tuple[bytes, dict[bytes, list[bytes]]]]:
    """Yield the materials of an MTL file: names, and the words of each statement by its first, in small
    letters, as programs write them in both ways."""
    entries: dict[bytes, list[bytes]] = {}
    for _, words in statements(text_content(InputFile(library, _MOST_BYTES).content()), 1):
        if words[0] == b"newmtl":
            entries = {}
            yield b" ".join(words[1:]), entries
        else:
            entries[words[0].lower()] = words[1:]


_NOT_SHOWN = (b"map_ke", b"map_ks", b"map_ns", b"map_pr", b"map_pm", b"map_bump", b"bump", b"disp")
"""Statements of an MTL file that name pictures which other programs show."""


def _notes(entries: dict[bytes, list[bytes]]) -> Iterator[str]:
    """Yield lines about what a material has that is not shown."""
    if lost := [name.decode() for name in _NOT_SHOWN if name in entries]:
        yield f"not shown: {', '.join(lost)}"
    if any(_colour(entries, b"ke") or ()):
        yield "its glow, Ke, is not shown"
    if entries.get(b"kd") and _colour(entries, b"kd") is None:
        yield f"its colour, Kd {shorten(b' '.join(entries[b'kd']).decode('utf-8', 'replace'))}, is not read"


def _material(
    library: Path, name: str, entries: dict[bytes, list[bytes]], files: dict[Path, str], has_colours: bool
) -> FileMaterial:
    """Return the material of the statements of an MTL file; note the pictures that it names.

    Raises MeshError for numbers with commas.
    """
    for key in _NUMBERS:
        fault = number_fault(entries.get(key, []))
        if "point" in fault:
            raise MeshError(f"{library.name}, material {name}: {key.decode()}: {fault}")
    colour = _colour(entries, b"kd") or GREY
    texture = normals = None
    if words := entries.get(b"map_kd"):
        texture = _picture(library, words, files)
    if words := entries.get(b"norm"):
        normals = _picture(library, words, files, "data")
        strength = {b"-bm": words[words.index(b"-bm") + 1 :]} if b"-bm" in words else {}
        scale = _number(strength, b"-bm", 1.0)
        normals = replace(normals, factor=(scale, scale, 1.0))
    more: dict[str, Any] = {"normal_texture": normals, "opacity": _opacity(library, entries, files)}
    specular, shine = _colour(entries, b"ks"), _number(entries, b"ns", 0.0)
    metallic, roughness = _number(entries, b"pm", 0.0), _number(entries, b"pr", -1.0)
    if roughness < 0.0:
        is_matt = not metallic and (not specular or not any(specular) or not shine)
        roughness = 1.0 if is_matt else (2.0 / (max(shine, 0.0) + 2.0)) ** 0.25
        if is_matt:
            return painted(colour, texture, has_colours=has_colours, **more)
    roughness, metallic = min(roughness, 1.0), min(max(metallic, 0.0), 1.0)
    return painted(colour, texture, roughness, metallic, has_colours, **more)


_NUMBERS = (b"kd", b"ks", b"ns", b"pm", b"pr", b"d", b"tr")


def _opacity(library: Path, entries: dict[bytes, list[bytes]], files: dict[Path, str]) -> Opacity | None:
    """Return the opacity of a material. Raises MeshError for a `Tr` that programs read in two ways."""
    dissolved = entries.get(b"d", [])[-1:]  # behind an option of halos
    factor = _number({b"d": dissolved}, b"d", 1.0 - _number(entries, b"tr", 0.0))
    words, texture = entries.get(b"map_d"), None
    if factor == 0.0 and not dissolved:
        raise MeshError(
            "a material has Tr 1, which some programs write for opaque ones. Write d in its place, or write "
            "paint: off."
        )
    if words is not None:
        texture = _picture(library, words, files, "data")
        option = words[words.index(b"-imfchan") + 1 :] if b"-imfchan" in words else []
        channel = {b"r": 0, b"g": 1, b"b": 2, b"m": Texture.ALPHA}.get(option[0] if option else b"")
        texture = mask_of(texture) if channel is None else replace(texture, channel=channel)
    return opacity_of(factor, texture)


def _picture(library: Path, words: list[bytes], files: dict[Path, str], space: str | None = None) -> Texture:
    """Return the picture that a statement names; with `-clamp on` it does not repeat."""
    texture = picture(library, _picture_name(words), files, space)
    option = words[words.index(b"-clamp") + 1 :][:1] if b"-clamp" in words else []
    return replace(texture, wrap=("clamp", "clamp")) if option == [b"on"] else texture


def _picture_name(words: list[bytes]) -> str:
    """Return the file that a statement names behind its options. Raises MeshError for what moves it."""
    at = 0
    while at < len(words) - 1 and words[at].startswith(b"-"):
        option = words[at]
        if option in _PLACES:
            end = at + 1
            while end < min(at + 4, len(words) - 1) and re.fullmatch(rb"[-+.\deE]+", words[end]):
                end += 1
            if any(float(word) != float(_PLACES[option]) for word in words[at + 1 : end]):
                raise MeshError(
                    f"a texture of its materials has the option {shorten(option.decode())}, which is not "
                    "read. Export the model with the texture coordinates that show."
                )
            at = end
        else:
            at += 1 + (2 if option == b"-mm" else 1)
    return b" ".join(words[at:]).decode("utf-8", "replace")


def _colour(entries: dict[bytes, list[bytes]], name: bytes) -> tuple[float, float, float] | None:
    words = entries.get(name, [])
    try:
        numbers = [min(max(float(word), 0.0), 1.0) for word in words[:3]]
    except ValueError:  # spectral, or of another program
        return None
    if len(numbers) not in (1, 3) or not all(map(math.isfinite, numbers)):
        return None
    red, green, blue = linear_of_srgb(np.array(numbers * 3)[:3]).tolist()
    return red, green, blue


def _number(entries: dict[bytes, list[bytes]], name: bytes, otherwise: float) -> float:
    try:
        number = float(entries[name][0])
    except (KeyError, IndexError, ValueError):
        return otherwise
    return number if math.isfinite(number) else otherwise


OBJ_PAINT = PaintReader(_materials, _read_paint)
