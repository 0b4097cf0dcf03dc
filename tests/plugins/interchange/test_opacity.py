"""The opacity of models: as four formats have it, and as exports carry it on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import UsdShade

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.errors import MeshError
from flowsculpt.pipeline.mesh.read import ModelFile
from flowsculpt.pipeline.plugins.interchange.exported_frame import exported_frame
from flowsculpt.pipeline.plugins.interchange.exported_materials import exported_materials, pictures_recipe
from flowsculpt.pipeline.plugins.interchange.fbx_paint import FBX_PAINT
from flowsculpt.pipeline.plugins.interchange.gltf_document import GltfDocument
from flowsculpt.pipeline.plugins.interchange.model_export import write_glb
from flowsculpt.pipeline.plugins.interchange.usd_files import USD_PAINT
from flowsculpt.pipeline.plugins.interchange.usd_materials import add_material
from flowsculpt.render.scene.materials import Diffuse, Opacity, PatternedMaterial
from flowsculpt.render.scene.textures import Texture
from tests.plugins.interchange import test_fbx_paint as fbx
from tests.plugins.interchange import test_usd_paint as usd
from tests.plugins.interchange.gltf_scenes import GltfScene
from tests.plugins.interchange.node_programs import gltf_messages
from tests.plugins.interchange.test_embedded_pictures import picture_of, stored
from tests.plugins.interchange.test_model_paint import gltf_box, painted_box, shot_of

PLAIN = {"DiffuseColor": (0.5, 0.5, 0.5), "Shininess": 25.0, "ShininessExponent": 25.0}


def leaf(path: Path, channels: int = 4) -> Path:
    """A picture whose left half is not there, black as many programs write it."""
    pixels = np.zeros((8, 8, channels), np.uint8)
    pixels[:, 4:] = 255 if channels == 1 else (51, 102, 153, 255)[:channels]
    return stored(path, pixels)


def first_of(path: Path) -> PatternedMaterial:
    return ModelFile(path).materials()[0][0]


def obj(folder: Path, *lines: str) -> PatternedMaterial:
    model = painted_box(folder)
    (folder / "box.mtl").write_text("\n".join(["newmtl one", *lines, "newmtl other"]))
    return first_of(model)


def halves(opacity: Opacity | None) -> list[float]:
    """The fractions of both halves of the leaf."""
    assert opacity is not None
    return [float(opacity.fractions()[0, column, 0]) for column in (1, 6)]


@pytest.mark.parametrize(
    ("lines", "factor"), [(["d 0.25"], 0.25), (["d -halo 0.5"], 0.5), (["Tr 0.25"], 0.75), (["d 1"], None)]
)
def test_the_opacity_of_an_obj_is_a_number(tmp_path: Path, lines: list[str], factor: float | None) -> None:
    assert obj(tmp_path, *lines).opacity == (None if factor is None else Opacity(factor))


def test_a_picture_of_an_obj_is_its_alpha_or_without_one_its_brightness(tmp_path: Path) -> None:
    for name, channels in (("alpha.png", 4), ("grey.png", 1)):
        leaf(tmp_path / name, channels)
        assert halves(obj(tmp_path, f"map_d {name}", "d 0.5").opacity) == [0.0, 0.5]
    assert halves(obj(tmp_path, "map_d -imfchan g alpha.png").opacity) == pytest.approx([0.0, 0.4])
    with pytest.raises(MeshError, match="a material has Tr 1, which some programs"):
        obj(tmp_path, "Tr 1")


def gltf(folder: Path, alpha: float = 1.0, **material: Any) -> GltfScene:
    surface = {"baseColorTexture": {"index": 0}, "baseColorFactor": [1, 1, 1, alpha]}
    scene = gltf_box(folder, pbrMetallicRoughness=surface, **material)
    content = leaf(folder / "leaf.png").read_bytes()
    scene.json["images"] = [{"bufferView": scene.view(content), "mimeType": "image/png"}]
    return scene


def test_gltf_masks_and_blends_by_the_alpha_of_its_colour(tmp_path: Path) -> None:
    assert first_of(gltf(tmp_path).glb(tmp_path / "a.glb")).opacity is None
    mask = first_of(gltf(tmp_path, 0.5, alphaMode="MASK", alphaCutoff=0.4).glb(tmp_path / "a.glb")).opacity
    assert mask is not None and mask.cutoff == 0.4
    less, more = halves(mask)
    assert less < -1e5 and more > 1e4
    assert halves(first_of(gltf(tmp_path, 0.5, alphaMode="BLEND").glb(tmp_path / "a.glb")).opacity) == [
        0,
        0.5,
    ]


def test_alpha_of_vertex_colours_is_refused_where_it_shows(tmp_path: Path) -> None:
    for mode in ("OPAQUE", "MASK"):
        scene = gltf_box(tmp_path, pbrMetallicRoughness={}, alphaMode=mode)
        colours = scene.accessor(np.full((12, 4), 0.5))
        scene.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = colours
        path = scene.glb(tmp_path / "a.glb")
        if mode == "OPAQUE":
            ModelFile(path).paint()
            continue
        with pytest.raises(MeshError, match="has vertex colours with alpha"):
            ModelFile(path).paint()


def test_usd_has_a_channel_and_a_threshold(tmp_path: Path) -> None:
    path = usd.painted_box(
        tmp_path, usd.COLOUR, "float inputs:opacity.connect = </world/one/picture.outputs:a>",
        "float inputs:opacityThreshold = 0.25",
    )  # fmt: skip
    path.write_text(path.read_text().replace("float outputs:g", "float outputs:g\nfloat outputs:a"))
    leaf(tmp_path / "atlas.png")
    opacity = first_of(path).opacity
    assert opacity is not None and opacity.texture is not None
    assert (opacity.cutoff, opacity.texture.channel) == (0.25, Texture.ALPHA)
    thin = usd.painted_box(tmp_path, "float inputs:opacity = 0.5")
    assert USD_PAINT.materials(thin)[0][0].opacity == Opacity(0.5)


@pytest.mark.parametrize(
    ("given", "creator", "factor"),
    [
        ({"Opacity": 0.25, "TransparencyFactor": 1.0}, "", 0.25),
        ({"TransparencyFactor": 0.5, "TransparentColor": (0.5, 0.5, 0.5)}, "", 0.75),
        ({"TransparencyFactor": 1.0, "TransparentColor": (0.0, 0.0, 0.0)}, "", None),
        ({"TransparencyFactor": 0.25}, "", 0.75),
        ({"TransparencyFactor": 1.0}, "", None),
        (PLAIN | {"TransparencyFactor": 0.25}, fbx.BLENDER, 0.75),
    ],
)
def test_the_opacity_of_an_fbx_is_a_number(
    tmp_path: Path, given: dict[str, Any], creator: str, factor: float | None
) -> None:
    path = fbx.write(
        tmp_path / "a.fbx", fbx.painted_box(first=fbx.material(3, "Phong", **given)), fbx.LINKS[:4],
        creator=creator,
    )  # fmt: skip
    opacity = FBX_PAINT.materials(path)[0][0].opacity
    assert (opacity and opacity.factor) == (None if factor is None else pytest.approx(factor))


def test_a_picture_of_an_fbx_needs_alpha_where_programs_read_it_in_two_ways(tmp_path: Path) -> None:
    leaf(tmp_path / "atlas.png")
    for creator, name in (("", "TransparentColor"), (fbx.BLENDER, "TransparencyFactor")):
        links = [*fbx.LINKS, (5, 3, name)]
        first = fbx.material(3, "Phong", **PLAIN)
        path = fbx.write(tmp_path / "a.fbx", fbx.painted_box(first=first), links, creator=creator)
        assert halves(FBX_PAINT.materials(path)[0][0].opacity) == [0.0, 1.0]
    leaf(tmp_path / "atlas.png", 3)
    path = fbx.write(tmp_path / "b.fbx", fbx.painted_box(), [*fbx.LINKS, (5, 3, "TransparentColor")])
    with pytest.raises(MeshError, match="the material 3 has a picture of transparency without alpha"):
        FBX_PAINT.materials(path)


@pytest.mark.parametrize("mode", ["MASK", "BLEND"])
def test_an_exported_glb_has_the_opacity_and_colours_that_go_on_beside_holes(
    tmp_path: Path, mode: str
) -> None:
    shot = shot_of(gltf(tmp_path, 0.75, alphaMode=mode).glb(tmp_path / "side.glb"), last=1)
    write_glb(tmp_path / "a.glb", exported_frame(shot, next(animate(shot))), shot.picture.look)
    assert gltf_messages(tmp_path / "a.glb") == []
    document = GltfDocument.read(tmp_path / "a.glb")
    (material,) = document.root.values["materials"]
    assert material["alphaMode"] == mode and material.get("alphaCutoff") == (0.5 if mode == "MASK" else None)
    pixels = picture_of(document, material, "baseColorTexture")
    assert pixels[0].tolist() == [
        [51, 102, 153, 0],
        *[[0, 0, 0, 0]] * 2,
        *[[51, 102, 153, 0]],
        *[[51, 102, 153, 255]] * 4,
    ]
    again = first_of(tmp_path / "a.glb").opacity
    assert again is not None and halves(again) == pytest.approx(halves(shot.picture.look.parts[0].opacity))  # type: ignore[attr-defined]


def test_a_mask_of_another_size_and_a_colour_alone_make_one_picture(tmp_path: Path) -> None:
    leaf(tmp_path / "grey.png", 1)
    part = obj(tmp_path, "Kd 1 0 0", "map_d grey.png")
    (material,) = exported_materials(part)
    assert material.is_cut_out and material.colour is not None and material.surface.colour == (1.0, 0.0, 0.0)
    assert pictures_recipe(part) == ["pictures"]


def test_usd_carries_opacity_and_threshold() -> None:
    from pxr import Usd

    stage = Usd.Stage.CreateInMemory()
    add_material(stage, "/a", Diffuse((1, 1, 1), opacity=Opacity(0.5, cutoff=0.25)), {"opacity": "a.exr"})
    surface = UsdShade.Shader(stage.GetPrimAtPath("/a/surface"))
    assert surface.GetInput("opacityThreshold").Get() == 0.25
    (source,), _ = surface.GetInput("opacity").GetConnectedSources()
    assert source.sourceName == "r"
