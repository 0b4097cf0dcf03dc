"""Exports of painted and textured sculptures carry their pictures: glTF, stills of it, and pages."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import OpenImageIO as oiio
import pytest

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.pipeline.plugins.interchange.animated_gltf import Moving, write_animated_gltf
from flowsculpt.pipeline.plugins.interchange.drawn_mesh import DrawnMesh, KeyPoses
from flowsculpt.pipeline.plugins.interchange.embedded_pictures import EmbeddedPicture
from flowsculpt.pipeline.plugins.interchange.exported_frame import exported_frame
from flowsculpt.pipeline.plugins.interchange.exported_materials import exported_materials, pictures_recipe
from flowsculpt.pipeline.plugins.interchange.gltf_document import GltfDocument
from flowsculpt.pipeline.plugins.interchange.model_export import write_glb
from flowsculpt.pipeline.plugins.interchange.one_mesh import OneMesh
from flowsculpt.pipeline.plugins.interchange.unifying import Unification
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.request.shot_source import ShotSource
from flowsculpt.pipeline.production.store.store import Store
from flowsculpt.pipeline.shot import Shot
from flowsculpt.render.base.input_files import InputFile
from flowsculpt.render.scene.materials import LOOKS, Painted, Plastic
from flowsculpt.render.scene.textures import Texture
from tests.plugins.interchange.node_programs import gltf_messages
from tests.plugins.interchange.test_animated_gltf import Player
from tests.plugins.interchange.test_model_paint import gltf_box, painted_box, shot_of

LINEAR, MIPMAPS, REPEAT = 9729, 9987, 10497  # as glTF numbers them


def stored(path: Path, pixels: AnyArray, **attributes: Any) -> Path:
    height, width, channels = pixels.shape
    kind = {np.dtype("u1"): "uint8", np.dtype("u2"): "uint16", np.dtype("f4"): "float"}[pixels.dtype]
    spec = oiio.ImageSpec(width, height, channels, kind)
    for name, value in attributes.items():
        spec.attribute(name, value)
    file = oiio.ImageOutput.create(str(path))
    assert file.open(str(path), spec) and file.write_image(pixels) and file.close()
    return path


def noise(height: int = 12, width: int = 20, channels: int = 3) -> AnyArray:
    return np.random.default_rng(3).integers(0, 256, (height, width, channels)).astype(np.uint8)


def texture(path: Path, space: str | None = None) -> Texture:
    return Texture.of(str(path), InputFile(path).digest(), space)


@pytest.mark.parametrize(("name", "channels"), [("a.png", 3), ("a.png", 1), ("a.png", 4), ("a.jpg", 3)])
def test_a_png_or_jpeg_is_embedded_as_the_file_is(tmp_path: Path, name: str, channels: int) -> None:
    path = stored(tmp_path / name, noise(channels=channels))
    assert EmbeddedPicture.of_texture(texture(path), 2048, is_colour=True).content == path.read_bytes()


def test_what_readers_would_see_otherwise_is_encoded_again(tmp_path: Path) -> None:
    turned = texture(stored(tmp_path / "turned.jpg", noise(), Orientation=6))
    linear = texture(stored(tmp_path / "linear.png", noise()), "linear")
    floats = texture(stored(tmp_path / "a.exr", np.full((2, 3, 3), 0.25, np.float32)))
    for each in (turned, linear, floats):
        kind, content, _ = EmbeddedPicture.of_texture(each, 2048, is_colour=True)
        assert content != Path(each.path).read_bytes()
        shown, pixels = iio.imread(io.BytesIO(content)) / 255.0, each.pixels()
        assert kind == ("image/jpeg" if each is turned else "image/png")
        assert shown.shape == pixels.shape
        srgb = np.where(pixels < 0.0031308, 12.92 * pixels, 1.055 * pixels ** (1 / 2.4) - 0.055)
        assert np.abs(shown - srgb).mean() < (0.03 if each is turned else 0.003)


def test_large_pictures_are_averaged_in_light(tmp_path: Path) -> None:
    stripes = np.zeros((2, 64, 3), np.uint8)
    stripes[:, ::2] = 255
    kind, content, _ = EmbeddedPicture.of_texture(
        texture(stored(tmp_path / "a.png", stripes)), 32, is_colour=True
    )
    shown = iio.imread(io.BytesIO(content))
    assert (kind, shown.shape) == ("image/png", (1, 32, 3)) and (shown == 188).all()


def test_roughness_alone_is_green_and_its_root_where_it_is_the_width_of_lobes(tmp_path: Path) -> None:
    path = stored(tmp_path / "rough.png", np.full((4, 4, 1), 64, np.uint8))
    (material,) = exported_materials(Plastic((1, 1, 1), roughness_texture=texture(path, "data")))
    assert material.numbers is not None and material.surface.roughness == 1.0
    assert iio.imread(io.BytesIO(material.numbers.content))[0, 0].tolist() == [255, 128, 255]
    assert material.surface.metallic == 0.0


def test_keys_of_looks_without_pictures_stay() -> None:
    assert [pictures_recipe(look) for look in LOOKS.values()] == [[]] * len(LOOKS)


def one_mesh(shot: Shot, folder: Path) -> OneMesh:
    source = ShotSource((folder / "a.yaml").read_text(), folder / "a.yaml")
    request = RenderRequest(source, "draft", "none", tuple(shot.frames))
    return Unification(request, Store(folder / "store")).one_mesh()


@pytest.fixture
def painted(tmp_path: Path) -> tuple[Shot, OneMesh]:
    """A box of two materials: five sides with a picture, the sixth red."""
    model = painted_box(tmp_path)
    stored(tmp_path / "atlas.png", noise(48, 8))
    shot = shot_of(model, last=3)
    return shot, one_mesh(shot, tmp_path)


def picture_of(document: GltfDocument, material: dict[str, Any], slot: str) -> AnyArray:
    """The pixels of a material's texture in a GLB."""
    root = document.root.values
    entry = root["textures"][material["pbrMetallicRoughness"][slot]["index"]]
    assert root["samplers"][entry["sampler"]] == {
        "magFilter": LINEAR,
        "minFilter": MIPMAPS,
        "wrapS": REPEAT,
        "wrapT": REPEAT,
    }
    view = root["bufferViews"][root["images"][entry["source"]]["bufferView"]]
    content = document.buffer(0)[view["byteOffset"] :][: view["byteLength"]]
    return np.asarray(iio.imread(io.BytesIO(content)))


@pytest.mark.parametrize("form", ["compressed", "plain", "still"])
def test_a_model_of_two_materials_has_two_primitives_and_its_picture(
    tmp_path: Path, painted: tuple[Shot, OneMesh], form: str
) -> None:
    shot, mesh = painted
    path = tmp_path / "a.glb"
    if form == "still":
        write_glb(path, exported_frame(shot, next(animate(shot))), shot.picture.look)
    else:
        moving = Moving("box", KeyPoses.of(DrawnMesh.of(mesh)), shot.picture.look)
        write_animated_gltf(path, "clip", [moving], plain=form == "plain")
    assert gltf_messages(path) == []
    player, document = Player(path), GltfDocument.read(path)
    primitives, materials = player.root["meshes"][0]["primitives"], player.root["materials"]
    pictured, red = (materials[each["material"]] for each in primitives)
    assert np.array_equal(picture_of(document, pictured, "baseColorTexture"), noise(48, 8))
    assert red["pbrMetallicRoughness"]["baseColorFactor"] == [1.0, 0.0, 0.0, 1.0]
    assert "baseColorTexture" not in red["pbrMetallicRoughness"] and len(player.root["images"]) == 1
    for number, primitive in enumerate(primitives):
        assert "COLOR_0" not in primitive["attributes"]
        corners = player.values(primitive["indices"])[:, 0].astype(int)
        coordinates = player.values(primitive["attributes"]["TEXCOORD_0"])[corners]
        up = 1.0 - coordinates[:, 1]  # the atlas has a tile a side, from the bottom up
        assert (up < 5 / 6 + 1e-6).all() if number == 0 else (up > 5 / 6 - 1e-6).all()
    assert sum(player.root["accessors"][each["indices"]]["count"] for each in primitives) >= 3 * 12


def test_vertex_colours_at_the_border_of_a_material_are_its_own(tmp_path: Path) -> None:
    scene = gltf_box(tmp_path, pbrMetallicRoughness={})
    colours = np.repeat([[0.25, 0.5, 1.0], [1.0, 0.0, 0.0]], 6, axis=0)
    scene.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = scene.accessor(colours)
    shot = shot_of(scene.glb(tmp_path / "side.glb"), last=2)
    moving = Moving("box", KeyPoses.of(DrawnMesh.of(one_mesh(shot, tmp_path))), shot.picture.look)
    write_animated_gltf(tmp_path / "a.glb", "clip", [moving], plain=True)
    player = Player(tmp_path / "a.glb")
    corners = player.values(player.primitive["indices"])[:, 0].astype(int)
    shown = player.values(player.primitive["attributes"]["COLOR_0"])[corners, :3]
    assert {tuple(row) for row in np.round(shown, 2).tolist()} == {(0.25, 0.5, 1.0), (1.0, 0.0, 0.0)}


def test_maps_of_a_gltf_file_are_its_own_pictures(tmp_path: Path) -> None:
    surface = {
        "baseColorTexture": {"index": 0},
        "baseColorFactor": [0.5, 1, 1, 1],
        "metallicRoughnessTexture": {"index": 0},
        "roughnessFactor": 0.5,
    }
    bumps = {"index": 0, "scale": 0.25}
    model = gltf_box(tmp_path, pbrMetallicRoughness=surface, normalTexture=bumps).glb(tmp_path / "side.glb")
    shot, path = shot_of(model, last=1), tmp_path / "a.glb"
    write_glb(path, exported_frame(shot, next(animate(shot))), shot.picture.look)
    # Fixed tangents would not follow morph targets, in three.js among others.
    assert [each["code"] for each in gltf_messages(path)] == ["MESH_PRIMITIVE_GENERATED_TANGENT_SPACE"]
    document = GltfDocument.read(path)
    (material,) = document.root.values["materials"]
    found = material["pbrMetallicRoughness"]
    assert found["baseColorFactor"] == [0.5, 1.0, 1.0, 1.0]
    assert (found["roughnessFactor"], found["metallicFactor"]) == (0.5, 1.0)
    assert len(document.root.values["images"]) == 1 and material["normalTexture"] == bumps
    for slot in ("baseColorTexture", "metallicRoughnessTexture"):
        assert picture_of(document, material, slot)[0, 0].tolist() == [51, 102, 153]
    again = shot_of(path, last=1).picture.look  # our own reader finds what was written
    assert isinstance(again, Painted) and again.parts[0].colour_texture.factor == (0.5, 1.0, 1.0)
    assert again.parts[0].normal_texture.factor == (0.25, 0.25, 1.0)
