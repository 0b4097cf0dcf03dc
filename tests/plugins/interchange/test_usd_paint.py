"""The paint of USD stages: texture coordinates, vertex colours, materials and pictures."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from pxr import UsdUtils

from flowsculpt.pipeline.animation import animate, material_of
from flowsculpt.pipeline.errors import MeshError, MissingInputError
from flowsculpt.pipeline.mesh.mesh_formats import ScenePart
from flowsculpt.pipeline.mesh.read import ModelFile
from flowsculpt.pipeline.plugins.authoring.shot_templates import model_template
from flowsculpt.pipeline.plugins.interchange.usd_files import USD_PAINT
from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.scene.materials import Diffuse, Painted, Satin
from flowsculpt.render.scene.painted_faces import PaintedFaces
from tests.plugins.interchange.test_model_paint import SIDES, on_box, paint_of, picture, shot_of

POINTS = ", ".join(f"({x}, {y}, {z})" for x in (-1, 1) for y in (-1, 1) for z in (-1, 1))
CORNERS = ", ".join(str(corner) for side in SIDES for corner in side)
ATLAS = ", ".join(f"({u}, {(k + v) / 6})" for k in range(6) for u, v in ((0, 0), (1, 0), (1, 1), (0, 1)))
COORDINATES = f'texCoord2f[] primvars:st = [{ATLAS}] (interpolation = "faceVarying")'
BOX = """
    def Mesh "box" (prepend apiSchemas = ["MaterialBindingAPI"])
    {{
        uniform token subdivisionScheme = "none"
        point3f[] points = [{points}]
        int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
        int[] faceVertexIndices = [{corners}]
        {more}
    }}
"""
PICTURE = """
        def Shader "picture"
        {
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @atlas.png@
            float2 inputs:st.connect = </world/one/place.outputs:result>
            MORE
            float3 outputs:rgb
            float outputs:g
        }
        def Shader "place"
        {
            uniform token info:id = "UsdPrimvarReader_float2"
            string inputs:varname = "st"
            float2 outputs:result
        }
"""
BIND = "rel material:binding = </world/one>"


def box(*more: str) -> str:
    return BOX.format(points=POINTS, corners=CORNERS, more="\n        ".join(more))


def material(name: str, *inputs: str, nodes: str = "", picture_more: str = "") -> str:
    lines = "\n            ".join(inputs)
    return f"""
    def Material "{name}"
    {{
        token outputs:surface.connect = </world/{name}/surface.outputs:surface>
        def Shader "surface"
        {{
            uniform token info:id = "UsdPreviewSurface"
            {lines}
            token outputs:surface
        }}
        {nodes.replace("MORE", picture_more)}
    }}
"""


def write(folder: Path, *prims: str, name: str = "box.usda") -> Path:
    head = '#usda 1.0\n(defaultPrim = "world"\n upAxis = "Y")\ndef Xform "world"\n{'
    (folder / name).write_text("\n".join([head, *prims, "}"]).replace(" }", "\n}"))
    return folder / name


COLOUR = "color3f inputs:diffuseColor.connect = </world/one/picture.outputs:rgb>"


def painted_box(folder: Path, *inputs: str, picture_more: str = "", bind: str = BIND) -> Path:
    """A box with a picture on five sides and a red material on the last, by a subset."""
    picture(folder / "atlas.png")
    subset = (
        'def GeomSubset "last" (prepend apiSchemas = ["MaterialBindingAPI"]) { uniform token elementType = '
        '"face"\n uniform token familyName = "materialBind"\n int[] indices = [5]\n rel material:binding = '
        "</world/red> }"
    )
    one = material("one", *(inputs or (COLOUR,)), nodes=PICTURE, picture_more=picture_more)
    red = material("red", "color3f inputs:diffuseColor = (1, 0, 0)", "float inputs:roughness = 0.25")
    return write(folder, box(COORDINATES, bind, subset), one, red)


def test_corners_of_a_stage_take_the_texture_coordinates_of_their_place_at_rest(tmp_path: Path) -> None:
    shot = shot_of(painted_box(tmp_path), last=4)
    for frame in animate(shot):
        paint, rest = paint_of(shot, frame), material_of(frame.mesh)
        assert paint.coordinates == pytest.approx(on_box(rest, frame.mesh.faces), abs=1e-6)
        middle = rest[frame.mesh.faces].mean(axis=1)
        is_last = (np.abs(middle).argmax(axis=1) == 2) & (middle[:, 2] > 0)
        red = 1 if paint.materials[~is_last].max() == 0 else 0
        assert np.array_equal(paint.materials == red, is_last)
    assert len(frame.mesh.vertices) > 300 and len(frame.mesh.seams)
    look = shot.picture.look
    assert isinstance(look, Painted) and red == 1
    atlas, last = look.parts
    assert isinstance(atlas, Satin) and atlas.roughness == 0.5 and atlas.colour_texture is not None
    linear = ((np.array([0.2, 0.4, 0.6]) + 0.055) / 1.055) ** 2.4
    assert atlas.colour_texture.pixels()[0, 0] == pytest.approx(linear, abs=2e-3)
    assert isinstance(last, Satin) and (last.colour, last.roughness) == ((1.0, 0.0, 0.0), 0.25)
    assert {path.name for path, _ in shot.files} == {"box.usda", "atlas.png"}


def test_a_new_shot_of_a_painted_stage_shows_its_paint(tmp_path: Path) -> None:

    template = model_template(painted_box(tmp_path), "box.usda")
    assert template.look == "model" and "paint: on" in template.subject


@pytest.mark.parametrize("hand", ["rightHanded", "leftHanded"])
def test_mirrors_turned_faces_holes_and_instances_keep_their_paint(tmp_path: Path, hand: str) -> None:
    picture(tmp_path / "atlas.png")
    one = material("one", COLOUR, nodes=PICTURE)
    shape = 'class "shape"\n{' + box(COORDINATES, f'uniform token orientation = "{hand}"',
                                     "int[] holeIndices = [2]") + "}"  # fmt: skip
    placed = (
        'def Xform "{}" (instanceable = true\n prepend references = </world/shape>\n prepend apiSchemas = '
        '["MaterialBindingAPI"]) {{ double3 xformOp:translate = ({}, 0, 0)\n float3 xformOp:scale = ({}, 1, '
        '1)\n uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]\n {} }}'
    )
    places = [placed.format("left", -5, 1, BIND), placed.format("right", 5, -1, "")]
    paint = USD_PAINT.paint(write(tmp_path, shape, *places, one))
    assert len(paint.corners) == 20  # type: ignore[attr-defined]
    corners = paint.points[paint.corners]  # type: ignore[attr-defined]
    is_left = (corners[..., 0] < 0).all(axis=1)
    own = np.where(is_left[:, None, None], corners, corners * (-1, 1, 1)) + np.array((5, 0, 0))
    faces = np.arange(60).reshape(-1, 3)
    expected = on_box(own.reshape(-1, 3), faces)
    assert paint.coordinates == pytest.approx(expected, abs=1e-6)  # type: ignore[attr-defined]
    turn = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    middles = corners.mean(axis=1) - np.where(is_left, -5, 5)[:, None] * (1, 0, 0)
    outwards = 1 if hand == "rightHanded" else -1
    assert (outwards * np.einsum("fx,fx->f", turn, middles) > 0).all()
    materials, _, _ = USD_PAINT.materials(tmp_path / "box.usda")
    assert len(materials) == 2 and len(np.unique(paint.materials[is_left])) == 1  # type: ignore[attr-defined]
    assert [each.colour_texture is not None for each in materials] == [True, False]


@pytest.mark.parametrize(
    ("values", "shown"),
    [
        ("[(1, 0.5, 0)] (interpolation = \"constant\")", {(1.0, 0.5, 0.0)}),
        ("[(1, 0, 0), (0, 1, 0)] (interpolation = \"uniform\")\n int[] primvars:displayColor:indices = "
         "[0, 0, 0, 0, 0, 1]", {(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)}),
        (f"[{', '.join(['(0.25, 0.5, 1)'] * 8)}] (interpolation = \"vertex\")", {(0.25, 0.5, 1.0)}),
    ],
    ids=["constant", "uniform", "vertex"],
)  # fmt: skip
def test_display_colours_are_vertex_colours(
    tmp_path: Path, values: str, shown: set[tuple[float, ...]]
) -> None:
    path = write(tmp_path, box(f"color3f[] primvars:displayColor = {values}"))
    (bare,), files, _ = USD_PAINT.materials(path)
    assert isinstance(bare, Diffuse) and bare.colour_from == PaintedFaces.COLOURS and not files
    colours = USD_PAINT.paint(path).colours  # type: ignore[attr-defined]
    assert {tuple(row) for row in colours.reshape(-1, 3).tolist()} == shown


def test_a_material_that_reads_a_primvar_is_coloured_by_it_and_others_are_not(tmp_path: Path) -> None:
    dyed = "color3f inputs:diffuseColor.connect = </world/one/dye.outputs:result>"
    dye = ('def Shader "dye" { uniform token info:id = "UsdPrimvarReader_float3"\n string inputs:varname = '
           '"tint"\n float3 outputs:result }')  # fmt: skip
    tint = 'color3f[] primvars:tint = [(0, 0, 1)] (interpolation = "constant")'
    red = material("red", "color3f inputs:diffuseColor = (1, 0, 0)")
    second = box("rel material:binding = </world/red>").replace('"box"', '"second"')
    path = write(tmp_path, box(tint, BIND), second, material("one", dyed, nodes=dye), red)
    first, other = USD_PAINT.materials(path)[0]
    assert (first.colour_from, other.colour_from) == (PaintedFaces.COLOURS, None)
    paint = USD_PAINT.paint(path)
    for number, colour in enumerate(((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))):
        shown = paint.colours[paint.materials == number]  # type: ignore[attr-defined]
        assert (shown == colour).all() and len(shown) == 12


def test_maps_of_numbers_and_normals_and_transforms_are_read(tmp_path: Path) -> None:
    turned = PICTURE.replace("place.outputs", "turned.outputs", 1) + """
        def Shader "turned" { uniform token info:id = "UsdTransform2d"
            float2 inputs:in.connect = </world/one/place.outputs:result>
            float inputs:rotation = 90
            float2 inputs:scale = (2, 1)
            float2 inputs:translation = (0.5, 0)
            float2 outputs:result }
"""  # fmt: skip
    rough = "float inputs:roughness.connect = </world/one/picture.outputs:g>"
    bumps = "normal3f inputs:normal.connect = </world/one/picture.outputs:rgb>"
    one = material("one", rough, bumps, "float inputs:metallic = 0.75", nodes=turned)
    picture(tmp_path / "atlas.png")
    path = write(tmp_path, box(COORDINATES, BIND), one)
    (found,), _, _ = USD_PAINT.materials(path)
    assert isinstance(found, Satin) and found.metallic == 0.75 and found.colour == (0.18,) * 3
    assert found.roughness_texture is not None and found.normal_texture is not None
    assert found.roughness_texture.numbers()[0, 0, 0] == pytest.approx(0.4, abs=3e-3)
    assert found.normal_texture.normals()[0, 0] == pytest.approx((-0.6, -0.2, 0.2), abs=8e-3)
    paint = USD_PAINT.paint(path)
    corners = paint.points[paint.corners]  # type: ignore[attr-defined]
    u, v = np.moveaxis(on_box(corners.reshape(-1, 3), np.arange(36).reshape(-1, 3)), 2, 0)
    shown = paint.coordinates  # type: ignore[attr-defined]
    assert shown == pytest.approx(np.stack([0.5 - v, 2 * u], axis=2), abs=1e-6)


def test_maps_of_light_of_a_stage_are_not_opened(tmp_path: Path) -> None:
    light = "color3f inputs:emissiveColor.connect = </world/one/picture.outputs:rgb>"
    more = "float inputs:occlusion.connect = </world/one/picture.outputs:g>", "float inputs:clearcoat = 1"
    plain = "color3f inputs:diffuseColor = (0, 0, 1)"
    path = write(tmp_path, box(COORDINATES, BIND), material("one", plain, light, *more, nodes=PICTURE))
    (found,), files, _ = USD_PAINT.materials(path)
    assert found.colour == (0.0, 0.0, 1.0) and not files, "no picture is there"


def test_a_picture_within_a_package_is_read_and_named_where_it_is_damaged(tmp_path: Path) -> None:
    path = painted_box(tmp_path)
    assert UsdUtils.CreateNewUsdzPackage(str(path), str(tmp_path / "box.usdz"))
    content = (tmp_path / "atlas.png").read_bytes()
    (atlas, _), files, _ = USD_PAINT.materials(tmp_path / "box.usdz")
    assert atlas.colour_texture is not None and not files
    assert Path(atlas.colour_texture.path).read_bytes() == content
    (tmp_path / "atlas.png").write_bytes(content[:60] + b"broken")
    (tmp_path / "box.usdz").unlink()
    assert UsdUtils.CreateNewUsdzPackage(str(path), str(tmp_path / "box.usdz"))
    with pytest.raises(BadInputError, match=re.escape(f"{tmp_path / 'box.usdz'}: its picture ") + ".*png"):
        USD_PAINT.materials(tmp_path / "box.usdz")


def test_a_part_of_a_stage_has_the_paint_of_that_part(tmp_path: Path) -> None:
    second = box("rel material:binding = </world/red>").replace('"box"', '"second"')
    one = material("one", "color3f inputs:diffuseColor = (0, 1, 0)")
    red = material("red", "color3f inputs:diffuseColor = (1, 0, 0)")
    path = write(tmp_path, box(BIND), second, one, red)
    (found,), _, _ = ModelFile(path, ScenePart("/world/second")).materials()
    assert found.colour == (1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("inputs", "more", "words"),
    [
        ((COLOUR,), "float4 inputs:bias = (0.5, 0, 0, 0)", "scale, bias"),
        (("float inputs:roughness.connect = </world/one/picture.outputs:g>",),
         'token inputs:sourceColorSpace = "sRGB"', "colour space"),
        (("color3f inputs:diffuseColor.connect = </world/one/place.outputs:result>",), "", "is computed by"),
        (("int inputs:useSpecularWorkflow = 1", "color3f inputs:specularColor = (0.9, 0.8, 0.7)"), "",
         "specular colour"),
    ],
    ids=["bias", "space", "node", "specular"],
)  # fmt: skip
def test_materials_that_would_be_shown_wrong_are_refused(
    tmp_path: Path, inputs: tuple[str, ...], more: str, words: str
) -> None:
    path = painted_box(tmp_path, *inputs, picture_more=more)
    with pytest.raises(MeshError, match=words) as caught:
        USD_PAINT.materials(path)
    assert "/world/one" in str(caught.value) and "\n" not in str(caught.value)


def test_a_missing_picture_and_missing_coordinates_are_named(tmp_path: Path) -> None:
    path = painted_box(tmp_path)
    (tmp_path / "atlas.png").unlink()
    with pytest.raises(MissingInputError, match=r"its texture .*atlas\.png, which is not there"):
        USD_PAINT.materials(path)
    path.write_text(path.read_text().replace("primvars:st", "primvars:other"))
    with pytest.raises(MeshError, match="does not have the texture coordinates st"):
        USD_PAINT.paint(path)


def test_a_stage_with_materials_of_other_renderers_is_refused(tmp_path: Path) -> None:
    path = painted_box(tmp_path)
    path.write_text(path.read_text().replace("UsdPreviewSurface", "arnold:standard_surface"))
    with pytest.raises(MeshError, match="/world/one is not a UsdPreviewSurface"):
        USD_PAINT.materials(path)
