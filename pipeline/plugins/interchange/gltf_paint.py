"""Texture coordinates, vertex colours and materials of glTF 2.0 files: metalness and roughness (Khronos).

Arrays are read in a process of its own, as those of the surface are. Pictures within a file are written to
the user's cache, by their contents, from where they are read as others.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from flowsculpt import MeshError
from flowsculpt.api import shorten
from flowsculpt.api.files import InputFile, Parser
from flowsculpt.api.materials import Texture
from flowsculpt.api.meshes import Floats, ModelMaterials, PaintReader
from flowsculpt.pipeline.plugins.interchange.gltf_document import MOST_BYTES, GltfDocument, JsonObject
from flowsculpt.pipeline.plugins.interchange.gltf_files import (
    SceneArrays,
    Triangles,
    files_of_buffers,
    placed,
)
from flowsculpt.pipeline.plugins.interchange.gltf_scene import DefaultScene, PlacedPrimitive
from flowsculpt.pipeline.plugins.interchange.model_paint import ModelPaint, PaintParts
from flowsculpt.pipeline.plugins.interchange.painted_materials import (
    GREY,
    FileMaterial,
    alpha_of,
    opacity_of,
    painted,
    picture,
    picture_within,
)
from flowsculpt.pipeline.plugins.interchange.scene_readers import packed_arrays

_TRANSFORM = "KHR_texture_transform"
_GLOSSINESS = "KHR_materials_pbrSpecularGlossiness"
_UNLIT = "KHR_materials_unlit"

_PICTURES = ("EXT_texture_webp", "MSFT_texture_dds")
"""Extensions that name pictures of textures in other formats which are read."""

_WRAPS = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
"""What is shown beyond the sides of a picture, by the numbers of glTF."""

_SHOWN = ("_ior", "_specular", "_volume", "_dispersion", "_emissive_strength")
"""Ends of extensions of materials that change little, or only what another one brings."""

_DARKEST_MIRROR = 0.1
"""Specular colours up to this are taken for that of a dielectric."""


class PaintedScene(DefaultScene):
    """The default scene of a document, with what its parts have on their faces."""

    @classmethod
    def read(cls, path: Path) -> PaintedScene:
        """Read a file. Raises MeshError for glTF 1.0, else as `GltfDocument.read` and `DefaultScene.of`."""
        document = GltfDocument.read(path)
        if "rewritten" in document.root.entry("asset"):
            raise MeshError(
                "it is glTF 1.0, whose paint is not read. Export it as glTF 2.0, or write paint: off."
            )
        scene = cls.of(document)
        assert isinstance(scene, PaintedScene)
        return scene

    def _accessors_of(self, part: PlacedPrimitive, draco: JsonObject | None) -> Iterator[object]:
        yield from super()._accessors_of(part, draco)
        packed = draco.entry("attributes") if draco is not None else JsonObject({}, "")
        attributes = part.primitive.entry("attributes").values
        for name in (self.coordinates_of(part)[0], "COLOR_0"):
            if name in attributes and name not in packed:
                yield attributes[name]

    def material_of(self, part: PlacedPrimitive) -> tuple[int, JsonObject]:
        """Return the material of a part and its number, which is that after the last for the default one."""
        number = part.primitive.values.get("material")
        if number is None:
            return len(self.document.root.items("materials")), JsonObject({}, "the default material")
        return number, self.document.item("materials", number, part.place)

    def coordinates_of(self, part: PlacedPrimitive) -> tuple[str, JsonObject]:
        """Return the name of the texture coordinates of a part, and how they are transformed.

        Raises MeshError where the textures of its material have different ones.
        """
        _, material = self.material_of(part)
        found = [_coordinates_of(texture) for texture in _textures_of(material)]
        if any((name, by.values) != (found[0][0], found[0][1].values) for name, by in found):
            raise MeshError(
                f"the textures of {material.place} have different texture coordinates, and one set is read. "
                "Export it with one, or write paint: off."
            )
        return found[0] if found else ("TEXCOORD_0", JsonObject({}, material.place))


def _coordinates_of(texture: JsonObject) -> tuple[str, JsonObject]:
    """Return the name of the coordinates of a texture, and the extension that transforms them."""
    transform = texture.extension(_TRANSFORM) or JsonObject({}, texture.place)
    index = transform.whole("texCoord", texture.whole("texCoord", 0))
    return f"TEXCOORD_{index}", transform


def _textures_of(material: JsonObject) -> Iterator[JsonObject]:
    """Yield the textures of a material that are shown, the colour's first."""
    surface = _surface_of(material)
    for name in ("baseColorTexture", "metallicRoughnessTexture"):
        if name in surface:
            yield surface.entry(name)
    if "normalTexture" in material:
        yield material.entry("normalTexture")


class PaintArrays(SceneArrays):
    """Reads what the parts of a scene have on their faces."""

    def paint(self) -> dict[str, np.ndarray]:
        """Return the arguments of `ModelPaint.of`. Raises ValueError."""
        scene = self.scene
        assert isinstance(scene, PaintedScene)
        found, plain = PaintParts(), dict[int, list[float]]()
        for part in scene.parts:
            own = self._own(part)
            shown = placed(own, self._matrices(part))
            faces = shown.faces % max(len(own.points), 1)
            number, material = scene.material_of(part)
            name, transform = scene.coordinates_of(part)
            coordinates = _transformed(self._values(part, name, own, 2), transform)[faces].reshape(-1, 2)
            plain[number], colours = _factor(material)[:3], None
            if "COLOR_0" in part.primitive.entry("attributes"):
                values = self._values(part, "COLOR_0", own, 3)
                if values.shape[1] > 3 and (values[:, 3] < 1.0).any() and _is_cut_out(material):
                    raise MeshError(
                        f"{material.place} has vertex colours with alpha, COLOR_0, which is not read. Export "
                        "it with a texture, or write paint: off."
                    )
                colours = np.clip(values[:, :3] * plain[number], 0.0, 1.0)[faces].reshape(-1, 3)
            sides, materials = np.full(len(faces), 3), np.full(len(faces), number)
            found.add(shown.points, sides, shown.faces.reshape(-1), coordinates, materials, colours)
        black = [0.0, 0.0, 0.0]  # of materials that no part has
        return found.arrays(lambda: np.array([plain.get(number, black) for number in range(max(plain) + 1)]))

    def _values(self, part: PlacedPrimitive, name: str, own: Triangles, size: int) -> Floats:
        """Return an attribute (V, k) of the points of a part; zeros where it has none."""
        attributes = part.primitive.entry("attributes").values
        if name not in attributes:
            return np.zeros((len(own.points), size))
        accessor = self.document.item("accessors", attributes[name], part.place)
        if self.scene.draco_of(part) is not None:
            raise ValueError(f"{part.place} has its {name} as Draco data, and paint is not read from that")
        values = self._numbers(attributes[name], part.place, accessor.text("type", "VEC2"))
        if len(values) != len(own.points) or values.shape[1] < size:
            raise ValueError(
                f"{name} of {part.place} has {len(values)} values for {len(own.points)} vertices"
            )
        return values


def _transformed(coordinates: Floats, transform: JsonObject) -> Floats:
    """Return texture coordinates (V, 2) upwards, as KHR_texture_transform moves them; glTF's go down."""
    if transform.values:
        scale, offset = transform.numbers("scale") or [1.0, 1.0], transform.numbers("offset") or [0.0, 0.0]
        angle = transform.number("rotation", 0.0)
        c, s = math.cos(angle), math.sin(angle)
        coordinates = coordinates[:, :2] * scale @ np.array([[c, -s], [s, c]]) + offset
    return coordinates[:, :2] * (1.0, -1.0) + (0.0, 1.0)


def _surface_of(material: JsonObject) -> JsonObject:
    """Return the metalness and roughness of a material, as glTF 2.0 names their numbers and textures.

    Of a material of specular colour and gloss they are those of its diffuse part.
    """
    surface, glossy = material.entry("pbrMetallicRoughness"), material.extension(_GLOSSINESS)
    if glossy is not None:
        gloss = min(max(glossy.number("glossinessFactor", 1.0), 0.0), 1.0)
        names = {"diffuseFactor": "baseColorFactor", "diffuseTexture": "baseColorTexture"}
        held = {new: glossy.values[name] for name, new in names.items() if name in glossy}
        values = {**held, "metallicFactor": 0.0, "roughnessFactor": 1.0 - gloss}
        return JsonObject(values, glossy.place)
    if material.extension(_UNLIT) is not None:
        shown = {name: surface.values[name] for name in surface.values if name.startswith("baseColor")}
        return JsonObject({**shown, "metallicFactor": 0.0}, surface.place)
    return surface


def _notes(material: JsonObject) -> Iterator[str]:
    """Yield lines about what a material has that is not shown."""
    place, there = shorten(material.values.get("name") or material.place), material.entry("extensions")
    for name in there.values:
        if not name.endswith(_SHOWN) and _changes(there.entry(name), name):
            what = f"the specular colour of {name}" if name == _GLOSSINESS else shorten(name)
            yield f"material {place}: {what} is not shown"
    if any(material.numbers("emissiveFactor")):
        yield f"material {place}: its glow is not shown"


def _changes(extension: JsonObject, name: str) -> bool:
    """Tell whether an extension of a material changes what other programs show."""
    if name == _GLOSSINESS:
        specular = extension.numbers("specularFactor", 3) if "specularFactor" in extension else [1.0] * 3
        return "specularGlossinessTexture" in extension or max(specular) > _DARKEST_MIRROR
    factors = [value for key, value in extension.values.items() if key.endswith(("Factor", "Strength"))]
    return not factors or any(value not in (0, [0, 0, 0]) for value in factors)


def _factor(material: JsonObject) -> list[float]:
    """Return the base colour of a material, red, green, blue and alpha, linear."""
    surface, name = _surface_of(material), "baseColorFactor"
    return [min(max(part, 0.0), 1.0) for part in surface.numbers(name, 4)] if name in surface else [1.0] * 4


def _is_cut_out(material: JsonObject) -> bool:
    """Tell whether the alpha of a material shows."""
    return material.values.get("alphaMode", "OPAQUE") in ("MASK", "BLEND")


def _files(path: Path) -> Mapping[Path, str]:
    return {file: InputFile(file).digest() for file in files_of_buffers(PaintedScene.read(path))}


def _materials(path: Path) -> ModelMaterials:
    """Return the materials of a file by number, with the default one last.

    Raises MissingInputError where one is not there, MeshError for a picture that is not read.
    """
    scene, files, notes = PaintedScene.read(path), dict[Path, str](), dict[str, None]()
    count = len(scene.document.root.items("materials")) + 1
    found: list[FileMaterial] = [painted(GREY, None)] * count
    for part in scene.parts:
        number, material = scene.material_of(part)
        attributes, (name, _) = part.primitive.entry("attributes"), scene.coordinates_of(part)
        found[number] = _material(scene.document, material, files, "COLOR_0" in attributes)
        notes |= dict.fromkeys(_notes(material))
        if name not in attributes and any(_textures_of(material)):
            notes[f"{part.place} has no {name}, so its textures show as one colour"] = None
    is_default_used = any("material" not in part.primitive for part in scene.parts)
    return ModelMaterials(tuple(found if is_default_used else found[:-1]), files, tuple(notes))


def _material(
    document: GltfDocument, material: JsonObject, files: dict[Path, str], has_colours: bool
) -> FileMaterial:
    """Return a material. Raises MeshError where vertex colours and a texture are to be multiplied."""
    surface, texture_of = _surface_of(material), partial(_texture, document, files=files)
    red, green, blue, alpha = _factor(material)
    metallic, roughness = (
        min(max(surface.number(f"{name}Factor", 1.0), 0.0), 1.0) for name in ("metallic", "roughness")
    )
    colour = texture_of(surface.entry("baseColorTexture")) if "baseColorTexture" in surface else None
    if colour is not None:
        colour = replace(colour, factor=(red, green, blue))
    more: dict[str, Any] = {}
    if _is_cut_out(material):
        is_mask = material.values["alphaMode"] == "MASK"
        cutoff = material.number("alphaCutoff", 0.5) if is_mask else None
        more["opacity"] = opacity_of(alpha, None if colour is None else alpha_of(colour), cutoff)
    if "metallicRoughnessTexture" in surface:
        both = texture_of(surface.entry("metallicRoughnessTexture"), space="data")
        more["roughness_texture"] = replace(both, factor=(1.0, roughness, 1.0), channel=1)
        more["metallic_texture"] = replace(both, factor=(1.0, 1.0, metallic), channel=2)
    if "normalTexture" in material:
        normals = material.entry("normalTexture")
        scale = normals.number("scale", 1.0)
        more["normal_texture"] = replace(texture_of(normals, space="data"), factor=(scale, scale, 1.0))
    if colour is not None and has_colours:
        raise MeshError(
            f"{material.place} has a texture to be multiplied by the colours of its vertices, COLOR_0, "
            "which is not read. Export it without vertex colours, or write paint: off."
        )
    return painted((red, green, blue), colour, roughness, metallic, has_colours, **more)


def _texture(
    document: GltfDocument, texture: JsonObject, files: dict[Path, str], space: str = "srgb"
) -> Texture:
    """Return a texture, and note its file where it has one of its own."""
    entry = document.item("textures", texture.values.get("index"), texture.place)
    wrap = _wrap_of(document, entry)
    image = document.item("images", _source_of(entry), entry.place)
    address = image.values.get("uri")
    if isinstance(address, str) and not address.startswith("data:"):
        return replace(picture(document.path, unquote(address), files, space), wrap=wrap)
    content = document.embedded_content(image) if address else _content_of_view(document, image, files)
    digest = hashlib.sha256(content).hexdigest()
    suffix = next((suffix for start, suffix in _SUFFIXES.items() if content.startswith(start)), ".png")
    name = f"{image.place}{suffix}"
    return replace(picture_within(document.path, name, digest, lambda: content, space), wrap=wrap)


_SUFFIXES = {b"\xff\xd8": ".jpg", b"RIFF": ".webp", b"DDS ": ".dds"}
"""Suffixes of pictures by their beginning."""


def _source_of(texture: JsonObject) -> object:
    """Return the picture of a texture: the plain one, else the first of an extension that is read.

    Raises MeshError, with the extension, where there is none.
    """
    if "source" in texture:
        return texture.values["source"]
    if (other := texture.extension(*_PICTURES)) is not None:
        return other.values.get("source")
    named = shorten(", ".join(texture.entry("extensions").values))
    fact = f"its picture only by the extension {named}, which is not read" if named else "no picture"
    raise MeshError(f"{texture.place} has {fact}. Export it with PNG or JPEG, or write paint: off.")


def _wrap_of(document: GltfDocument, texture: JsonObject) -> tuple[str, str]:
    if "sampler" not in texture:
        return ("repeat", "repeat")
    sampler = document.item("samplers", texture.values["sampler"], texture.place)
    across, up = (_WRAPS.get(sampler.whole(name, 10497), "repeat") for name in ("wrapS", "wrapT"))
    return across, up


def _content_of_view(document: GltfDocument, image: JsonObject, files: dict[Path, str]) -> bytes:
    view = document.item("bufferViews", image.values.get("bufferView"), image.place)
    number = view.whole("buffer")
    file = document.buffer_file(number)
    if file is not None:
        files[file] = InputFile(file).digest()
    start = view.whole("byteOffset", 0)
    return document.buffer(number)[start : start + view.whole("byteLength")]


def _read(path: Path) -> ModelPaint:
    PaintedScene.read(path)  # raises in this process what users can mend
    return ModelPaint.unpacked(Parser("flowsculpt.pipeline.plugins.interchange.gltf_paint").answer(path))


GLTF_PAINT = PaintReader(_materials, _read, _files)


def _answer(path: str) -> bytes:
    """Return the arrays of a file's paint."""
    scene = PaintedScene.read(Path(path))
    files = (Path(path), *files_of_buffers(scene))
    Parser.allow_memory(Parser.MEMORY + 40 * sum(InputFile(file, MOST_BYTES).size() for file in files))
    return packed_arrays(PaintArrays(scene).paint())


if __name__ == "__main__":
    Parser.serve(_answer)
