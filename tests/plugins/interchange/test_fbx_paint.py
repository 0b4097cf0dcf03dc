"""The paint of FBX files: texture coordinates, vertex colours, materials and pictures."""

from __future__ import annotations

import json
import re
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest

from flowsculpt.pipeline.animation import animate, material_of
from flowsculpt.pipeline.errors import MeshError, MissingInputError
from flowsculpt.pipeline.plugins.interchange.fbx_paint import FBX_PAINT, MATERIALS
from flowsculpt.pipeline.plugins.interchange.scene_readers import asked
from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.scene.materials import Diffuse, Painted, Satin
from flowsculpt.render.scene.painted_faces import PaintedFaces
from tests.plugins.interchange.fbx_writer import (
    SIDES,
    N,
    binary,
    box_geometry,
    coordinates,
    layer,
    material,
    model,
    scene,
    texture,
    video,
)
from tests.plugins.interchange.test_model_paint import on_box, paint_of, picture, shot_of

ATLAS = [
    value for k in range(6) for u, v in ((0, 0), (1, 0), (1, 1), (0, 1)) for value in (u * 1.0, (k + v) / 6)
]
"""Texture coordinates of a box with one chart a side, one above the other."""
OF_SIDES = layer("LayerElementMaterial", "ByPolygon", "Materials", [0, 0, 0, 0, 0, 1])
LINKS = [(2, 0), (1, 2), (3, 2), (4, 2), (5, 3, "DiffuseColor")]
"""A mesh 1 of node 2 with materials 3 and 4, the first with the texture 5."""
BLENDER = "Blender (stable FBX IO) - 4.2.0 - 5.12.0"


def painted_box(*more: N, first: N | None = None, name: str = "atlas.png", layers: Any = ()) -> list[N]:
    """The objects of a box with an atlas on five sides and a red material on the last."""
    return [
        box_geometry(1, coordinates("map1", ATLAS), OF_SIDES, *layers),
        model(2, "box"),
        first or material(3, DiffuseColor=(0.0, 0.0, 0.0), DiffuseFactor=0.5),
        material(4, "Phong", DiffuseColor=(1.0, 0.0, 0.0), SpecularColor=(1.0, 1.0, 1.0), Shininess=25.0,
                 ShininessExponent=25.0),
        texture(5, name),
        *more,
    ]  # fmt: skip


def write(path: Path, objects: list[N], links: Any = LINKS, **settings: Any) -> Path:
    path.write_bytes(binary(scene(objects, links, **settings)))
    return path


def facts(objects: list[N], links: Any = LINKS, **settings: Any) -> list[dict[str, Any]]:
    """Return what the process of ufbx answers about materials."""
    with TemporaryDirectory() as folder:
        path = write(Path(folder) / "box.fbx", objects, links, **settings)
        found: list[dict[str, Any]] = json.loads(
            asked("flowsculpt.pipeline.plugins.interchange.fbx_paint", path, MATERIALS)
        )
    return found


def test_corners_of_an_fbx_take_the_texture_coordinates_of_their_place_at_rest(tmp_path: Path) -> None:
    picture(tmp_path / "atlas.png")
    shot = shot_of(write(tmp_path / "box.fbx", painted_box()), last=4)
    for frame in animate(shot):
        paint, rest = paint_of(shot, frame), material_of(frame.mesh)
        assert paint.coordinates == pytest.approx(on_box(rest, frame.mesh.faces), abs=1e-9)
        middle = rest[frame.mesh.faces].mean(axis=1)
        is_last = (np.abs(middle).argmax(axis=1) == 2) & (middle[:, 2] > 0)
        assert np.array_equal(paint.materials == 1, is_last)
    assert len(frame.mesh.vertices) > 300 and len(frame.mesh.seams)
    look = shot.picture.look
    assert isinstance(look, Painted)
    atlas, red = look.parts
    assert isinstance(atlas, Diffuse) and atlas.colour_texture is not None
    linear = ((np.array([0.2, 0.4, 0.6]) + 0.055) / 1.055) ** 2.4
    assert atlas.colour_texture.pixels()[0, 0] == pytest.approx(0.5 * linear, abs=2e-3)
    assert isinstance(red, Satin) and red.colour == (1.0, 0.0, 0.0)
    assert red.roughness == pytest.approx(0.5)
    assert {path.name for path, _ in shot.files} == {"box.fbx", "atlas.png"}


def test_paint_stands_where_nodes_and_mirrors_put_its_mesh(tmp_path: Path) -> None:
    node = model(2, "box", Lcl__Translation=(5.0, 0.0, 0.0), Lcl__Scaling=(-1.0, 1.0, 1.0))
    objects = [box_geometry(1, coordinates("map1", ATLAS)), node]
    paint = FBX_PAINT.paint(write(tmp_path / "box.fbx", objects, [(2, 0), (1, 2)]))
    place = paint.points * (-1.0, 1.0, 1.0) + (5.0, 0.0, 0.0)
    faces = np.arange(3 * len(paint.corners)).reshape(-1, 3)  # type: ignore[attr-defined]
    found = paint.on_faces(paint.points[paint.corners].reshape(-1, 3), faces)  # type: ignore[attr-defined]
    expected = on_box(place[paint.corners].reshape(-1, 3), faces)  # type: ignore[attr-defined]
    assert found.coordinates == pytest.approx(expected, abs=1e-9)
    outwards = np.cross(*(np.diff(paint.points[paint.corners], axis=1).transpose(1, 0, 2)))  # type: ignore[attr-defined]
    middles = paint.points[paint.corners].mean(axis=1) - (5.0, 0.0, 0.0)  # type: ignore[attr-defined]
    assert (np.einsum("fx,fx->f", outwards, middles) > 0.0).all()


def test_a_picture_within_an_fbx_file_is_read(tmp_path: Path) -> None:
    content = picture(tmp_path / "atlas.png").read_bytes()
    (tmp_path / "atlas.png").unlink()
    within = video(6, "atlas.png", content)
    path = write(tmp_path / "box.fbx", painted_box(within), [*LINKS, (6, 5)])
    (atlas, _), files, _ = FBX_PAINT.materials(path)
    assert atlas.colour_texture is not None and not files
    assert Path(atlas.colour_texture.path).read_bytes() == content


def test_a_damaged_picture_within_an_fbx_file_is_named_with_the_file(tmp_path: Path) -> None:
    within = video(6, "atlas.png", picture(tmp_path / "atlas.png").read_bytes()[:60])
    path = write(tmp_path / "box.fbx", painted_box(within), [*LINKS, (6, 5)])
    with pytest.raises(BadInputError, match=re.escape(f"{path}: its picture atlas.png: ")):
        FBX_PAINT.materials(path)


def test_roughness_and_metalness_of_blender_and_their_pictures_are_read(tmp_path: Path) -> None:
    picture(tmp_path / "rough.png", (0.25, 0.25, 0.25))
    metal = material(3, "Phong", DiffuseColor=(0.5, 0.5, 0.5), Shininess=49.0, ShininessExponent=49.0,
                     ReflectionFactor=0.75, SpecularFactor=0.25, SpecularColor=(1.0, 1.0, 1.0))  # fmt: skip
    links = [*LINKS[:4], (5, 3, "ShininessExponent"), (6, 3, "ReflectionFactor")]
    objects = painted_box(texture(6, "rough.png"), first=metal, name="rough.png")
    path = write(tmp_path / "box.fbx", objects, links, creator=BLENDER)
    (found, _), files, _ = FBX_PAINT.materials(path)
    assert isinstance(found, Satin) and found.roughness_texture is not None
    assert found.metallic_texture is not None and found.colour == (0.5, 0.5, 0.5)
    assert found.roughness_texture.numbers()[0, 0, 0] == pytest.approx(0.25, abs=3e-3)
    assert [file.name for file in files] == ["rough.png"]
    plain, _ = facts(painted_box(first=metal), LINKS[:4], creator=BLENDER)
    assert plain["roughness"] == pytest.approx(0.3) and plain["metalness"] == 0.75


def test_normal_maps_of_an_fbx_are_read_with_their_strength(tmp_path: Path) -> None:
    picture(tmp_path / "atlas.png", (0.5, 0.5, 1.0))
    links = [*LINKS[:4], (5, 3, "NormalMap")]
    path = write(tmp_path / "box.fbx", painted_box(first=material(3, "Phong", BumpFactor=0.5)), links)
    (found, _), files, _ = FBX_PAINT.materials(path)
    assert isinstance(found, Satin | Diffuse) and found.normal_texture is not None
    assert found.normal_texture.factor == (0.5, 0.5, 1.0) and found.has_normal_map
    assert [file.name for file in files] == ["atlas.png"]


def of_3ds_max(numbers: tuple[int, int], **given: Any) -> N:
    """A material of 3ds Max, by the numbers of its class."""
    names = {f"3dsMax|Parameters|{name}": value for name, value in given.items()}
    return material(3, "unknown", **{"3dsMax|ClassIDa": numbers[0], "3dsMax|ClassIDb": numbers[1]}, **names)


PHYSICAL = (0x3D6B1CEC, 0xDEADC001 - 2**32)
SPECULAR_GLOSSINESS = (0xD00F1E00 - 2**32, 0x01DBAD33)


def test_metalness_and_roughness_of_3ds_max_are_read() -> None:
    metal = of_3ds_max(PHYSICAL, base_weight=0.5, base_color=(0.5, 0.25, 1.0), metalness=0.25, roughness=0.4)
    links = [*LINKS[:4], (5, 3, "3dsMax|Parameters|roughness_map")]
    found, _ = facts(painted_box(first=metal), links)
    assert found["colour"] == pytest.approx((0.25, 0.125, 0.5)) and found["metalness"] == 0.25
    assert found["roughness"] == pytest.approx(0.4) and list(found["pictures"]) == ["roughness"]


def test_the_colour_of_a_pbr_material_of_3ds_max_is_read() -> None:
    class_of = {"3dsMax|ClassIDa": 0xD00F1E00 - 2**32, "3dsMax|ClassIDb": 0xBE77E500 - 2**32}
    values = {"basecolor": (0.5, 0.25, 1.0), "roughness": 0.4, "metalness": 0.25}
    own = {f"3dsMax|main|{name}": value for name, value in values.items()}
    found, _ = facts(painted_box(first=material(3, "unknown", **class_of, **own)), LINKS[:4])
    assert (found["colour"], found["metalness"]) == ([0.5, 0.25, 1.0], 0.25)
    assert found["roughness"] == pytest.approx(0.4)


def test_maps_of_bumps_and_light_of_an_fbx_are_not_opened() -> None:
    links = [*LINKS[:4], (5, 3, "Bump"), (5, 3, "EmissiveColor")]
    assert [found["pictures"] for found in facts(painted_box(), links)] == [{}, {}]


def test_vertex_colours_of_an_fbx_are_srgb_and_for_materials_without_a_picture(tmp_path: Path) -> None:
    picture(tmp_path / "atlas.png")
    colours = layer("LayerElementColor", "ByPolygonVertex", "Colors", [0.5, 0.5, 1.0, 1.0] * 24)
    plain = [box_geometry(7), model(8, "plain", Lcl__Translation=(5.0, 0.0, 0.0))]
    objects = painted_box(*plain, layers=[colours])
    path = write(tmp_path / "box.fbx", objects, [*LINKS, (8, 0), (7, 8), (4, 8)])
    (atlas, red), _, _ = FBX_PAINT.materials(path)
    assert atlas.colour_from is None and red.colour_from == PaintedFaces.COLOURS
    paint = FBX_PAINT.paint(path)
    found = paint.colours  # type: ignore[attr-defined]
    assert found[:12] == pytest.approx(np.broadcast_to([0.21404, 0.21404, 1.0], (12, 3, 3)), abs=1e-4)
    assert found[12:] == pytest.approx(np.broadcast_to([1.0, 0.0, 0.0], (12, 3, 3)))


def test_the_texture_coordinates_that_a_picture_names_are_read(tmp_path: Path) -> None:
    sets = [coordinates("map1", [0.0] * 48), coordinates("atlas", ATLAS, 1)]
    objects = [box_geometry(1, *sets), model(2, "box"), material(3), texture(5, "atlas.png", "atlas")]
    links = [(2, 0), (1, 2), (3, 2), (5, 3, "DiffuseColor")]
    paint = FBX_PAINT.paint(write(tmp_path / "box.fbx", objects, links))
    faces = np.arange(36).reshape(-1, 3)
    corners = paint.points[paint.corners].reshape(-1, 3)  # type: ignore[attr-defined]
    assert paint.on_faces(corners, faces).coordinates == pytest.approx(on_box(corners, faces), abs=1e-9)
    with pytest.raises(MeshError, match="'box' does not have the texture coordinates other"):
        facts([*objects[:3], texture(5, "atlas.png", "other")], links)
    both = [*objects, texture(6, "rough.png", "map1")]
    with pytest.raises(MeshError, match="different texture coordinates"):
        facts(both, [*links, (6, 3, "ReflectionFactor")], creator=BLENDER)


def layered() -> tuple[list[N], Any]:
    above = N(
        "LayeredTexture", (6, "LayeredTexture::6", ""), [N("BlendModes", ([0],)), N("Alphas", ([1.0],))]
    )
    return painted_box(above), [*LINKS[:4], (6, 3, "DiffuseColor"), (5, 6)]


def moved() -> tuple[list[N], Any]:
    return [*painted_box()[:4], texture(5, "atlas.png", Scaling=(2.0, 2.0, 1.0))], LINKS


def shiny() -> tuple[list[N], Any]:
    return painted_box(), [*LINKS[:3], (4, 2), (5, 4, "ShininessExponent")]


def glossy() -> tuple[list[N], Any]:
    return painted_box(first=of_3ds_max(SPECULAR_GLOSSINESS)), LINKS[:4]


def unknown() -> tuple[list[N], Any]:
    return painted_box(first=material(3, "unknown")), LINKS[:4]


def colourless() -> tuple[list[N], Any]:
    return painted_box(first=of_3ds_max(PHYSICAL, roughness=0.4)), LINKS[:4]


@pytest.mark.parametrize(
    ("built", "fact"),
    [
        (glossy, "the material 3 has specular colour and glossiness"),
        (colourless, "the material 3 is of a kind whose colour"),
        (unknown, "the material 3 is of a kind whose colour"),
        (layered, "the colour of the material 3 is computed from several pictures"),
        (moved, "the colour of the material 3 has a texture that is moved"),
        (shiny, "the material 4 has a picture of its shininess"),
    ],
)
def test_what_is_not_read_of_an_fbx_is_refused(built: Any, fact: str) -> None:
    with pytest.raises(MeshError, match=f"{fact}.*paint: off"):
        facts(*built())


def test_texture_coordinates_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    objects = painted_box()
    objects[0] = box_geometry(1, coordinates("map1", [float("nan")] * 48), sides=SIDES)
    with pytest.raises(MeshError, match="'box': its texture coordinates do not fit its corners"):
        facts(objects)


def test_a_missing_picture_of_an_fbx_is_named_with_its_remedy(tmp_path: Path) -> None:
    from flowsculpt.pipeline.plugins.authoring.shot_templates import model_template

    model = write(tmp_path / "box.fbx", painted_box(name="..\\textures\\atlas.png"))
    with pytest.raises(MissingInputError, match=r"a\.yaml:3:\d+: .*textures\\atlas\.png.*Copy it"):
        shot_of(model)
    assert "paint" not in model_template(model, "box.fbx").subject
    picture(tmp_path / "atlas.png")  # paths of other machines end beside the model
    template = model_template(model, "box.fbx")
    assert ", paint: on}" in template.subject and template.look == "model"
    assert {path.name for path, _ in shot_of(model).files} == {"box.fbx", "atlas.png"}
