"""Models in 3MF packages, .3mf (3MF Consortium, Core Specification 1.3 and Production Extension 1.1).

The triangles of the objects that the build names are read, in place. Colours, textures and slices are not.
Slicers keep parts in a package that do not belong to the shape: Bambu Studio, OrcaSlicer and PrusaSlicer list
them in files beside the models, Cura in the metadata of objects. They are left out.
"""

from __future__ import annotations

import io
import zipfile
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote

import numpy as np

from flowsculpt import MeshError
from flowsculpt.api import quote, shorten
from flowsculpt.api.meshes import FileSurface, Floats, SourceFiles, SurfaceReader
from flowsculpt.pipeline.plugins.interchange.scene_readers import (
    PlacedMeshes,
    Polygons,
    joined,
    one_file,
    require_vertices,
)
from flowsculpt.pipeline.plugins.interchange.xml_elements import (
    Element,
    limited_parser,
    local_name,
    parse_elements,
)

MOST_OBJECTS = 50_000  # objects that are visited; those of components count each time

MOST_BYTES, _MOST_PACKED = 1 << 30, 200
"""Size of a part of a package unpacked, and how many times its size in the package that may be."""

_SMALL = 1 << 24  # size of parts that may be packed more tightly, bytes
_DEEPEST = 32  # components of components

_UNITS = {
    "micron": 1e-6,
    "millimeter": 1e-3,
    "centimeter": 1e-2,
    "inch": 0.0254,
    "foot": 0.3048,
    "meter": 1.0,
}
"""Length of the units of 3MF, metres."""

_HARMLESS = ("/core/", "/production/", "/material/", "/trianglesets/")
"""Parts of the namespaces of extensions that leave the shape as its triangles are."""

_LEFT_OUT = {"support": "support", "solidsupport": "support", "other": "other object"}
"""Types of objects that are not printed, or not as parts of the model, and what they are called."""

_BAMBU, _PRUSA = "Metadata/model_settings.config", "Metadata/Slic3r_PE_model.config"
"""The files in which slicers say what the parts of objects are."""

_NEGATIVE = "negative part"

_KINDS = (
    (("modifier_part", "parametermodifier", "infill_mesh", "cutting_mesh"), "modifier"),
    (("support_blocker", "supportblocker", "anti_overhang_mesh"), "support blocker"),
    (("support_enforcer", "supportenforcer"), "support enforcer"),
    (("negative_part", "negativevolume"), _NEGATIVE),
    (("support_mesh",), "support"),
)
"""What slicers call parts that do not belong to the shape, in small letters, and what notes call them."""


def _kind_of(word: str) -> str:
    """Return what a part is by the word of a slicer; empty for parts of the shape."""
    return next((kind for words, kind in _KINDS if word.lower() in words), "")


class _Reference(NamedTuple):
    """A placed object, of another part of the package where `path` is not empty."""

    path: str
    object_id: str
    matrix: Floats
    line: int


@dataclass
class _Object:
    """An object: triangles, or components that place others.

    setting  what a slicer has it for, where it does not belong to the shape
    """

    kind: str
    line: int
    points: list[tuple[float, float, float]] = field(default_factory=list)
    triangles: list[tuple[int, int, int]] = field(default_factory=list)
    materials: list[tuple[str | None, ...]] = field(default_factory=list)
    components: list[_Reference] = field(default_factory=list)
    lattices: int = 0
    setting: str = ""
    polygons: Polygons | None = None


@dataclass
class _ModelPart:
    """A model part of a package: its objects by their ids, and the items of its build."""

    unit: str = "millimeter"
    objects: dict[str, _Object] = field(default_factory=dict)
    items: list[_Reference] = field(default_factory=list)


def read_threemf(content: bytes) -> FileSurface:
    """Read the objects of a package's build as one surface, in the units of the package.

    Edges between objects, and between the materials of each, are creases. Raises MeshError, with part and
    line, for a package that contradicts itself, needs an extension that is not read, or unpacks to too much.
    """
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        package = _Package(archive)
        root = package.root()
        part = package.part(root)
        for item in part.items:
            package.add(item, root, np.eye(4), 0)
    if not package.placed.parts:
        raise MeshError("; ".join(["its build has no triangles", *package.notes()]) + ". Export it again.")
    return joined(package.placed.parts, package.notes())._replace(unit=_UNITS[part.unit])


def _files(path: Path) -> SourceFiles:
    """Return the one file of a model. A reader once took all parts of those with settings of a slicer."""
    found = one_file(lambda path, digest: "z")(path)
    with suppress(OSError, ValueError, zipfile.BadZipFile), zipfile.ZipFile(path) as archive:
        if any(name in (_BAMBU, _PRUSA) or name.startswith("Cura/") for name in archive.namelist()):
            return SourceFiles.of(found.files, found.up, ["parts of slicers"])
    return found


THREEMF = SurfaceReader.of_content(read_threemf, _files, states_up=True)


@dataclass
class _Package:
    """Collects the triangles of a package."""

    archive: zipfile.ZipFile
    placed: PlacedMeshes = field(default_factory=PlacedMeshes)
    _parts: dict[str, _ModelPart] = field(default_factory=dict)
    _visited: int = 0

    @cached_property
    def settings(self) -> dict[tuple[str, str], str]:
        """What the components of objects are that do not belong to the shape, by the ids of both."""
        return {
            (item.attributes.get("id", ""), part.attributes.get("id", "")): kind
            for item in self._settings_of(_BAMBU)
            for part in item.all("part")
            if (kind := _kind_of(part.attributes.get("subtype", "")))
        }

    @cached_property
    def volumes(self) -> dict[str, list[tuple[int, int, str]]]:
        """First and last triangle of what does not belong to the shape, and what it is, by object."""
        found: dict[str, list[tuple[int, int, str]]] = {}
        for item in self._settings_of(_PRUSA):
            for volume in item.all("volume"):
                given = [each.attributes for each in volume.all("metadata")]
                pairs = {each.get("key", ""): each.get("value", "") for each in given}
                old = "modifier_part" if pairs.get("modifier") == "1" else ""
                if kind := _kind_of(pairs.get("volume_type", old)):
                    first, last = (int(volume.attributes.get(name, -1)) for name in ("firstid", "lastid"))
                    found.setdefault(item.attributes.get("id", ""), []).append((first, last, kind))
        return found

    def _settings_of(self, name: str) -> list[Element]:
        """Return the objects of a file of settings; none where the package does not have it."""
        if name not in self.archive.namelist():
            return []
        return list(parse_elements(self._read(name)).all("object"))

    def root(self) -> str:
        """Return the name of the part that the package begins with."""
        for relation in parse_elements(self._read("_rels/.rels")).all("Relationship"):
            if relation.attributes.get("Type", "").endswith("/3dmodel"):
                return _part_name(relation.attributes.get("Target", ""))
        raise MeshError("its _rels/.rels names no 3D model")

    def part(self, name: str) -> _ModelPart:
        """Return a model part of the package, which is parsed once."""
        if name not in self._parts:
            self._parts[name] = _parsed_part(name, self._read(name))
        return self._parts[name]

    def _read(self, name: str) -> bytes:
        """Return the content of a part. Raises MeshError where it is missing or too large."""
        parts = {i.filename.replace("\\", "/").lower(): i for i in reversed(self.archive.infolist())}
        info = parts.get(name.lower())
        if info is None or not name.isprintable():
            raise MeshError(f"it has no part {quote(name)}. Export the model again.")
        if info.file_size > min(MOST_BYTES, max(_SMALL, _MOST_PACKED * info.compress_size)):
            raise MeshError(
                f"its part {quote(name)} unpacks from {info.compress_size:,} bytes to "
                f"{info.file_size:,}, which no model file does"
            )
        with self.archive.open(info) as file:
            return file.read(info.file_size)

    def add(self, reference: _Reference, within: str, parent: Floats, depth: int) -> None:
        """Add an object, and the components below it; `within` is the part that refers to it.

        parent  matrix (4, 4) of row vectors that places what refers to it
        """
        name = _part_name(reference.path) or within
        place = f"{within}, line {reference.line}"
        self._visited += 1
        if depth > _DEEPEST or self._visited > MOST_OBJECTS:
            raise MeshError(f"{place}: over {MOST_OBJECTS} objects with components, or over {_DEEPEST} deep")
        part, root = self.part(name), next(iter(self._parts.values()))
        if part.unit != root.unit:
            raise MeshError(f"{name}: its unit is {part.unit}, and that of the package {root.unit}")
        found = part.objects.get(reference.object_id)
        if found is None:
            raise MeshError(f"{place}: {name} has no object {quote(reference.object_id)}")
        if kind := found.setting or _LEFT_OUT.get(found.kind):
            self.placed.left_out[kind] += 1
            return
        self.placed.left_out["beam lattice"] += found.lattices
        if found.polygons is None and not found.components and not found.lattices:
            self.placed.left_out["object without triangles"] += 1
        matrix = reference.matrix @ parent
        if found.polygons is not None:
            self.placed.add(self._without_volumes(found.polygons, reference.object_id), matrix)
        for component in found.components:
            kind = self.settings.get((reference.object_id, component.object_id))
            if kind:
                self.placed.left_out[kind] += 1
            else:
                self.add(component, name, matrix, depth + 1)

    def _without_volumes(self, polygons: Polygons, object_id: str) -> Polygons:
        """Return the triangles of an object without those that do not belong to the shape."""
        dropped = np.zeros(len(polygons.sides), bool)
        for first, last, kind in self.volumes.get(object_id, []):
            dropped[max(first, 0) : max(last + 1, 0)] = True
            self.placed.left_out[kind] += 1
        return polygons.without(dropped) if dropped.any() else polygons

    def notes(self) -> list[str]:
        """Return lines about what was not read as other programs show it."""
        words = self.placed.left_out_words
        notes = [f"left out, as only the triangles of models are read: {words}"] if words else []
        if self.placed.left_out[_NEGATIVE]:
            notes.append("negative parts are not subtracted; subtract them in the program that made the file")
        return notes


def _part_name(path: str) -> str:
    return unquote(path).lstrip("/")


def _parsed_part(name: str, content: bytes) -> _ModelPart:
    """Return a model part. Raises MeshError with part and line."""
    part = _ModelPart()
    current, core, setting = _Object("", 0), "", ""

    def text(value: str) -> None:
        if value.strip().lower() in ("true", "1"):
            current.setting = current.setting or _kind_of(setting)

    def read(tag: str, given: dict[str, str]) -> None:
        nonlocal current, core, setting
        word = local_name(tag)
        if word == "model":
            core = tag.removesuffix("model")
        elif word in ("metadata", "setting"):  # of an object of Cura
            setting, parser.CharacterDataHandler = local_name(given.get("name", given.get("key", ""))), text
        elif word == "beamlattice":
            current.lattices += 1
        match tag.removeprefix(core):  # slices of extensions have vertices too
            case "vertex":
                current.points.append((float(given["x"]), float(given["y"]), float(given["z"])))
            case "triangle":
                current.triangles.append((int(given["v1"]), int(given["v2"]), int(given["v3"])))
                current.materials.append((given.get("pid"), *_uniform(given)))
            case "object":
                current = part.objects[given["id"]] = _Object(
                    given.get("type", "model"), parser.CurrentLineNumber
                )
            case "component":
                current.components.append(_reference(given, parser.CurrentLineNumber))
            case "item":
                part.items.append(_reference(given, parser.CurrentLineNumber))
            case "model":
                part.unit = given.get("unit", part.unit)
                _require_known(part.unit, given)

    def start(tag: str, given: dict[str, str]) -> None:
        try:
            read(tag, given)
        except (KeyError, MeshError, ValueError) as error:
            fault = str(error) if isinstance(error, MeshError) else shorten(error)
            if isinstance(error, KeyError):
                fault = f"{shorten(tag)} has no {error.args[0]}"
            raise MeshError(f"{name}, line {parser.CurrentLineNumber}: {fault}") from None

    def end(tag: str) -> None:
        parser.CharacterDataHandler = None
        if tag == f"{core}object":
            current.polygons = _polygons(current, name)
            current.points, current.triangles, current.materials = [], [], []

    parser = limited_parser(start, end)
    parser.Parse(content, True)
    return part


def _require_known(unit: str, given: dict[str, str]) -> None:
    """Raise MeshError for an unknown unit, and for extensions that decide the shape."""
    if unit not in _UNITS:
        raise MeshError(f"its unit {quote(unit)} is not one of {', '.join(_UNITS)}")
    for prefix in given.get("requiredextensions", "").split():
        space = given.get(f"xmlns:{prefix}", prefix)
        if not any(known in space for known in _HARMLESS):
            name = space.rpartition("/3dmanufacturing/")[2]
            raise MeshError(f"it requires the extension {quote(name)}, which is not read")


def _reference(given: dict[str, str], line: int) -> _Reference:
    """Return the object that a component or item places. Raises KeyError or ValueError."""
    matrix = np.eye(4)
    words = given.get("transform", "").split()
    if words:
        if len(words) != 12:
            raise ValueError(f"its transform has {len(words)} numbers, not 12")
        matrix[:, :3] = np.array(list(map(float, words))).reshape(4, 3)
    path = next((value for key, value in given.items() if local_name(key) == "path"), "")
    return _Reference(path, given["objectid"], matrix, line)


def _uniform(given: dict[str, str]) -> tuple[str | None]:
    """Return the property of a triangle where its three corners have the same."""
    first = given.get("p1")
    same = given.get("p2", first) == first == given.get("p3", first)
    return (first if same else None,)


def _polygons(found: _Object, part: str) -> Polygons | None:
    """Return the triangles of an object; None where it has none. Raises MeshError for missing vertices."""
    if not found.triangles:
        return None
    corners = np.array(found.triangles, np.int64).reshape(-1)
    sides = np.full(len(found.triangles), 3)
    require_vertices(corners, sides, len(found.points), f"{part}, line {found.line}")
    numbers: dict[tuple[str | None, ...], int] = {}
    groups = np.array([numbers.setdefault(key, len(numbers)) for key in found.materials], np.int64)
    return Polygons(np.array(found.points, np.float64), sides, corners, groups=groups)
