"""Spherical, dome and VR180 cameras: what is where in the picture, with real rendering."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from flowsculpt.pipeline.mesh import icosphere
from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.frame.render_frame import render_frame
from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.post.denoise import FilmDenoiser, RawFrame, denoised_columns
from flowsculpt.render.post.temporal_denoise import DenoisedFrame, temporal_denoise
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import LEFT, RIGHT, Camera, Projection, WideCamera, pixel_places
from flowsculpt.render.scene.render_quality import QUALITIES, Quality, qualities_for
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.surface import Surface

EYES = 0.4
SPHERICAL = WideCamera((0.0, 1.0, 0.0), (0.0, 1.0, -5.0))
DOME = replace(SPHERICAL, wide=Projection("dome"))
VR180 = replace(SPHERICAL, wide=Projection("vr180"), eye_distance=EYES)
TINY = Quality(64, 32, samples=1, depth=2, auxiliary_samples=16, denoise="off")


def ball(place: tuple[float, float, float], radius: float = 0.3) -> Surface:
    """Return a small sphere."""
    mesh = icosphere(2)
    normals = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    vertices = radius * normals + np.array(place)
    return Surface(vertices.astype(np.float32), normals.astype(np.float32), mesh.faces)


def scene(camera: Camera, surface: Surface, stage: str = "none") -> Scene:
    """Return a scene of clay in studio light."""
    placement = StagePlacement()
    return Scene(surface, LOOKS["clay"], LIGHTS["studio"], STAGES[stage], placement, camera)


def middle_of(matte: np.ndarray, columns: slice) -> tuple[float, float]:
    """Return column and row of the middle of what covers some columns of a picture."""
    weights = np.zeros_like(matte)
    weights[:, columns] = matte[:, columns]
    rows, places = np.indices(matte.shape)
    return float((weights * places).sum() / weights.sum()), float((weights * rows).sum() / weights.sum())


@pytest.mark.parametrize("place", [(2.0, 1.5, -2.5), (-3.0, 2.0, -1.0)])
@pytest.mark.parametrize("camera", [SPHERICAL, DOME, VR180], ids=lambda camera: camera.wide.kind)
def test_a_small_object_is_where_its_direction_says(
    engine: Engine, camera: WideCamera, place: tuple[float, float, float]
) -> None:
    quality = replace(TINY, width=32) if camera is DOME else TINY
    matte = render_frame(scene(camera, ball(place)), quality, 1, engine)["matte"]
    width, height = quality.width, quality.height
    for eye in (LEFT, RIGHT) if camera is VR180 else (LEFT,):
        half = slice(width // 2, width) if eye == RIGHT else slice(width // 2 if camera is VR180 else width)
        x, y, _ = camera.project([place], width / height, [eye])[0]
        expected = (x + 1.0) / 2.0 * width - 0.5, (1.0 - y) / 2.0 * height - 0.5
        assert middle_of(matte, half) == pytest.approx(expected, abs=0.12)


def test_an_object_behind_a_spherical_camera_is_at_both_edges_of_the_picture(engine: Engine) -> None:
    matte = render_frame(scene(SPHERICAL, ball((0.0, 1.0, 3.0), 0.8)), TINY, 1, engine)["matte"]
    assert matte[15, 0] > 0.9 and matte[15, -1] > 0.9
    assert matte[:, 10:-10].max() == 0.0


def test_a_near_point_has_the_disparity_of_two_eyes() -> None:
    distance = 2.0
    (left, *_), (right, *_) = VR180.project([(0.0, 1.0, -distance)] * 2, 2.0, [LEFT, RIGHT])
    disparity = (left + 0.5) - (right - 0.5)  # each half is 180° wide: 1 of x
    assert disparity * math.pi == pytest.approx(2.0 * math.atan(EYES / 2.0 / distance))
    aside = VR180.project([(1e6, 1.0, -1.0)] * 2, 2.0, [LEFT, RIGHT])
    assert aside[0, 0] + 0.5 == pytest.approx(aside[1, 0] - 0.5, abs=1e-6)


def test_the_corners_of_a_dome_are_black_and_empty(engine: Engine) -> None:
    quality = replace(TINY, width=32)
    frame = render_frame(scene(DOME, ball((0.0, 1.0, -3.0)), "cyclorama"), quality, 1, engine)
    beside = np.isnan(DOME.wide.directions(pixel_places(33, 33))[..., 0])
    assert beside[0, 0] and frame["beauty"][:3, :3].max() == 0.0
    assert frame["alpha"][0, 0] == 0.0 and frame["depth"][-1, -1] == 0.0


def test_a_spherical_and_a_perspective_picture_agree_where_they_look_the_same_way(engine: Engine) -> None:
    sculpture = ball((0.2, 1.1, -3.0), 0.9)
    flat = Camera(SPHERICAL.origin, SPHERICAL.target, field_of_view=math.radians(60.0))
    lit = replace(LIGHTS["studio"], sky=replace(LIGHTS["studio"].sky, visible=False))
    wide_scene = replace(scene(SPHERICAL, sculpture), lights=lit)
    many = replace(TINY, width=96, height=48, samples=64, depth=3)
    wide = render_frame(wide_scene, many, 1, engine)
    plain = render_frame(replace(wide_scene, camera=flat), replace(many, width=48), 2, engine)
    spots = np.array([(0.0, 1.2, -2.2), (-0.2, 1.4, -2.3), (0.5, 1.0, -2.2)])
    for name in ("beauty", "normal", "position"):
        values = []
        for frame, camera in ((wide, SPHERICAL), (plain, flat)):
            width, height = frame.size
            x, y, _ = camera.project(spots, width / height).T
            column = np.floor((x + 1.0) / 2.0 * width).astype(int)
            row = np.floor((1.0 - y) / 2.0 * height).astype(int)
            values.append(frame[name][row, column])
        assert values[0] == pytest.approx(values[1], rel=0.2, abs=0.15)  # pixels are 4° wide


def test_denoising_leaves_no_seam_at_the_back_of_a_spherical_picture(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    random, (height, width) = np.random.default_rng(0), (64, 192)
    around = 0.4 + 0.3 * np.cos((np.arange(width) + 0.5) / width * 2.0 * math.pi)
    beauty = around[None, :, None] * random.gamma(1.0, 1.0, (height, width, 1)) * np.ones(3)
    flat = np.full((height, width, 3), 0.5)
    planes = {"beauty": beauty, "albedo": flat, "normal": flat}
    layers = RenderedFrame({name: plane.astype(np.float32) for name, plane in planes.items()})

    def seam(camera: Camera) -> float:
        raw = RawFrame(layers, camera, StagePlacement())
        light = FilmDenoiser(lambda _: raw, "balanced").light(1, [1])
        assert light.shape == (height, width, 3)
        steps = np.abs(np.diff(light, axis=1)).mean()
        return float(np.abs(light[:, 0] - light[:, -1]).mean() / steps)

    assert seam(SPHERICAL) < 2.0
    assert seam(Camera(SPHERICAL.origin, SPHERICAL.target)) > 3.0  # what it would be
    assert [len(columns) for columns, _ in denoised_columns(VR180.wide, 64)] == [32, 32]


def frame_seen_by(camera: WideCamera, size: tuple[int, int], light: np.ndarray) -> DenoisedFrame:
    """Return a frame from inside a sphere of radius 2 that stands still."""
    places = pixel_places(*size)
    right_up_forward = camera.wide.directions(places)
    eyes = camera.wide.eyes(places[..., 0])
    origin = np.array(camera.origin) + 0.5 * camera.eye_distance * eyes[..., None] * camera.axes()[0]
    directions = (right_up_forward @ camera.axes()).astype(np.float32)
    still = np.zeros_like(directions)
    return DenoisedFrame(
        light.astype(np.float32),
        np.full(places.shape[:2], 0.5, np.float32),
        (origin + 2.0 * directions).astype(np.float32),
        -directions,
        np.zeros(places.shape[:2], np.float32),
        still,
        still,
        camera,
        StagePlacement(),
    )


@pytest.mark.parametrize("camera", [SPHERICAL, VR180], ids=lambda camera: camera.wide.kind)
def test_temporal_denoising_averages_every_pixel_also_at_the_seam_and_in_both_eyes(
    camera: WideCamera,
) -> None:
    size, random = (64, 32), np.random.default_rng(1)
    lights = [1.0 + 0.05 * random.standard_normal((32, 64, 3)) for _ in range(3)]
    turned = replace(camera, target=(0.5, 1.0, -5.0)) if camera is SPHERICAL else camera
    cameras = [camera, turned, camera]
    frames = {n: frame_seen_by(c, size, x) for n, (c, x) in enumerate(zip(cameras, lights, strict=True))}
    averaged = temporal_denoise(frames, 1)
    noise = np.abs(averaged - 1.0).mean(axis=(0, 2)) / np.abs(lights[1] - 1.0).mean()
    inner = noise[2:-2] if camera is SPHERICAL else noise
    assert inner.mean() < 0.75
    assert noise[[0, 1, -2, -1]].mean() < 0.85 if camera is SPHERICAL else noise[30:34].mean() < 0.85


def test_wide_pictures_have_the_shape_of_their_projection_at_every_quality() -> None:
    for kind in ("spherical", "dome", "vr180"):
        projection = Projection(kind)
        for name, quality in qualities_for(projection).items():
            assert quality.aspect == projection.aspect
            assert quality.samples == QUALITIES[name].samples
    assert qualities_for(Projection()) == QUALITIES


def test_a_wide_camera_refuses_what_it_cannot_have() -> None:
    faults: list[tuple[str, Callable[[], WideCamera]]] = [
        ("no depth of field", lambda: replace(SPHERICAL, lens_radius=0.1)),
        ("cannot have the projection 'perspective'", lambda: replace(SPHERICAL, wide=Projection())),
        ("eye_distance is -1", lambda: replace(VR180, eye_distance=-1.0)),
    ]
    for message, make in faults:
        with pytest.raises(BadInputError, match=message):
            make()
