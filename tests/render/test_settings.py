"""A picture's settings are plain values, and keep to their limits."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import from_plain, to_plain
from flowsculpt.render.graphics.cards import TitleCard, title_frames
from flowsculpt.render.scene.materials import LOOKS, Diffuse, Plastic
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import QUALITIES, Quality
from flowsculpt.render.scene.scene_lights import LIGHTS, LightRig, Softbox
from flowsculpt.render.scene.scene_stage import STAGES, Stage, StagePlacement

SETTINGS = [
    *LOOKS.values(),
    *LIGHTS.values(),
    *STAGES.values(),
    *QUALITIES.values(),
    Camera((0.0, 1.0, 5.0), (0.0, 1.0, 0.0)),
    StagePlacement((1.0, 2.0, 3.0), 4.0),
    TitleCard("Flow", "a film"),
]
coordinates = st.floats(-100.0, 100.0)
points = st.tuples(coordinates, coordinates, coordinates)


@pytest.mark.parametrize("setting", SETTINGS, ids=lambda setting: type(setting).__name__)
def test_a_setting_survives_json(setting: Any) -> None:
    again = from_plain(type(setting), json.loads(json.dumps(to_plain(setting))))
    assert again == setting
    assert hash(again) == hash(setting)


def test_what_is_left_out_takes_its_default() -> None:
    assert from_plain(LightRig, {"softboxes": [], "exposure": 1}) == LightRig(exposure=1.0)


@pytest.mark.parametrize(
    ("kind", "values", "message"),
    [
        (
            Diffuse,
            {"model": "diffuse", "color": [1, 1, 1]},
            "Diffuse has no 'color'; it has colour, roughness",
        ),
        (Camera, {"origin": [0, 0, 1], "target": [0, 0]}, "Camera.target has 2 values; it needs 3"),
        (Diffuse, {"model": "diffuse"}, "missing 1 required"),
        (LightRig, {"softboxes": [{"width": 1}]}, r"LightRig\.softboxes\[0\]"),
    ],
)
def test_a_wrong_field_is_named(kind: type, values: dict[str, Any], message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        from_plain(kind, values)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Camera((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        lambda: Camera((0.0, 5.0, 0.0), (0.0, 0.0, 0.0)),
        lambda: Camera((0.0, 0.0, math.nan), (0.0, 0.0, 0.0)),
        lambda: Camera((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), field_of_view=4.0),
        lambda: Camera((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), near=2.0, far=1.0),
        lambda: StagePlacement(size=0.0),
        lambda: StagePlacement(origin=(math.inf, 0.0, 0.0)),
        lambda: Stage("void"),
        lambda: Stage(sweep=0.0),
        lambda: Diffuse((0.5, 1.5, 0.5)),
        lambda: Plastic((0.5, 0.5, 0.5), roughness=2.0),
        lambda: Quality(0, 270, samples=4, depth=3),
        lambda: Quality(480, 270, samples=4, depth=1),
        lambda: Quality(480, 270, samples=4, depth=3, denoise="twice"),
    ],
)
def test_values_beyond_their_limits_are_refused(make: Any) -> None:
    with pytest.raises(BadInputError) as raised:
        make()
    assert raised.value.exit_code == 2


def test_a_camera_projects_its_target_to_the_middle_and_its_edge_to_one() -> None:
    camera = Camera((3.0, 2.0, 5.0), (0.0, 1.0, 0.0), field_of_view=math.radians(40.0))
    right, up, forward = camera.axes()
    edge = np.array(camera.origin) + 7.0 * (forward + math.tan(math.radians(20.0)) * right)
    top = np.array(camera.origin) + 7.0 * (forward + math.tan(math.radians(20.0)) / 2.0 * up)
    seen = camera.project([camera.target, edge, top], aspect=2.0)
    assert seen[:, :2] == pytest.approx(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), abs=1e-12)
    assert seen[1:, 2] == pytest.approx(7.0)


@given(points, points)
def test_a_cameras_axes_are_a_right_handed_frame(origin: Any, target: Any) -> None:
    try:
        camera = Camera(origin, target)
    except BadInputError:
        return
    axes = camera.axes()
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-9)
    assert np.cross(axes[0], axes[1]) == pytest.approx(-axes[2], abs=1e-9)


def test_the_cyclorama_has_no_edge() -> None:
    """Neighbouring normals differ little everywhere, and each agrees with the face's own."""
    vertices, normals, faces = Stage().mesh()
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0, abs=1e-5)
    corners = vertices[faces].astype(np.float64)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.linalg.norm(across, axis=1).min() > 0.0
    facing = across / np.linalg.norm(across, axis=1, keepdims=True)
    assert np.einsum("ijk,ik->ij", normals[faces], facing).min() > math.cos(math.radians(3.0))
    assert vertices[:, 1].min() == 0.0


def test_lamps_stand_inside_the_cyclorama_and_face_the_subject() -> None:
    profile, _ = Stage().profile()
    for rig in LIGHTS.values():
        for lamp in rig.softboxes:
            radius = math.hypot(lamp.position[0], lamp.position[2])
            assert lamp.position[1] - lamp.height / 2.0 > np.interp(radius, profile[:, 0], profile[:, 1])
            assert isinstance(lamp, Softbox)


def test_a_title_fades_in_stands_and_fades_out() -> None:
    frames = list(title_frames(TitleCard("Flow sculpture", "after Reynolds, 1991"), (240, 136), 24, 6))
    contrast = [float(frame.max() - np.median(frame)) for frame in frames]
    assert len(frames) == 24
    assert contrast[0] < 0.3 < 0.6 < contrast[12]
    assert contrast[-1] < 0.3
    assert min(frame.mean() for frame in frames) > 15.0 / 255.0
    assert all(frame.dtype == np.float32 and frame.shape == (136, 240, 3) for frame in frames)


def ink(card: TitleCard, width: int, height: int) -> np.ndarray:
    """Return the columns of the standing card that hold words."""
    empty = replace(card, title="", subtitle="")
    standing, ground = (list(title_frames(each, (width, height), 3, 0))[1] for each in (card, empty))
    return np.flatnonzero((np.abs(standing - ground) > 0.02).any(axis=(0, 2)))


def test_a_long_title_stays_inside_the_picture() -> None:
    columns = ink(TitleCard("A very long title that would not fit at all, were it set large"), 480, 270)
    assert len(columns) > 200
    assert columns.min() > 20
    assert columns.max() < 459


def test_words_stand_in_the_middle() -> None:
    columns = ink(TitleCard("HOH", "HOH"), 240, 136)
    assert (columns[0] + columns[-1]) / 2.0 == pytest.approx(119.5, abs=2.0)


def test_fades_longer_than_the_title_are_refused() -> None:
    with pytest.raises(BadInputError, match="cannot fade"):
        next(title_frames(TitleCard("Flow"), (240, 136), 10, 6))
