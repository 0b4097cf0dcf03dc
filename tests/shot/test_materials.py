"""Measures, pictures and Mitsuba's materials in shot files: what can be said, and how mistakes are told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.shot import Shot, read_shot
from flowsculpt.render.base.serialise import to_plain
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.measured_colours import Measure
from flowsculpt.render.scene.texture_projection import TextureProjection
from tests.needed_plugins import needs_plugins

HEAD = "title: T\nframes: 1-24\nsubject: %s\nresample: off\nlook: %s\n"
BOX = "{solid: box}"
GOLD = "type: roughconductor, material: Au, alpha: 0.1"


def shot_of(folder: Path, look: str, subject: str = BOX) -> Shot:
    return read_shot(folder / "a.yaml", HEAD % (subject, look))


def told(folder: Path, look: str, subject: str = BOX) -> str:
    with pytest.raises(ShotError) as error:
        shot_of(folder, look, subject)
    return str(error.value).replace(f"{folder}/", "")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a picture."""
    write(tmp_path / "a.png", 0.5)
    return tmp_path


def write(path: Path, value: float) -> None:
    out = oiio.ImageOutput.create(str(path))
    out.open(str(path), oiio.ImageSpec(4, 4, 3, "uint8"))
    out.write_image(np.full((4, 4, 3), value, np.float32))
    out.close()


def test_a_measure_takes_the_place_of_colour_and_pattern(tmp_path: Path) -> None:
    assert shot_of(tmp_path, "speed").picture.look.measure == Measure("speed")
    look = shot_of(tmp_path, "{material: marble, measure: {area: {range: [0.5, 2]}}}").picture.look
    assert (look.measure, look.pigment) == (Measure("area", None, 0.5, 2.0), None)
    assert shot_of(tmp_path, "{material: strain, colour: [1, 0, 0]}").picture.look.measure is None


def test_pictures_are_named_beside_the_shot(folder: Path) -> None:
    said = (
        "{material: glaze, colour: {file: a.png, space: linear}, roughness: a.png, relief: {file: a.png}, "
        "projection: {kind: cylindrical, axis: x, scale: 3, repeats: 2, turn: 90, offset: [0.5, 0]}}"
    )
    look = shot_of(folder, said).picture.look
    assert look.colour_texture is not None and look.roughness_texture is not None and look.relief is not None
    assert look.colour_texture.pixels() == pytest.approx(np.full((4, 4, 3), 0.5), abs=0.01)
    assert look.projection == TextureProjection(
        "cylindrical", (1.0, 0.0, 0.0), scale=3.0, repeats=2, turn=np.pi / 2, offset=(0.5, 0.0)
    )
    assert look.roughness == LOOKS["glaze"].roughness


def test_what_a_picture_holds_decides_and_not_its_name(folder: Path) -> None:
    before = to_plain(shot_of(folder, "{material: clay, colour: a.png}").picture.look)
    (folder / "b.png").write_bytes((folder / "a.png").read_bytes())
    assert to_plain(shot_of(folder, "{material: clay, colour: b.png}").picture.look) == before
    write(folder / "b.png", 0.7)
    shot = shot_of(folder, "{material: clay, colour: b.png}")
    assert to_plain(shot.picture.look) != before
    assert [path.name for path, _ in shot.files] == ["b.png"]


def test_a_material_of_mitsuba_is_written_out_with_what_it_holds(folder: Path) -> None:
    said = (
        "{bsdf: {type: bumpmap, scale: 0.1, relief: {type: bitmap, filename: a.png, raw: true}, "
        "body: {type: principled, base_color: {type: bitmap, filename: a.png}, roughness: 0.3}}}"
    )
    look = shot_of(folder, said).picture.look
    assert look.bsdf is not None and look.model == "bsdf" and not look.is_clear
    assert sorted(str(file.space) for file in look.bsdf.files) == ["None", "data"]
    assert "a.png" not in str(to_plain(look)) and look.bsdf.files[0].digest in str(to_plain(look))


@pytest.mark.parametrize(
    ("look", "said"),
    [
        (
            "{material: clay, measure: {sped: {}}}",
            "look.measure.sped: unknown name. Did you",
        ),
        (
            "{material: clay, measure: {}}",
            "a measure is one of speed, stretch, area, values, and this has none",
        ),
        ("{material: clay, measure: {speed: {colours: virids}}}", "Did you mean 'viridis'?"),
        ("{material: clay, measure: {speed: {range: [2, 1]}}}", "the first is below the second"),
        (
            "{material: clay, measure: {values: {range: [-2%, 98%]}}}",
            "range.0: '-2%' is not a percentage from 0% to 100%, such as 2%",
        ),
        ("{material: clay, colour: [1, 1, 1], measure: {area: {}}}", "look has both colour and measure"),
        ("{material: glass, measure: {area: {}}}", "look has a measure, and light goes through glass"),
        ("{material: clay, colour: b.png}", "a.yaml:5:24: file b.png is not there"),
        ("{material: clay, colour: {file: a.png, space: srbg}}", "Did you mean 'srgb'?"),
        ("{material: glass, colour: a.png}", "look has a picture, and light goes through glass"),
        ("{material: clay, roughness: a.png}", "a.yaml:5:1: look has one roughness"),
        ("{material: honey, wear: {dust: 0.5}}", "a.yaml:5:1: look shows no wear; those of clay"),
        ("{material: speed, roughness: a.png}", "look has a measure, and pictures from files beside it"),
        ("{material: clay, projection: {kind: box}}", "look has a projection and no picture to project"),
        (
            "{material: clay, colour: a.png, projection: {kind: box, axis: y}}",
            "axis, which box does not use",
        ),
        ("{material: clay, colour: a.png, projection: {kind: planr}}", "Did you mean 'planar'?"),
        ("{colour: [1, 1, 1]}", "look names no material. Add material: clay, or bsdf."),
        (f"{{material: clay, bsdf: {{{GOLD}}}}}", "look has both material and bsdf"),
        (f"{{colour: [1, 1, 1], bsdf: {{{GOLD}}}}}", "look has colour beside bsdf"),
        ("{bsdf: {alpha: 2}}", "a.yaml:5:8: a material of Mitsuba is a mapping with a type"),
        (
            "{bsdf: {type: roughcondctor}}",
            "a.yaml:5:15: 'roughcondctor' is not a material of Mitsuba. Did you mean",
        ),
        (
            "{bsdf: {type: diffuse, reflectence: 0.5}}",
            "a.yaml:5:30: reflectence is not a parameter of diffuse. Did",
        ),
        ("{bsdf: {type: roughplastic, alpha: rough}}", "a.yaml:5:35: alpha must be a number."),
        ("{bsdf: {type: diffuse, reflectance: {type: bitmap, filename: b.png}}}", "file b.png is not there"),
        (
            "{bsdf: {type: diffuse, reflectance: {type: bitmp}}}",
            "'bitmp' is not a texture of Mitsuba. Did you mean",
        ),
        ("{bsdf: {type: diffuse, reflectance: {type: bitmap}}}", "bitmap names no file"),
        ("{bsdf: {type: blendbsdf, weight: 0.5, a: {type: diffuse}}}", "blendbsdf contains 1 materials"),
        ("{bsdf: {type: roughconductor, material: Auu}}", "Mitsuba does not take this material: "),
    ],
)
def test_mistakes_are_told_where_they_stand(look: str, said: str, folder: Path) -> None:
    found = told(folder, look)
    assert said in found and len(found.splitlines()) == 1 and found.startswith("a.yaml:5:")


@needs_plugins("points")
def test_a_cloud_has_a_speed_and_no_stretch(tmp_path: Path) -> None:
    cloud = "{cloud: {solid: icosphere}, radius: 0.05}"
    assert "which triangles have, and a cloud has none" in told(tmp_path, "strain", cloud)
    assert shot_of(tmp_path, "speed", cloud).picture.look.measure is not None
