"""Texture coordinates, vertex colours and materials of FBX files, which ufbx reads in a process of its own.

ufbx states the materials of every program as metalness and roughness; `fbx_files` says how it is called.
Colours of materials are linear, as Blender and Maya write them, and those of vertices sRGB, as Blender does.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flowsculpt import MeshError
from flowsculpt.api import quote, shorten
from flowsculpt.api.files import InputFile, Parser
from flowsculpt.api.materials import Opacity, Texture, linear_of_srgb
from flowsculpt.api.meshes import Floats, ModelMaterials, PaintReader
from flowsculpt.pipeline.plugins.interchange.fbx_files import (
    MOST_BYTES,
    counted,
    faces_of,
    loaded_scene,
    numbers_of,
    require_ufbx,
    shown_meshes,
    uncollected,
)
from flowsculpt.pipeline.plugins.interchange.model_paint import ModelPaint, PaintParts
from flowsculpt.pipeline.plugins.interchange.painted_materials import (
    GREY,
    FileMaterial,
    mask_of,
    opacity_of,
    painted,
    picture,
    picture_within,
)
from flowsculpt.pipeline.plugins.interchange.scene_readers import (
    PlacedMeshes,
    Polygons,
    answered,
    asked,
    content_of,
    packed_arrays,
)

if TYPE_CHECKING:
    import ufbx

_MODULE = "flowsculpt.pipeline.plugins.interchange.fbx_paint"
MATERIALS = "materials 5"
"""The question for materials, with the version of the answers, which are stored by it."""

_SHOWN = {
    "base_color": "colour",
    "roughness": "roughness",
    "metalness": "metalness",
    "opacity": "opacity",
    "normal_map": "normals",
}
"""The parts of a material that are shown: their names in ufbx, and in messages."""

_UNKNOWN, _SPECULAR_GLOSSINESS = 0, 7
"""Kinds of materials by ufbx's ShaderType: those of other programs, and one without metalness."""

_MAX_COLOUR = "3dsMax|main|basecolor"
"""The colour of a PBR material of 3ds Max, whose name ufbx does not have."""

_FILE = 0  # by ufbx's TextureType
_WRAPS = ("repeat", "clamp")
"""What is shown beyond the sides of a picture, by ufbx's WrapMode."""

_NO_INDEX = 0xFFFFFFFF
_FIRST_SET = ("", "default")
"""Names of texture coordinates that stand for the first."""


def _materials(path: Path) -> ModelMaterials:
    """Return the materials of a file in the order of its paint, and the files of their pictures.

    Raises MissingInputError where one is not there, MeshError for what is not read.
    """
    require_ufbx()
    answer = Parser(_MODULE).answer_about_content(path, InputFile(path).digest(), "ufbx", MATERIALS)
    files: dict[Path, str] = {}
    found = json.loads(content_of(answer.encode(), path))
    notes = (f"material {shorten(facts['name'])}: its glow is not shown" for facts in found if facts["glows"])
    return ModelMaterials(tuple(_material(path, facts, files) for facts in found), files, tuple(notes))


def _material(path: Path, facts: dict[str, Any], files: dict[Path, str]) -> FileMaterial:
    """Return the material of what `_facts_of` found; note the files of its pictures."""
    textures = {}
    for name, found in facts["pictures"].items():
        texture = _texture(path, found, files, None if name == "base_color" else "data")
        textures[name] = replace(texture, wrap=(found["wrap"][0], found["wrap"][1]))
    colour, mask = textures.pop("base_color", None), textures.pop("opacity", None)
    named: dict[str, Any] = {"opacity": _opacity(facts, mask)}
    if colour is not None:
        colour = replace(colour, factor=(facts["factor"],) * 3)
    if (normals := textures.get("normal_map")) is not None:
        textures["normal_map"] = replace(normals, factor=(facts["bump"], facts["bump"], 1.0))
    more = {
        "roughness": "roughness_texture",
        "metalness": "metallic_texture",
        "normal_map": "normal_texture",
    }
    named |= {more[name]: texture for name, texture in textures.items()}
    return painted(
        tuple(facts["colour"]),
        colour,
        facts["roughness"],
        facts["metalness"],
        facts["has_colours"],
        **named,
    )


def _opacity(facts: dict[str, Any], texture: Texture | None) -> Opacity | None:
    """Return the opacity of a material. Raises MeshError for a picture that programs read in two ways."""
    if texture is None:
        return opacity_of(facts["opacity"])
    mask = mask_of(texture)
    if mask is texture and not facts["is_mask"]:
        raise MeshError(
            f"the material {shorten(facts['name'])} has a picture of transparency without alpha, which some "
            "programs read as opacity. Write it as the alpha of the colour, or write paint: off."
        )
    return opacity_of(1.0, mask)


def _texture(path: Path, found: dict[str, Any], files: dict[Path, str], space: str | None) -> Texture:
    """Return the picture within a file, or the one that it names."""
    relative, absolute = found["names"]
    if found["digest"]:
        digest = found["digest"]
        return picture_within(path, relative, digest, lambda: asked(_MODULE, path, digest), space)
    is_there = Path(absolute).is_file() and not (path.parent / relative.replace("\\", "/")).is_file()
    return picture(path, absolute if is_there else relative, files, space)


def _read(path: Path) -> ModelPaint:
    require_ufbx()
    return ModelPaint.unpacked(asked(_MODULE, path, "paint"))


FBX_PAINT = PaintReader(_materials, _read)


def answer(path: str, question: str) -> bytes:
    """Return the answer to `paint`, to the question for materials, or the picture with a SHA-256."""
    Parser.allow_memory(Parser.MEMORY + 40 * InputFile(Path(path), MOST_BYTES).size())
    content = InputFile(Path(path), MOST_BYTES).content()
    if question == "paint":
        return answered(lambda: _packed_paint(content))
    if question == MATERIALS:
        return answered(lambda: json.dumps(_material_facts(content)).encode())
    return answered(lambda: _picture_within(content, question))


@uncollected()
def _packed_paint(content: bytes) -> bytes:
    return packed_arrays(_PaintedScene.of(loaded_scene(content)).arrays())


@uncollected()
def _material_facts(content: bytes) -> list[dict[str, Any]]:
    """Return the facts about each material of a file, by number. Raises MeshError for what is not read."""
    scene = _PaintedScene.of(loaded_scene(content, ignore_embedded=False))
    found = {"has_colours": scene.parts.has_colours}
    return [_facts_of(material) | found for material in scene.materials]


@uncollected()
def _picture_within(content: bytes, digest: str) -> bytes:
    scene = loaded_scene(content, ignore_embedded=False)
    pictures = (_content_of(counted(texture)) for texture in scene.textures)
    return next(found for found in pictures if hashlib.sha256(found).hexdigest() == digest)


@dataclass
class _PaintedScene:
    """The visible meshes of a scene, and the materials that their faces have, None for faces without one."""

    parts: PaintParts
    materials: list[ufbx.Material | None]

    @classmethod
    def of(cls, scene: ufbx.Scene) -> _PaintedScene:
        """Read the paint of a scene. Raises MeshError, with the mesh or material, for what is not read."""
        found, placed = cls(PaintParts(), []), PlacedMeshes()
        numbers: dict[int, int] = {}
        for node, mesh, matrix in shown_meshes(scene, Counter()):
            name = quote(node.name or mesh.name)
            points, sides, corners = faces_of(mesh, name)
            listed = [counted(material) for material in node.materials or mesh.materials]
            own = numbers_of(mesh.face_material, np.uint32).astype(np.int64)
            own = np.minimum(own if len(own) == len(sides) else np.zeros(len(sides), np.int64), len(listed))
            holes = numbers_of(mesh.face_hole, np.bool_)
            dropped = (sides < 3) | (holes if len(holes) == len(sides) else False)
            placed.add(Polygons(points, sides, np.arange(len(corners))).without(dropped), matrix)
            polygons, own = placed.parts[-1], own[~dropped]
            order = polygons.corners  # a mirror turns faces over
            materials, coordinates = np.empty_like(own), np.zeros((len(order), 2))
            for place in np.unique(own).tolist():
                material = listed[place] if place < len(listed) else None
                number = numbers.setdefault(-1 if material is None else material.element_id, len(numbers))
                if number == len(found.materials):
                    found.materials.append(material)
                materials[own == place] = number
                at = np.repeat(own == place, polygons.sides)
                coordinates[at] = _coordinates(mesh, material, order[at], name)
            colours = _colours(mesh, order, name)
            arrays = polygons.sides, corners[order], coordinates, materials, colours
            found.parts.add(polygons.points, *arrays)
        return found

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the arguments of `ModelPaint.of`."""
        return self.parts.arrays(lambda: np.array([_facts_of(each)["colour"] for each in self.materials]))


def _colours(mesh: ufbx.Mesh, corners: np.ndarray, name: str) -> Floats | None:
    """Return the linear colours (K, 3) of corners of a mesh from its first set; None where it has none."""
    given = counted(mesh.vertex_color)
    if not given.exists:
        return None
    return linear_of_srgb(np.clip(_values(given, 4, corners, f"{name}: its vertex colours")[:, :3], 0.0, 1.0))


def _coordinates(mesh: ufbx.Mesh, material: ufbx.Material | None, corners: np.ndarray, name: str) -> Floats:
    """Return the coordinates (K, 2) of corners of a mesh in the pictures of a material."""
    sets = [counted(given) for given in mesh.uv_sets]
    if not sets:
        return np.zeros((len(corners), 2))
    names = [given.name for given in sets]
    wanted = {texture.uv_set for texture in _pictures_of(material).values()} if material else set()
    unknown = wanted - {*names, *_FIRST_SET}
    if unknown and len(sets) > 1:
        raise MeshError(
            f"{name} does not have the texture coordinates {shorten(min(unknown))} that its material "
            "names. Export it with them, or write paint: off."
        )
    used = {names.index(word) if word in names else 0 for word in wanted} or {0}
    if len(used) > 1:
        raise MeshError(
            f"{name} has a material whose textures have different texture coordinates, and one set is read. "
            "Export it with one, or write paint: off."
        )
    given = counted(sets[used.pop()].vertex_uv)
    return _values(given, 2, corners, f"{name}: its texture coordinates", otherwise=0.0)


def _values(
    given: Any, columns: int, corners: np.ndarray, place: str, otherwise: float | None = None
) -> Floats:
    """Return the values (K, columns) of an attribute at corners; `otherwise` where a corner has none."""
    values, index = numbers_of(given.values, np.float64, columns), numbers_of(given.indices, np.uint32)
    if len(index) <= corners.max(initial=-1):
        raise MeshError(f"{place} do not fit its corners")
    index = index[corners].astype(np.int64)
    if otherwise is not None:
        index[index == _NO_INDEX] = len(values)
        values = np.concatenate([values, np.full((1, columns), otherwise)])
    if index.max(initial=-1) >= len(values) or not np.isfinite(values[index]).all():
        raise MeshError(f"{place} do not fit its corners")
    return values[index]


def _pictures_of(material: ufbx.Material) -> dict[str, ufbx.Texture]:
    """Return the textures of a material that are shown, by ufbx's names of its inputs.

    Raises MeshError for those that are made of several pictures, or moved.
    """
    maps, found = counted(material.pbr), {}
    for name, word in _SHOWN.items():  # only `NormalMap` is sure to hold normals, not heights
        given = counted(getattr(counted(material.fbx) if name == "normal_map" else maps, name))
        if name == "opacity" and counted(given.texture) is None:
            given = counted(counted(material.fbx).transparency_color)
        texture = counted(given.texture)
        if texture is None or not given.texture_enabled:
            continue
        place = f"the {word} of the material {shorten(material.name)}"
        if int(texture.type) != _FILE or not texture.has_file:
            raise MeshError(
                f"{place} is computed from several pictures or without one, which is not read. Bake it to "
                "one picture in the program that made the file, or write paint: off."
            )
        if texture.has_uv_transform:
            raise MeshError(
                f"{place} has a texture that is moved, turned or scaled, which is not read. Export the model "
                "with the texture coordinates that show, or write paint: off."
            )
        found[name] = texture
    return found


def _facts_of(material: ufbx.Material | None) -> dict[str, Any]:
    """Return colour, factor on its picture, roughness (None for matt), metalness and pictures."""
    if material is None:
        facts = {"colour": GREY, "factor": 1.0, "bump": 1.0}
        facts |= {"roughness": None, "metalness": 0.0, "pictures": {}}
        return facts | {"name": "", "opacity": 1.0, "is_mask": True, "glows": False}
    features, maps, textures = counted(material.features), counted(material.pbr), _pictures_of(material)
    place, kind = f"the material {shorten(material.name)}", int(material.shader_type)
    colour = _base_colour(material)
    if kind == _SPECULAR_GLOSSINESS:
        raise MeshError(
            f"{place} has specular colour and glossiness, which are not read. Export it with metalness and "
            "roughness, or write paint: off."
        )
    is_physical = counted(features.pbr).enabled
    needed = ("base_color", "roughness") if is_physical else ("base_color",) if kind == _UNKNOWN else ()
    has_values = {name: counted(getattr(maps, name)).has_value for name in needed}
    has_values["base_color"] = colour is not None
    if any(name not in textures and not has_values[name] for name in needed):
        raise MeshError(
            f"{place} is of a kind whose colour and roughness are not read. Export it as a Phong or physical "
            "material, or write paint: off."
        )
    if ("roughness" in textures and not is_physical) or counted(counted(maps.glossiness).texture) is not None:
        raise MeshError(
            f"{place} has a picture of its shininess, which is not read. Export it with roughness, or write "
            "paint: off."
        )
    factor = min(max(_number(maps, "base_factor", 1.0), 0.0), 1.0)
    own = GREY if colour is None else tuple(min(max(part, 0.0), 1.0) for part in colour)
    shine = _number(maps, "specular_factor", 1.0) * max(counted(maps.specular_color).value_vec4[:3])
    is_matt = not is_physical and "roughness" not in textures and not shine
    return {
        "name": material.name,
        "opacity": _opacity_of(material),
        "glows": _number(maps, "emission_factor", 1.0) * max(counted(maps.emission_color).value_vec4[:3])
        > 0.0,
        "is_mask": counted(counted(maps.opacity).texture) is not None,
        "colour": tuple(factor * part for part in own),
        "factor": factor,
        "bump": _number(counted(material.fbx), "bump_factor", 1.0),
        "roughness": None if is_matt else min(max(_number(maps, "roughness", 0.5), 0.0), 1.0),
        "metalness": min(max(_number(maps, "metalness", 0.0), 0.0), 1.0),
        "pictures": {name: _picture_facts(texture) for name, texture in textures.items()},
    }


def _opacity_of(material: ufbx.Material) -> float:
    """Return the opacity of a material: what ufbx finds, else Autodesk's, else 1 less its transparency."""
    known = counted(counted(material.pbr).opacity)
    if known.has_value:
        return float(known.value_vec4[0])
    given = counted(material.props).find_prop("Opacity")
    if given is not None:
        return float(counted(given).value_vec4[0])
    maps = counted(material.fbx)
    factor, colour = _number(maps, "transparency_factor", -1.0), counted(maps.transparency_color)
    if colour.has_value:
        return 1.0 - (1.0 if factor < 0.0 else factor) * sum(colour.value_vec4[:3]) / 3.0
    return 1.0 - factor if 0.0 < factor < 1.0 else 1.0


def _base_colour(material: ufbx.Material) -> tuple[float, ...] | None:
    """Return the colour of a material; None where it has none that is known."""
    known = counted(counted(material.pbr).base_color)
    if known.has_value:
        return tuple(known.value_vec4[:3])
    given = counted(material.props).find_prop(_MAX_COLOUR)
    return None if given is None else tuple(counted(given).value_vec4[:3])


def _number(maps: Any, name: str, otherwise: float) -> float:
    given = counted(getattr(maps, name))
    return float(given.value_vec4[0]) if given.has_value else otherwise


def _picture_facts(texture: ufbx.Texture) -> dict[str, Any]:
    """Return the names of a picture's file, and the SHA-256 of a picture within the file."""
    content = _content_of(texture)
    relative = texture.relative_filename or texture.filename
    absolute = texture.absolute_filename or relative
    return {
        "names": [relative or absolute, absolute],
        "digest": hashlib.sha256(content).hexdigest() if content else "",
        "wrap": [_WRAPS[int(mode)] for mode in (texture.wrap_u, texture.wrap_v)],
    }


def _content_of(texture: ufbx.Texture) -> bytes:
    return bytes(counted(texture.content))


if __name__ == "__main__":
    Parser.serve(answer)
