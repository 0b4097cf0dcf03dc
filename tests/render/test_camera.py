"""Lenses that blur, parts of pictures, and cameras where none can be."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.mesh import icosphere
from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.mitsuba.emitters import softboxes_in_view
from flowsculpt.render.mitsuba.sensor import sensor
from flowsculpt.render.post.denoise import denoiser_features
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS, LightRig
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.surface import Surface, require_camera_outside, winding_number

CAMERA = Camera((0.0, 1.0, 8.0), (0.0, 1.0, 0.0))
SMALL = Quality(64, 36, samples=16, depth=3, auxiliary_samples=16)


def width_of_the_outline(layers: RenderedFrame) -> float:
    """Count the pixels of the middle row that the subject covers partly."""
    row = layers["matte"][18]
    return float(((row > 0.02) & (row < 0.98)).sum())


@given(
    across=st.floats(-1.0, 1.0),
    upwards=st.floats(-1.0, 1.0),
    angle=st.floats(0.0, 6.3),
    share=st.floats(0.0, 1.0),
    depth=st.floats(0.1, 40.0),
)
def test_a_lamp_that_some_part_of_the_lens_sees_is_in_the_picture(
    across: float, upwards: float, angle: float, share: float, depth: float
) -> None:
    """Light through any point of the lens to any point of the picture meets in the plane of focus."""
    camera = dataclasses.replace(CAMERA, lens_radius=0.4, focus_distance=8.0)
    half = np.tan(camera.field_of_view / 2.0) * camera.focus_distance
    on_lens = camera.lens_radius * share * np.array([np.cos(angle), np.sin(angle), 0.0])
    in_focus = np.array([across * half, upwards * half * 9.0 / 16.0, camera.focus_distance])
    seen = on_lens + (in_focus - on_lens) * depth / camera.focus_distance
    place = camera.origin + camera.axes().T @ seen
    lamp = dataclasses.replace(LIGHTS["studio"].softboxes[0], position=tuple(place), width=1e-3, height=1e-3)
    point = Surface(
        np.zeros((3, 3), np.float32), np.zeros((3, 3), np.float32), np.array([[0, 1, 2]], np.int32)
    )
    rig, stage = LightRig(softboxes=(lamp,)), STAGES["none"]
    scene = Scene(point, LOOKS["clay"], rig, stage, StagePlacement(), camera)
    assert softboxes_in_view(scene, (160, 90)) == ["softbox0"]


def test_what_lies_in_the_plane_of_focus_is_sharp_and_the_rest_is_not(
    rendered: Callable[..., RenderedFrame],
) -> None:
    def outline(focus: float) -> float:
        camera = dataclasses.replace(CAMERA, lens_radius=0.4, focus_distance=focus)
        return width_of_the_outline(rendered(camera=camera, quality=SMALL))

    sharp = width_of_the_outline(rendered(camera=CAMERA, quality=SMALL))
    assert outline(8.0) <= sharp + 2
    assert outline(3.0) > sharp + 8


def test_a_lens_of_no_width_is_a_pinhole() -> None:
    assert not CAMERA.has_depth_of_field
    assert dataclasses.replace(CAMERA, lens_radius=0.1).has_depth_of_field
    with pytest.raises(BadInputError, match="lens_radius is -1"):
        dataclasses.replace(CAMERA, lens_radius=-1.0)


def test_features_behind_a_wide_lens_lose_their_noise_before_they_guide_the_denoiser(
    rendered: Callable[..., RenderedFrame],
) -> None:
    sharp, blurred = (
        rendered(camera=dataclasses.replace(CAMERA, lens_radius=radius)) for radius in (0.0, 0.4)
    )
    assert np.array_equal(denoiser_features(sharp).normal, sharp["normal"])
    assert not np.array_equal(denoiser_features(blurred).normal, blurred["normal"])


@pytest.mark.parametrize(
    ("distance", "message"), [(-2.0, "lies 2 units behind the lens"), (0.0, "lies within")]
)
def test_a_focus_that_no_lens_has_is_told(
    rendered: Callable[..., RenderedFrame], distance: float, message: str
) -> None:
    camera = dataclasses.replace(CAMERA, lens_radius=0.1, focus_distance=distance)
    with pytest.raises(BadInputError, match=message):
        rendered(camera=camera)


def test_a_part_shows_what_the_whole_picture_shows_there(rendered: Callable[..., RenderedFrame]) -> None:
    whole = rendered(camera=CAMERA, quality=SMALL)
    part = rendered(camera=CAMERA, quality=dataclasses.replace(SMALL, crop=(20, 6, 51, 33)))
    assert part.size == (31, 27)
    for name in ("position", "normal", "matte"):
        near = np.abs(part[name] - whole[name][6:33, 20:51])
        assert np.median(near) < 0.01 and near.mean() < 0.06
    assert part["beauty"].mean() == pytest.approx(whole["beauty"][6:33, 20:51].mean(), rel=0.03)


def test_a_part_is_the_same_to_the_last_bit_again(rendered: Callable[..., RenderedFrame]) -> None:
    quality = Quality(48, 27, samples=4, depth=3, auxiliary_samples=4, crop=(5, 3, 30, 20))
    one, other = (rendered(quality=quality) for _ in range(2))
    assert all(np.array_equal(one[name], other[name]) for name in one.arrays)


@pytest.mark.parametrize("crop", [(0, 0, 0, 5), (5, 0, 4, 5), (0, 0, 49, 5), (-1, 0, 5, 5)])
def test_a_part_must_be_one(crop: tuple[int, int, int, int]) -> None:
    with pytest.raises(BadInputError, match="is not within 48 × 27 pixels"):
        Quality(48, 27, samples=4, depth=3, crop=crop)


def test_a_sharp_whole_picture_is_described_as_ever(engine: object) -> None:
    description = sensor(CAMERA, (48, 27))
    assert description["type"] == "perspective"
    assert set(description["film"]) == {
        "type", "width", "height", "pixel_format", "component_format", "rfilter"
    }  # fmt: skip


@settings(max_examples=50, deadline=None)
@given(st.tuples(st.floats(-1.5, 1.5), st.floats(-0.5, 2.5), st.floats(-1.5, 1.5)))
def test_a_closed_surface_winds_once_around_what_is_inside(point: tuple[float, float, float]) -> None:
    sphere = _sphere()
    away = float(np.linalg.norm(np.subtract(point, (0.0, 1.0, 0.0))))
    if 0.95 < away < 1.01:
        return  # between the sphere and its facets
    assert winding_number(sphere, np.array(point)) == pytest.approx(1.0 if away < 1.0 else 0.0, abs=1e-4)


def test_a_camera_inside_of_the_sculpture_is_told(rendered: Callable[..., RenderedFrame]) -> None:
    with pytest.raises(BadInputError, match=r"is inside the sculpture, at 0, 1, 0.5"):
        rendered(camera=Camera((0.0, 1.0, 0.5), (0.0, 1.0, 0.0)))


def test_a_camera_may_look_out_of_an_open_vessel() -> None:
    sphere = _sphere()
    lid = (sphere.vertices[sphere.faces][:, :, 1] > 1.7).all(axis=1)
    bowl = dataclasses.replace(sphere, faces=sphere.faces[~lid])
    require_camera_outside(bowl, Camera((0.0, 0.5, 0.3), (0.0, 1.0, 0.0)))
    with pytest.raises(BadInputError):
        require_camera_outside(sphere, Camera((0.0, 0.5, 0.3), (0.0, 1.0, 0.0)))


def _sphere() -> Surface:
    mesh = icosphere(3)
    vertices = (mesh.vertices + np.array([0.0, 1.0, 0.0])).astype(np.float32)
    return Surface(vertices, mesh.vertices.astype(np.float32), mesh.faces)
