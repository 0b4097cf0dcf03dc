"""A shot names a place, and replaces what it likes of its stage, lights and camera."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.shot import Shot, read_shot
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_sets import SETS

HEAD = "title: A\nframes: 1-2\nsubject: {solid: box}\nresample: {max_edge_length: 0.5}\n"


def shot_with(text: str, folder: Path, defaults: str = "", settings: tuple[str, ...] = ()) -> Shot:
    (folder / "A.yaml").write_text(HEAD + text)
    (folder / "defaults.yaml").write_text(defaults or "rate: 24\n")
    return read_shot(folder / "A.yaml", settings=settings)


@pytest.mark.parametrize("name", SETS)
def test_every_set_is_a_shots_stage_lights_and_camera(name: str, tmp_path: Path) -> None:
    shown = shot_with(f"set: {name}\n", tmp_path).picture
    assert shown.stage.kind == SETS[name]["stage"]["kind"]
    assert shown.lights != LIGHTS["studio"] and (shown.lights.softboxes or shown.lights.daylight)
    assert shown.camera.at(0.0).azimuth == pytest.approx(math.radians(SETS[name]["camera"]["azimuth"]))


def test_a_shot_replaces_parts_of_its_set(tmp_path: Path) -> None:
    text = (
        "set: window\nstage: {wall_colour: [0.1, 0.2, 0.3]}\nlights: {exposure: 1}\ncamera: {azimuth: 50}\n"
    )
    shown, plain = shot_with(text, tmp_path).picture, shot_with("set: window\n", tmp_path).picture
    assert (shown.stage.kind, shown.stage.wall_colour) == ("window", (0.1, 0.2, 0.3))
    assert shown.lights.softboxes == plain.lights.softboxes and shown.lights.exposure == 1.0
    assert shown.camera.at(0.0).azimuth == pytest.approx(math.radians(50.0))
    assert shown.camera.at(0.0).elevation == plain.camera.at(0.0).elevation


@pytest.mark.parametrize(
    "text",
    [
        "stage: plinth\nlights: lacquer\ncamera: {position: [0, 1, 6], focal_length: 50}\n",
        "stage: {kind: plinth, round: true}\nlights: {rig: lacquer}\ncamera: {distance: 9}\n",
        "stage: none\nlights: daylight\ncamera: {projection: dome}\n",
        "lights: {sky: {zenith: 0.4}}\n",
    ],
)
def test_what_excludes_a_setting_of_the_set_takes_its_place(text: str, tmp_path: Path) -> None:
    shown = shot_with("set: corner\n" + text, tmp_path).picture
    if "stage" in text:
        assert shown.stage == shot_with(text, tmp_path).picture.stage
        assert shown.lights == shot_with(text, tmp_path).picture.lights
    else:
        assert shown.lights.softboxes and shown.lights.sky.zenith == (0.4, 0.4, 0.4)


def test_the_set_of_a_shot_is_over_the_defaults_and_that_of_the_defaults_below_them(tmp_path: Path) -> None:
    defaults = "lights: {rig: gallery, exposure: 2}\nstage: plinth\ncamera: {elevation: 33}\n"
    own = shot_with("set: table\n", tmp_path, defaults).picture
    assert own.stage.kind == "table" and own.lights.exposure == 0.0
    by_option = shot_with("", tmp_path, defaults, ("set=table",)).picture
    assert by_option == own
    shown = shot_with("", tmp_path, defaults + "set: table\n").picture
    assert shown.stage.kind == "plinth" and shown.lights.exposure == 2.0
    assert shown.camera.at(0.0).elevation == pytest.approx(math.radians(33.0))


def test_a_show_names_places_of_its_own(tmp_path: Path) -> None:
    defaults = "sets:\n  yard: {stage: ground, lights: {sun: {elevation: 12}}, camera: {elevation: 3}}\n"
    shown = shot_with("set: yard\n", tmp_path, defaults).picture
    assert shown.stage.kind == "ground" and shown.lights.daylight
    assert shown.lights.daylight.elevation == pytest.approx(math.radians(12.0))


def test_an_unknown_set_is_refused_with_the_one_that_is_meant(tmp_path: Path) -> None:
    with pytest.raises(ShotError, match=r"A.yaml:5:\d: set 'windw' is not a set. Did you mean 'window'"):
        shot_with("set: windw\n", tmp_path)
