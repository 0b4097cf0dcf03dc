"""Materials of model files as other programs show them; what is not shown of them is noted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import pytest

from flowsculpt.pipeline.errors import MeshError, MissingInputError, ShotError
from flowsculpt.pipeline.mesh.mesh_formats import ModelMaterials
from flowsculpt.pipeline.mesh.read import ModelFile
from flowsculpt.pipeline.plugins.interchange.exported_materials import exported_materials
from flowsculpt.pipeline.plugins.interchange.gltf_content import GltfContent
from flowsculpt.render.scene.materials import Painted, PatternedMaterial, Satin
from tests.plugins.interchange import fbx_writer, test_fbx_paint, test_usd_paint
from tests.plugins.interchange.test_model_paint import gltf_box, painted_box, picture, shot_of

GLOSS = "KHR_materials_pbrSpecularGlossiness"


def materials(path: Path) -> ModelMaterials:
    return ModelFile(path).materials()


def gltf_materials(folder: Path, **material: Any) -> ModelMaterials:
    return materials(gltf_box(folder, **material).glb(folder / "a.glb"))


@pytest.mark.parametrize(
    ("index", "notes"),
    [(0, ()), (1, ("primitive 0 of mesh 0 has no TEXCOORD_1, so its textures show as one colour",))],
)
def test_textures_without_their_coordinates_are_noted(tmp_path: Path, index: int, notes: Any) -> None:
    surface = {"baseColorTexture": {"index": 0, "texCoord": index}}
    assert gltf_materials(tmp_path, pbrMetallicRoughness=surface).notes == notes


def test_diffuse_colour_and_gloss_of_a_gltf_file_are_colour_and_roughness(tmp_path: Path) -> None:
    glossy = {"diffuseFactor": [1, 0.5, 0, 1], "glossinessFactor": 0.75, "specularFactor": [0, 0, 0]}
    (part,), _, notes = gltf_materials(tmp_path, extensions={GLOSS: glossy})
    assert isinstance(part, Satin) and part.colour == (1.0, 0.5, 0.0)
    assert (part.roughness, part.metallic, notes) == (0.25, 0.0, ())
    textured = {"diffuseTexture": {"index": 0}, "specularGlossinessTexture": {"index": 0}}
    (part,), _, notes = gltf_materials(tmp_path, name="hull", extensions={GLOSS: textured})
    assert part.colour_texture is not None
    assert notes == (f"material hull: the specular colour of {GLOSS} is not shown",)


@pytest.mark.parametrize(
    ("material", "words"),
    [
        ({"extensions": {"KHR_materials_unlit": {}}}, "unlit"),
        (
            {"extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}}},
            "KHR_materials_transmission is not shown",
        ),
        ({"extensions": {"KHR_materials_transmission": {"transmissionFactor": 0}}}, ""),
        ({"extensions": {"KHR_materials_clearcoat": {"clearcoatFactor": 0.5}}}, "KHR_materials_clearcoat"),
        (
            {"extensions": {"KHR_materials_sheen": {"sheenColorFactor": [0.0, 0.0, 0.5]}}},
            "KHR_materials_sheen",
        ),
        ({"extensions": {"KHR_materials_ior": {"ior": 1.4}}}, ""),
        ({"extensions": {"ACME_materials_best": {"tint": [1, 0, 0]}}}, "ACME_materials_best"),
        ({"emissiveFactor": [0, 1, 0]}, "glow"),
    ],
)
def test_what_is_not_shown_of_a_material_of_a_gltf_file_is_noted(
    tmp_path: Path, material: dict[str, Any], words: str
) -> None:
    notes = gltf_materials(tmp_path, **material).notes
    assert words in " ".join(notes) and bool(notes) == bool(words)


def test_an_unlit_material_is_no_metal(tmp_path: Path) -> None:
    surface = {"baseColorFactor": [0, 1, 0, 1], "metallicFactor": 1.0}
    unlit = {"KHR_materials_unlit": {}}
    (part,), _, _ = gltf_materials(tmp_path, pbrMetallicRoughness=surface, extensions=unlit)
    assert isinstance(part, Satin) and (part.colour, part.metallic) == ((0.0, 1.0, 0.0), 0.0)


def test_a_webp_picture_of_a_gltf_file_is_read(tmp_path: Path) -> None:
    levels = np.zeros((4, 4, 3), np.uint8)
    levels[..., 1] = 255
    content = iio.imwrite("<bytes>", levels, extension=".webp", lossless=True)
    scene = gltf_box(tmp_path, pbrMetallicRoughness={"baseColorTexture": {"index": 0}})
    scene.json["images"].append({"bufferView": scene.view(content), "mimeType": "image/webp"})
    scene.json["textures"] = [{"extensions": {"EXT_texture_webp": {"source": 1}}}]
    scene.require("EXT_texture_webp")
    (part,), _, _ = materials(scene.glb(tmp_path / "a.glb"))
    assert part.colour_texture is not None
    assert part.colour_texture.pixels()[0, 0] == pytest.approx((0.0, 1.0, 0.0))


@pytest.mark.parametrize("name", ["KHR_texture_basisu", "EXT_texture_avif", "ACME_texture_best"])
def test_a_picture_that_is_not_read_names_its_extension_unless_there_is_another(
    tmp_path: Path, name: str
) -> None:
    scene = gltf_box(tmp_path, pbrMetallicRoughness={"baseColorTexture": {"index": 0}})
    (texture,) = scene.json["textures"]
    texture["extensions"] = {name: {"source": 5}}
    assert materials(scene.glb(tmp_path / "a.glb")).parts[0].colour_texture is not None
    del texture["source"]
    with pytest.raises(MeshError, match=f"texture 0 has its picture only by the extension {name}"):
        materials(scene.glb(tmp_path / "b.glb"))


@pytest.mark.parametrize(
    ("statements", "names"),
    [
        ("mtllib one.mtl two.mtl", ["one.mtl", "two.mtl"]),
        ("mtllib two.mtl\nmtllib one.mtl", ["one.mtl", "two.mtl"]),
        ("mtllib a b.mtl", ["a b.mtl"]),
        ('mtllib "a b.mtl" one.mtl', ["a b.mtl", "one.mtl"]),
        ("mtllib one.mtl a b.mtl", ["one.mtl", "a b.mtl"]),
        ("mtllib C:\\work\\one.mtl", ["one.mtl"]),
    ],
)
def test_mtllib_names_one_or_several_files(tmp_path: Path, statements: str, names: list[str]) -> None:
    model = painted_box(tmp_path)
    model.write_text(model.read_text().replace("mtllib box.mtl", statements))
    for name in names:
        (tmp_path / name).write_text("newmtl other\nKd 0 1 0\n")
    (tmp_path / names[-1]).write_text("newmtl one\nkd 1 0 0\nnewmtl other\nKd 0 1 0\n")
    parts, files, notes = materials(model)
    assert [part.colour for part in parts] == [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)] and not notes
    assert {path.name for path in files} == set(names)


def test_a_missing_file_of_materials_among_others_and_a_missing_material_are_noted(tmp_path: Path) -> None:
    model = painted_box(tmp_path)
    model.write_text(model.read_text().replace("mtllib box.mtl", "mtllib box.mtl two.mtl"))
    (tmp_path / "box.mtl").write_text("newmtl other\nKd 1 0 0\n")
    notes = shot_of(model).notes
    assert "model box.obj: it names its materials two.mtl, which is not there" in notes
    assert any("its material one is in none of its files" in note for note in notes)
    (tmp_path / "box.mtl").unlink()
    with pytest.raises(MissingInputError, match=r"names its materials box\.mtl two\.mtl"):
        shot_of(model)


def test_decimal_commas_of_materials_are_refused(tmp_path: Path) -> None:
    model = painted_box(tmp_path)
    (tmp_path / "box.mtl").write_text("newmtl one\nKd 0,5 0,2 0,1\n")
    with pytest.raises(ShotError, match=r"box\.mtl, material one: .*decimals have a point, as in 0\.5"):
        shot_of(model)


@pytest.mark.parametrize(
    ("statement", "words"),
    [
        ("Ke 1 1 0", "its glow"),
        ("Ke 0 0 0", ""),
        ("map_Bump dents.png", "not shown: map_bump"),
        ("map_Pr rough.png", "not shown: map_pr"),
        ("Kd spectral skin.rfl", "its colour, Kd spectral skin.rfl, is not read"),
    ],
)
def test_what_is_not_shown_of_a_material_of_an_obj_is_noted(
    tmp_path: Path, statement: str, words: str
) -> None:
    model = painted_box(tmp_path)
    (tmp_path / "box.mtl").write_text(f"newmtl one\n{statement}\nnewmtl other\nKd 1 0 0\n")
    notes = materials(model).notes
    assert words in " ".join(notes) and bool(notes) == bool(words)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("color3f inputs:emissiveColor = (0, 1, 0)", "material /world/one: its emissiveColor is not shown"),
        ("color3f inputs:emissiveColor = (0, 0, 0)", ""),
        ("float inputs:clearcoat = 0.5", "its clearcoat is not shown"),
    ],
)
def test_what_is_not_shown_of_a_material_of_a_stage_is_noted(tmp_path: Path, value: str, words: str) -> None:
    box = test_usd_paint.box(test_usd_paint.BIND)
    notes = materials(test_usd_paint.write(tmp_path, test_usd_paint.material("one", value), box)).notes
    assert words in " ".join(notes) and bool(notes) == bool(words)


@pytest.mark.parametrize("factor", [0.0, 1.0])
def test_a_glow_of_an_fbx_material_is_noted(tmp_path: Path, factor: float) -> None:
    glow = {"EmissiveColor": (0.0, 1.0, 0.0), "EmissiveFactor": factor}
    first = fbx_writer.material(3, DiffuseColor=(0.5, 0.5, 0.5), **glow)
    picture(tmp_path / "atlas.png")
    path = test_fbx_paint.write(tmp_path / "box.fbx", test_fbx_paint.painted_box(first=first))
    assert ("its glow is not shown" in " ".join(materials(path).notes)) == bool(factor)


def _gltf(folder: Path, across: int, up: int) -> Path:
    scene = gltf_box(folder, pbrMetallicRoughness={"baseColorTexture": {"index": 0}})
    scene.json["samplers"] = [{"wrapS": across, "wrapT": up}]
    scene.json["textures"] = [{"source": 0, "sampler": 0}]
    return scene.glb(folder / "a.glb")


def _obj(folder: Path, option: str) -> Path:
    model = painted_box(folder)
    (folder / "box.mtl").write_text(f"newmtl one\nmap_Kd -clamp {option} atlas.png\nnewmtl other\n")
    return model


def _usd(folder: Path, modes: str, scale: float) -> Path:
    picture(folder / "atlas.png")
    colour = "color3f inputs:diffuseColor.connect = </world/one/picture.outputs:rgb>"
    nodes = test_usd_paint.PICTURE.replace("MORE", modes)
    atlas = test_usd_paint.COORDINATES.replace("(1, ", f"({scale}, ")
    box = test_usd_paint.box(atlas, test_usd_paint.BIND)
    return test_usd_paint.write(folder, test_usd_paint.material("one", colour, nodes=nodes), box)


def _fbx(folder: Path, across: int, up: int) -> Path:
    picture(folder / "atlas.png")
    objects = test_fbx_paint.painted_box()
    objects[4] = fbx_writer.texture(5, "atlas.png", WrapModeU=across, WrapModeV=up)
    return test_fbx_paint.write(folder / "box.fbx", objects)


WRAP_S, WRAP_T = ('uniform token inputs:wrapS = "mirror"', 'uniform token inputs:wrapT = "clamp"')


@pytest.mark.parametrize(
    ("write", "given", "wrap"),
    [
        (_gltf, (10497, 10497), ("repeat", "repeat")),
        (_gltf, (33071, 33648), ("clamp", "mirror")),
        (_obj, ("on",), ("clamp", "clamp")),
        (_obj, ("off",), ("repeat", "repeat")),
        (_usd, (f"{WRAP_S}\n{WRAP_T}", 1.0), ("mirror", "clamp")),
        (_usd, ("", 2.0), ("black", "black")),
        (_usd, ("", 1.0), ("repeat", "repeat")),  # nothing beyond the picture shows
        (_fbx, (0, 1), ("repeat", "clamp")),
    ],
)
def test_what_is_shown_beyond_a_picture_is_read_and_exported(
    tmp_path: Path, write: Any, given: tuple[Any, ...], wrap: tuple[str, str]
) -> None:
    part: PatternedMaterial = materials(write(tmp_path, *given)).parts[0]
    assert part.colour_texture is not None and part.colour_texture.wrap == wrap
    assert part.projection.keeps_place == (wrap != ("repeat", "repeat"))
    look = Painted((1.0, 1.0, 1.0), parts=(part,))
    (exported,) = exported_materials(look)
    assert exported.colour is not None and exported.colour.wrap == wrap
    shown = iio.imread(exported.colour.content)
    assert (shown[0, 0].max() == 0) == (wrap == ("black", "black")) and shown[5, 3].max() > 0
    content, numbers = GltfContent(plain=True), {"repeat": 10497, "clamp": 33071, "mirror": 33648}
    content._texture(exported.colour)
    (sampler,) = content.lists["samplers"]
    assert [sampler["wrapS"], sampler["wrapT"]] == [numbers.get(mode, 33071) for mode in wrap]
