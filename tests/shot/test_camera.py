"""Cameras of shot files: what each word means, what may not stand together, and what cannot be."""

from __future__ import annotations

import itertools
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.production.request.framing import BoundingSpheres, Framer
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


def test_a_push_comes_nearer_and_is_in_its_middle_where_framing_puts_the_camera() -> None:
    path = path_of("{move: {push: 0.2}}")
    assert [path.at(time).dolly for time in (0.0, 1.0, 2.0)] == pytest.approx([1.1, 1.0, 0.9])
    assert path.at(1.0) == view("{}")


def test_moves_that_are_only_named_have_the_sizes_of_films() -> None:
    path = path_of("{elevation: 20, move: {push: , arc: , crane: , reveal: }}")
    start, end = path.at(0.0), path.at(2.0)
    assert math.degrees(end.orbit - start.orbit) == pytest.approx(30)
    assert math.degrees(end.elevation - start.elevation) == pytest.approx(12)
    assert (start.dolly, end.dolly) == (pytest.approx(1.075 * 0.6), pytest.approx(0.925))


@pytest.mark.parametrize("camera", ["elevation: 1, move: {crane: 40}", "elevation: 6, move: {crane: -30}"])
def test_no_crane_leads_below_the_floor(camera: str) -> None:
    path = path_of(f"{{{camera}}}")
    assert min(path.at(i / 24).elevation for i in range(49)) >= math.radians(1) - 1e-12


def test_a_move_begins_and_ends_at_its_frames_with_its_ease() -> None:
    path = path_of("{distance: 10, move: {push: 0.4, from: 13, to: 37, ease: linear}}")
    found = [path.at(time).distance for time in (0.0, 0.5, 1.0, 1.5, 2.0)]
    assert found == pytest.approx([12.0, 12.0, 10.0, 8.0, 8.0])


@given(st.integers(0, 2**31))
def test_a_hand_sways_smoothly_and_by_no_more_than_it_says(seed: int) -> None:
    """In hundredths of the picture's width, and from frame to frame by a small part of that."""
    path = path_of(f"{{field_of_view: 30, move: {{handheld: 0.3, seed: {seed}}}}}")
    still, most = view("{field_of_view: 30}"), 0.003 * math.radians(30)
    views = [path.at(i / 24) for i in range(49)]
    for now in ("orbit", "elevation", "roll"):
        sway = [getattr(seen, now) - getattr(still, now) for seen in views]
        assert max(map(abs, sway)) <= most * (1 + 1e-9)
        assert max(abs(b - a) for a, b in itertools.pairwise(sway)) < 0.2 * most
    assert len({seen.orbit for seen in views}) > 40


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ("{move: {}}", "nothing moves. Write push, arc, crane, reveal, track or handheld."),
        ("{move: {push: 0.1, from: 40, to: 20}}", "ends at frame 20, and begins at 40. Write a later to."),
        ("{position: [0, 1, 5], move: {arc: }}", "position holds the camera, so it cannot move"),
        ("{move: {pan: 3}}", "pan"),
        (
            "{move: {track: [a, b]}}",
            "camera.move.track: 'a' is not a subject. Write several subjects by name.",
        ),
        ("{target: [0, 1, 0], move: {track: [a, b]}}", "so it cannot track"),
    ],
)
def test_a_move_that_cannot_be_is_refused(camera: str, message: str) -> None:
    with pytest.raises(ShotError, match=re.escape(message)):
        path_of(camera)


def test_a_camera_that_tracks_looks_at_one_subject_after_the_other() -> None:
    """Framing aims at their middles, wherever they are by then."""
    way = "move: {track: [ball, block, ball], ease: linear}"
    subjects = "subjects: {ball: {solid: icosphere}, block: {solid: box, place: [5, 0, 0]}}\n"
    text = HEAD.replace("subject: {solid: box}\n", subjects)
    camera = read_shot("a.yaml", f"{text}camera: {{{way}}}\n").picture.camera
    corners = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    spheres = BoundingSpheres.join([corners, corners + np.array([5.0, 1.0, 0.0])], ["ball", "block"])
    views = [camera.at(i / 24) for i in range(49)]
    targets = np.array([each.camera.target for each in Framer(views, lambda _: spheres, 16 / 9).all()])
    assert np.abs(targets[12] - [2.5, 0.5, 0.0]).max() < 0.01  # half-way to the block
    assert np.abs(targets[24] - [5.0, 1.0, 0.0]).max() < 1.0  # the turn is smoothed
    assert np.abs(targets[[0, 48]]).max() < 1.0
    assert np.linalg.norm(np.diff(targets, axis=0), axis=1).max() < 0.25
