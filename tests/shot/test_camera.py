"""Cameras of shot files: what each word means, what may not stand together, and what cannot be."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.shot import CameraPath, read_shot
from flowsculpt.pipeline.shot.camera_path import Lens, View
from flowsculpt.render.scene.render_camera import Projection

HEAD = "title: A\nframes: 1-49\nsubject: {solid: box}\nresample: {max_edge_length: 0.5}\n"


def path_of(camera: str) -> CameraPath:
    return read_shot("a.yaml", f"{HEAD}camera: {camera}\n").picture.camera


def view(camera: str, time: float = 1.0) -> View:
    return path_of(camera).at(time)


def test_a_camera_that_is_not_spoken_of_sees_as_ever() -> None:
    plain = View(math.radians(-30), math.radians(14), math.radians(26), 0.1)
    assert read_shot("a.yaml", HEAD).picture.camera.at(0.0) == plain == view("{}")


@given(st.floats(4, 2000), st.floats(1, 100))
def test_a_focal_length_sees_its_sensor_from_the_point_behind_which_it_lies(
    focal_length: float, width: float
) -> None:
    """A sensor of width w at a distance f behind a pinhole subtends what is seen."""
    path = CameraPath(0.0, 0.0, 0.5, 0.08, focal_length=focal_length, sensor_width=width)
    seen = path.at(0.0).field_of_view
    assert math.tan(seen / 2) * focal_length == pytest.approx(width / 2)


def test_a_full_frame_85_mm_lens_has_the_angle_that_its_makers_say() -> None:
    assert math.degrees(view("{focal_length: 85}").field_of_view) == pytest.approx(23.9, abs=0.05)


def test_a_focal_length_may_be_keyed() -> None:
    zoom = path_of("{focal_length: {ease: linear, keys: {1: 20, 49: 60}}, distance: 7}")
    assert zoom.at(1.0) == view("{focal_length: 40, distance: 7}")


def test_every_word_reaches_the_view_in_the_units_of_the_code() -> None:
    seen = view(
        "{roll: 90, dolly: 0.5, target: {formula: [t, 0, 1]}, margin: {ease: linear, keys: {1: 0, 49: 0.2}}}"
    )
    assert (seen.roll, seen.dolly, seen.target) == (math.pi / 2, 0.5, (1.0, 0.0, 1.0))
    assert seen.margin == pytest.approx(0.1)
    placed = view("{position: {ease: linear, keys: {1: [0, 0, 4], 49: [2, 0, 4]}}, distance: }")
    assert (placed.position, placed.target, placed.distance) == ((1.0, 0.0, 4.0), None, None)


def test_safe_areas_are_margins_by_name() -> None:
    assert (view("{margin: action}").margin, view("{margin: title}").margin) == (0.035, 0.05)


def test_an_orbit_goes_on_from_the_azimuth_as_fast_as_it_says() -> None:
    steady = path_of("{azimuth: 10, orbit: 30}").at(2.0)
    assert (steady.azimuth, steady.orbit) == (math.radians(10), pytest.approx(math.radians(60)))
    starting = path_of("{orbit: {ease: linear, keys: {1: 0, 49: 30}}}").at(2.0)
    assert starting.orbit == pytest.approx(math.radians(30))


def test_an_aperture_needs_no_more_than_itself() -> None:
    assert view("{}").lens is None
    assert view("{focal_length: 85, aperture: 2.8}").lens == Lens(85.0, 2.8)
    wide = view("{field_of_view: 90, aperture: 4}").blur
    assert wide is not None and wide.focal_length == pytest.approx(18.0)


@pytest.mark.parametrize(
    ("focus", "meant"),
    [
        ("subject", None),
        ("front", "front"),
        ("3", 3.0),
        ("{ease: linear, keys: {1: 2, 49: 4}}", 3.0),
        ("{formula: 2 + t}", 3.0),
        ("[1, 2, 3]", (1.0, 2.0, 3.0)),
        ("{ease: linear, keys: {1: [0, 0, 0], 49: {value: [2, 0, 4], ease: constant}}}", (1.0, 0.0, 2.0)),
        ("{formula: [t, 0, 0]}", (1.0, 0.0, 0.0)),
    ],
)
def test_focus_is_the_subject_a_distance_or_a_place(focus: str, meant: object) -> None:
    lens = view(f"{{aperture: 2, unit: 10, focus: {focus}}}").blur
    assert lens is not None and (lens.focus, lens.unit) == (meant, 10.0)


def test_what_acts_on_nothing_changes_no_view() -> None:
    assert view("{focus: 3, unit: 10, sensor_width: 20}") == view("{}")


def test_a_shot_takes_back_what_it_rests_on_says(tmp_path: Path) -> None:
    (tmp_path / "A.yaml").write_text(HEAD + "camera: {azimuth: 20, field_of_view: 40, aperture: 2}\n")
    own = "{position: [0, 1, 6], azimuth: , focal_length: 50, field_of_view: , aperture: }"
    (tmp_path / "B.yaml").write_text(f"extends: A\ncamera: {own}\n")
    seen = read_shot(tmp_path / "B.yaml").picture.camera.at(0.0)
    assert seen == view("{position: [0, 1, 6], focal_length: 50}", 0.0)


@pytest.mark.parametrize(("kind", "filled"), [("spherical", 75.0), ("vr180", 75.0), ("dome", 50.0)])
def test_a_wide_projection_has_defaults_of_its_own(kind: str, filled: float) -> None:
    seen = view(f"{{projection: {kind}}}")
    assert seen.wide is not None and seen.wide.projection == Projection(kind)
    assert (seen.field_of_view, seen.elevation) == (math.radians(filled), 0.0)
    assert seen.wide.lift == pytest.approx(math.radians(55.0) if kind == "dome" else 0.0)
    assert view(f"{{projection: {kind}, elevation: 20, field_of_view: 40}}").elevation == math.radians(20.0)
    assert seen.wide.eye_distance == (64.0 if kind == "vr180" else 0.0)


def test_a_dome_has_the_angle_and_vr180_the_eyes_that_the_shot_says() -> None:
    dome = view("{projection: dome, dome_angle: 210}").wide
    assert dome is not None and dome.angle == math.radians(210.0)
    eyes = view("{projection: vr180, eye_distance: 30, unit: 10}").wide
    assert eyes is not None and (eyes.eye_distance, eyes.unit) == (30.0, 10.0)


def test_qualities_of_a_wide_shot_have_its_shape() -> None:
    qualities = read_shot("a.yaml", HEAD + "camera: {projection: dome}\n").picture.qualities
    assert {quality.aspect for quality in qualities.values()} == {1.0}


def test_what_flat_pictures_alone_can_show_is_refused_with_a_wide_projection() -> None:
    text = HEAD + "camera: {projection: vr180}\nlook: symbolics_1990\naovs: [motion]\n"
    with pytest.raises(ShotError) as caught:
        read_shot("a.yaml", text)
    for fault in ("look symbolics_1990 is drawn", "AOV motion is that of one eye"):
        assert fault in str(caught.value)


WRONG = [
    ("{projection: equirectangular}",
     "5:10: camera.projection: 'equirectangular' is not a projection. Did you mean 'spherical'?"),
    ("{dome_angle: 200}",
     "5:10: dome_angle is of projection dome, and this camera has perspective. Write projection: dome, or "
     "remove dome_angle."),
    ("{projection: dome, eye_distance: 60}",
     "5:28: eye_distance is of projection vr180, and this camera has dome. Write projection: vr180, or "
     "remove eye_distance."),
    ("{projection: spherical, aperture: 2}",
     "5:33: aperture is of a perspective lens; projection spherical has none and is sharp everywhere. Remove "
     "aperture, or write `aperture:` with nothing after it if inherited."),
    ("{focal_length: 85, field_of_view: 20}",
     "5:10: focal_length sets what field_of_view sets too. Remove one of them, or write `field_of_view:` "
     "with nothing after it if inherited."),
    ("{position: [0, 0, 1], orbit: 3}",
     "5:10: position sets what orbit sets too. Remove one of them, or write `orbit:` with nothing after it "
     "if inherited."),
    ("{field_of_view: 180}", "5:10: camera.field_of_view: 180 is out of range; it must be below 180"),
    ("{field_of_view: {formula: 90 + 90*t}}",
     "5:10: camera.field_of_view: 180 at frame 25 is out of range; it must stay above 0 "
     "and below 180"),
    ("{margin: {keys: {1: 0, 49: 0.6}}}",
     "5:32: camera.margin.keys.49: 0.6 is out of range; it must be below 0.5"),
    ("{margin: {formula: t}}",
     "5:10: camera.margin: 0.5 at frame 13 is out of range; it must stay at 0 or above "
     "and below 0.5"),
    ("{margin: titles}", "5:10: camera.margin: 'titles' is not a safe area. Did you mean 'title'?"),
    ("{aperture: 0}", "5:10: camera.aperture: 0 is out of range; it must be above 0"),
    ("{aperture: {formula: 1 - t}}",
     "5:10: camera.aperture: 0 at frame 25 is out of range; it must stay above 0"),
    ("{focal_length: {keys: {1: 50, 49: -1}}}",
     "5:39: camera.focal_length.keys.49: -1 is out of range; it must be above 0"),
    ("{dolly: 0}", "5:10: camera.dolly: 0 is out of range; it must be above 0"),
    ("{follow: 2}", "5:10: camera.follow: 2 is out of range; it must be at most 1"),
    ("{focus: subjects}",
     "5:10: camera.focus: 'subjects' is not a thing to focus on. Did you mean 'subject'?"),
    ("{focus: {keys: {1: 2, 49: [1, 2, 3]}}}",
     "5:31: camera.focus.keys.49: a list is not a number"),
    ("{focal: 85}", "5:10: camera.focal: unknown name. Did you mean 'focal_length'?"),
    ("\n  position: {keys: {1: [0, 0, 4], 49: [0, 0, 0]}}\n  target: [0, 0, 0]",
     "6:3: at frame 49 the camera stands at its own target, [0.0, 0.0, 0.0]; it has no direction. Move "
     "one of them."),
]  # fmt: skip


@pytest.mark.parametrize(("camera", "message"), WRONG, ids=[camera for camera, _ in WRONG])
def test_a_camera_that_cannot_be_is_told_at_its_line(camera: str, message: str) -> None:
    with pytest.raises(ShotError) as caught:
        path_of(camera)
    assert caught.value.messages[0].partition("a.yaml:")[2] == message


def test_keys_that_are_no_times_are_told_once(tmp_path: Path) -> None:
    with pytest.raises(ShotError) as caught:
        path_of("{position: {keys: {late: [1, 2, 3], soon: [0, 0, 0]}}, target: [0, 0, 0]}")
    assert len(caught.value.messages) == 2
