"""Lights and stages in shot files: what can be said, and how what is wrong is told."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.shot import Shot, read_shot
from flowsculpt.render.base.serialise import to_plain
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import STAGES, Stage
from flowsculpt.render.scene.sky import Daylight, sun_position

HEAD = "title: T\nframes: 1-24\nsubject: {solid: box}\nresample: off\n"
BOX = "radiance: 9, position: [0, 4, 4]"


def shot_of(folder: Path, said: str) -> Shot:
    return read_shot(folder / "a.yaml", HEAD + said + "\n")


def told(folder: Path, said: str) -> str:
    with pytest.raises(ShotError) as error:
        shot_of(folder, said)
    return str(error.value).replace(f"{folder}/", "")


def write_map(path: Path, height: int = 8, spoilt: bool = False) -> None:
    pixels = np.full((height, 16, 3), 0.5, np.float32)
    if spoilt:
        pixels[1, 2] = math.nan
    spec = oiio.ImageSpec(16, height, 3, oiio.FLOAT)
    spec.attribute("DateTime", "")  # by default the time of writing: equal pixels, two seconds, two files
    out = oiio.ImageOutput.create(str(path))
    out.open(str(path), spec)
    out.write_image(pixels)
    out.close()


@pytest.mark.parametrize("name", LIGHTS)
def test_every_rig_can_be_named_and_spelt_out(name: str, tmp_path: Path) -> None:
    assert shot_of(tmp_path, f"lights: {name}").picture.lights == LIGHTS[name]
    assert shot_of(tmp_path, f"lights: {{rig: {name}}}").picture.lights == LIGHTS[name]


@pytest.mark.parametrize("name", STAGES)
def test_every_stage_can_be_named_and_spelt_out(name: str, tmp_path: Path) -> None:
    assert shot_of(tmp_path, f"stage: {name}").picture.stage == STAGES[name]
    assert shot_of(tmp_path, f"stage: {{kind: {name}}}").picture.stage == STAGES[name]


def test_a_rig_is_turned_dimmed_and_exposed(tmp_path: Path) -> None:
    said = "lights: {rig: three_point, exposure: 0.5, turn: 90, intensity: {key: 1.5}}"
    lights = shot_of(tmp_path, said).picture.lights
    plain = LIGHTS["three_point"].softboxes
    assert lights.exposure == 0.5
    assert lights.softboxes[0].radiance == pytest.approx([1.5 * part for part in plain[0].radiance])
    assert lights.softboxes[1].radiance == plain[1].radiance
    x, y, z = plain[0].position
    assert lights.softboxes[0].position == pytest.approx((z, y, -x))


def test_one_number_dims_all_lights(tmp_path: Path) -> None:
    said = "lights: {intensity: 2, softboxes: [{position: [0, 4, 4], radiance: 10}], sky: {zenith: 0.1}}"
    lights = shot_of(tmp_path, said).picture.lights
    assert [box.radiance for box in lights.softboxes] == [(20.0, 20.0, 20.0)]
    assert lights.sky.zenith == lights.sky.nadir == (0.2, 0.2, 0.2)


def test_lamps_written_out_stand_alone_or_beside_a_rig(tmp_path: Path) -> None:
    own = "softboxes: [{position: [0, 4, 4], radiance: [9, 8, 7], width: 2, target: [0, 0, 0]}]"
    alone = shot_of(tmp_path, f"lights: {{{own}}}").picture.lights
    beside = shot_of(tmp_path, f"lights: {{rig: gallery, {own}}}").picture.lights
    assert len(alone.softboxes) == 1 and alone.sky.zenith == (0.0, 0.0, 0.0)
    assert beside.softboxes == LIGHTS["gallery"].softboxes + alone.softboxes
    assert beside.sky == LIGHTS["gallery"].sky


def test_the_sun_stands_by_the_hour_or_by_angles(tmp_path: Path) -> None:
    by_hour = shot_of(tmp_path, "lights: {sun: {time: 17.5, latitude: 48, day: 172, turbidity: 4}}")
    day = by_hour.picture.lights.daylight
    elevation, clockwise = sun_position(17.5, math.radians(48), 172)
    assert day is not None and (day.elevation, day.turbidity) == (elevation, 4.0)
    assert math.cos(day.azimuth) == pytest.approx(-math.cos(clockwise))  # north lies behind the subject
    assert math.sin(day.azimuth) == pytest.approx(math.sin(clockwise))  # and east to the right
    angles = shot_of(tmp_path, "lights: {sun: {elevation: 30, azimuth: 40, width: 2, visible: false}}")
    assert angles.picture.lights.daylight == Daylight(
        math.radians(30), math.radians(40), width=math.radians(2), visible=False
    )
    assert shot_of(tmp_path, "lights: {sun: {}}").picture.lights == LIGHTS["daylight"]


def test_a_plinth_has_a_colour_of_its_own_which_other_stages_refuse(tmp_path: Path) -> None:
    stage = shot_of(tmp_path, "stage: {kind: plinth, plinth_colour: [0.02, 0.02, 0.03]}").picture.stage
    assert stage == Stage("plinth", plinth_colour=(0.02, 0.02, 0.03))
    assert "plinth_colour" in to_plain(stage)
    assert "plinth_colour" not in to_plain(Stage("plinth")), "keys of shots without it stay as they are"
    with pytest.raises(ShotError, match="stage has plinth_colour, which ground does not use"):
        shot_of(tmp_path, "stage: {kind: ground, plinth_colour: [1, 1, 1]}")


def test_an_intensity_may_be_a_colour(tmp_path: Path) -> None:
    said = "lights: {rig: studio, intensity: {key: [1, 0.5, 0.25], sky: '#ff0000', rim: 2}}"
    lights = shot_of(tmp_path, said).picture.lights
    before = {box.name: box.radiance for box in LIGHTS["studio"].softboxes}
    after = {box.name: box.radiance for box in lights.softboxes}
    assert after["key"] == pytest.approx([a * b for a, b in zip(before["key"], (1, 0.5, 0.25), strict=True)])
    assert after["rim"] == pytest.approx([2 * part for part in before["rim"]])
    assert lights.sky.horizon[0] > 0.0 and lights.sky.horizon[1:] == (0.0, 0.0)
    with pytest.raises(ShotError, match="intensity of sun is a colour; daylight and an hdri keep theirs"):
        shot_of(tmp_path, "lights: {rig: daylight, intensity: {sun: [1, 0, 0]}}")


def test_a_wall_has_colours_of_its_own_which_ground_refuses(tmp_path: Path) -> None:
    written = "{colour: [0, 0, 0.1], wall_colour: '#ffffff', halo_colour: [0.5, 0.1, 0], halo_size: 3}"
    stage = shot_of(tmp_path, f"stage: {written}").picture.stage
    assert stage == Stage(colour=(0, 0, 0.1), wall_colour=(1, 1, 1), halo_colour=(0.5, 0.1, 0), halo_size=3)
    assert (
        to_plain(Stage()).keys().isdisjoint({"wall_colour", "halo_colour", "halo_size", "plinth_roughness"})
    )
    with pytest.raises(ShotError, match="stage has wall_colour, which ground does not use"):
        shot_of(tmp_path, "stage: {kind: ground, wall_colour: [1, 1, 1]}")
    with pytest.raises(ShotError, match="halo_size without halo_colour"):
        shot_of(tmp_path, "stage: {halo_size: 3}")


def test_the_horizon_of_ground_fades_over_degrees(tmp_path: Path) -> None:
    stage = shot_of(tmp_path, "stage: {kind: ground, horizon_fade: 3}").picture.stage
    assert stage == Stage("ground", horizon_fade=math.radians(3.0))
    assert "horizon_fade" not in to_plain(Stage("ground"))
    with pytest.raises(ShotError, match="stage has horizon_fade, which cyclorama does not use"):
        shot_of(tmp_path, "stage: {horizon_fade: 3}")
    with pytest.raises(ShotError, match="and a shadow catcher, which is not seen"):
        shot_of(tmp_path, "stage: {kind: ground, horizon_fade: 3, shadow_catcher: true}")


def test_a_stage_says_how_its_floor_and_its_plinth_are(tmp_path: Path) -> None:
    said = "stage: {kind: plinth, colour: [0.1, 0.2, 0.3], width: 2, height: 1, round: true, roughness: 0.1}"
    assert shot_of(tmp_path, said).picture.stage == Stage(
        "plinth", (0.1, 0.2, 0.3), width=2.0, height=1.0, round=True, roughness=0.1
    )


@pytest.mark.parametrize(
    "look", ["chrome", "brushed", "smoke", "{bsdf: {type: roughconductor, material: Au}}"]
)
def test_a_metal_or_smoke_stands_out_from_a_stage_without_a_colour(look: str, tmp_path: Path) -> None:
    def colour_of(stage: str) -> tuple[float, float, float]:
        return shot_of(tmp_path, f"look: {look}\nstage: {stage}").picture.stage.colour

    assert max(colour_of("cyclorama")) < 0.4 * max(STAGES["cyclorama"].colour)
    assert colour_of("{kind: plinth, round: true}") == colour_of("cyclorama")
    assert colour_of("{kind: cyclorama, colour: [0.4, 0.4, 0.4]}") == (0.4, 0.4, 0.4)
    assert colour_of("turntable") == STAGES["turntable"].colour, "a chart needs its grey"


def test_the_sun_alone_is_hard_light(tmp_path: Path) -> None:
    lights = shot_of(tmp_path, "lights: {sun: {elevation: 40}, intensity: {sky: 0}}").picture.lights
    assert lights.daylight is not None and (lights.daylight.sun, lights.daylight.sky) == (1.0, 0.0)


def test_a_map_is_known_by_its_content(tmp_path: Path) -> None:
    keys = []
    for name in ("one.exr", "other.exr", "third.exr"):
        write_map(tmp_path / name, 8)
        if name == "third.exr":
            (tmp_path / name).write_bytes((tmp_path / name).read_bytes() + b" ")
        shot = shot_of(tmp_path, f"lights: {{hdri: {name}, turn: 30, intensity: 2, visible: false}}")
        around = shot.picture.lights.environment
        assert around is not None and around.turn == pytest.approx(math.radians(30))
        assert (around.intensity, around.visible) == (2.0, False)
        assert shot.files == ((tmp_path / name, around.digest),)
        keys.append(to_plain(shot.picture.lights))
    assert keys[0] == keys[1] != keys[2]


def test_lights_and_stage_move_no_vertex(tmp_path: Path) -> None:
    plain = shot_of(tmp_path, "")
    lit = shot_of(tmp_path, "lights: {sun: {time: 9}}\nstage: none")
    assert lit.motion == plain.motion and lit.picture != plain.picture


def test_each_light_is_a_group_unless_a_group_has_it(tmp_path: Path) -> None:
    groups = shot_of(
        tmp_path, "lights: gallery\nlight_groups: {sides: [left, right], roof: top}"
    ).picture.lights
    assert {g.name: g.lights for g in groups.groups} == {
        "sides": ("left", "right"), "roof": ("top",), "front": ("front",), "sky": ("sky",)
    }  # fmt: skip
    each = shot_of(tmp_path, "light_groups: each").picture.lights
    assert [g.name for g in each.groups] == ["key", "rim", "back", "sky"]
    assert not shot_of(tmp_path, "light_groups: off").picture.lights.groups


@pytest.mark.parametrize(
    "lights", ["daylight", "{sun: {}}", "{rig: daylight, turn: 9}", "{sky: {zenith: 1, visible: true}}"]
)
def test_a_visible_sky_is_two_groups(lights: str, tmp_path: Path) -> None:
    each = shot_of(tmp_path, f"lights: {lights}\nlight_groups: each").picture.lights
    assert {"sky", "background"} <= {group.name for group in each.groups}
    one = shot_of(tmp_path, f"lights: {lights}\nlight_groups: {{far: [sky, background]}}").picture.lights
    assert one.groups[0].lights == ("sky", "background")
    assert not {"sky", "background"} & {group.name for group in one.groups}


def test_softboxes_of_a_shot_have_names(tmp_path: Path) -> None:
    said = f"lights: {{softboxes: [{{{BOX}}}, {{{BOX}, name: lamp}}], intensity: {{softbox1: 2, lamp: 3}}}}"
    lights = shot_of(tmp_path, said + "\nlight_groups: {all: [softbox1, lamp]}").picture.lights
    assert [(box.name, box.radiance[0]) for box in lights.softboxes] == [("softbox1", 18.0), ("lamp", 27.0)]
    assert [group.name for group in lights.groups] == ["all"]


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ("lights: three_pint", "a.yaml:5:1: lights: 'three_pint' is not a light rig. Did you mean 'three_po"),
        ("lights: {rig: gallry}", "a.yaml:5:10: lights.rig: 'gallry' is not a light rig. Did you mean"),
        ("lights: {tun: 3}", "a.yaml:5:10: lights.tun: unknown name. Did you mean 'turn'?"),
        ("lights: {intensity: {keyy: 2}}", "a.yaml:5:22: keyy is not a light here. Did you mean 'key'?"),
        ("lights: {sun: {}, intensity: {key: 2}}", "key is not a light here. There are: sun, sky."),
        ("lights: {intensity: -1}", "lights.intensity: -1 is out of range; it must be at least 0"),
        ("lights: {softboxes: []}", "it must have at least 1 item"),
        (f"lights: {{softboxes: [{{{BOX}, width: 0}}]}}", "width: 0 is out of range; it must be above 0"),
        (f"lights: {{softboxes: [{{{BOX}, target: [0, 4, 4]}}]}}", "5:22: a softbox stands at its own"),
        ("lights: {softboxes: [{radiance: [9, -1, 9], position: [0, 4, 4]}]}",
         "-1 is out of range; it must be at"),
        ("lights: {softboxes: [{radiance: 9}]}", "position: missing"),
        ("lights: {softboxes: [{radiance: 9, position: [0, .nan, 4]}]}", "a finite number"),
        ("lights: {sun: {elevation: -5}}", "lights.sun.elevation: -5 is out of range; it must be above 0"),
        ("lights: {sun: {time: 23}}", "below the horizon at 23 h on day 172 at latitude 48°; it must be "
         "above. Write a time from 4.25 to 19.75."),
        ("lights: {sun: {time: 12, latitude: -80}}", "It does not rise on that day"),
        ("lights: {sun: {time: 12, azimuth: 3}}", "sun has azimuth beside time"),
        ("lights: {sun: {latitude: 3}}", "sun has latitude without time"),
        ("lights: {sun: {turbidity: 0}}", "turbidity: 0 is out of range; it must be at least 1"),
        ("lights: {sun: {}, sky: {zenith: 1}}", "lights has both sun and sky"),
        ("light_groups: {warm: [key, rimm]}", "a.yaml:5:28: rimm is not a light here. Did you mean 'rim'?"),
        ("light_groups: {warm: sun}",
         "a.yaml:5:16: sun is not a light here. There are: key, rim, back, sky."),
        ("light_groups: {far: [sky, background]}", "background is what the camera sees of the sky, and it"),
        ("light_groups: {a: [key], b: [key]}", "5:30: key is in group a already. Remove one of the two."),
        ("light_groups: {rim: [key]}", "rim is a light of no group, whose own group has this name."),
        ("light_groups: [key, rim]", "a light group has a name. Write {NAME: [key, rim]}, or each."),
        ("light_groups: all", "'all' is not a light group. Write each, off, or {NAME: [key, rim]}."),
        ("light_groups: {my keys: [key]}", "letters, digits and _ after a first letter. Write my_keys."),
        ("light_groups: {warm: []}", "light_groups.warm: empty; it must have at least 1 item"),
        ("light_groups: each\nlook: symbolics_1990", "look symbolics_1990 is drawn without lights, so it"),
        ("aovs: [light_groups]", "light groups are not an AOV. Write light_groups: each, at the top"),
        ("lights: {hdri: nowhere.exr}", "a.yaml:5:10: file nowhere.exr is not there"),
        ("lights: {visible: false}", "lights has visible, which is for hdri"),
        ("stage: plynth", "'plynth' is not a stage."),
        ("stage: {kind: ground, width: 3}", "stage has width, which ground does not use. Remove it, or"),
        ("stage: {kind: none, colour: [0, 0, 0]}", "stage has colour, which none does not use."),
        ("stage: {kind: plinth, height: 0}", "stage.height: 0 is out of range; it must be at least 0.2"),
        ("stage: {colour: [1, 1, 2]}", "2 is out of range; it must be at most 1"),
    ],
)  # fmt: skip
def test_mistakes_are_told_at_their_line(said: str, message: str, tmp_path: Path) -> None:
    found = told(tmp_path, said)
    assert "a.yaml:5:" in found and message in found
    assert len(found.splitlines()) == 1


def test_a_map_that_is_none_is_told_at_its_line(tmp_path: Path) -> None:
    (tmp_path / "text.exr").write_text("nothing")
    write_map(tmp_path / "square.exr", 16)
    write_map(tmp_path / "nan.exr", 8, spoilt=True)
    for name, fault in {
        "text": "it cannot be read as a picture",
        "square": "16 × 16 pixels; a map of all directions must be twice as wide as high",
        "nan": "pixel 2, 1 and 0 others are not finite",
    }.items():
        found = told(tmp_path, f"lights: {{hdri: {name}.exr}}")
        assert found.startswith("a.yaml:5:") and fault in found and len(found.splitlines()) == 1
