"""Quick previews resemble renders: subject, stage and sky are about as bright, in every look and light."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from flowsculpt.pipeline.production.request.framing import Framer
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.render.mitsuba import emitters
from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.post.colour import to_display
from flowsculpt.render.raster import Preview, Shape, StageSetup, preview
from flowsculpt.render.scene import clear_sky
from flowsculpt.render.scene.aovs import Pixels, RenderedFrame
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene_lights import LIGHTS, LightRig, Sky
from flowsculpt.render.scene.scene_sets import SETS
from flowsculpt.render.scene.scene_stage import PLINTH, STAGES, Stage, StagePlacement
from flowsculpt.render.scene.sky import Daylight
from flowsculpt.render.scene.surface import Surface
from tests.render.conftest import CAMERA, ball
from tests.render.test_lights import written

TOLERANCE = 0.1
"""Largest difference of mean display values, 0 … 1, in any channel."""

QUALITY = Quality(96, 54, samples=16, depth=6, auxiliary_samples=4)


@pytest.fixture(scope="module")
def pebble() -> Surface:
    """A ball with hollows and bumps, which stands on the floor."""
    round_one = ball(36, 72)
    x, y, z = round_one.normals.T
    vertices = round_one.vertices * (1.0 + 0.12 * np.sin(4 * x + 1) * np.sin(5 * y) * np.cos(4 * z))[:, None]
    a, b, c = (vertices[round_one.faces[:, k]] for k in range(3))
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, round_one.faces[:, k], np.cross(b - a, c - a))
    normals *= np.sign(np.sum(normals * round_one.normals, axis=1, keepdims=True))
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-6)
    vertices[:, 1] -= vertices[:, 1].min()
    return replace(round_one, vertices=vertices, normals=normals.astype(np.float32))


@pytest.mark.parametrize("look", ["clay", "glaze", "chrome", "honey", "glass", "frosted", "smoke"])
def test_a_preview_is_about_as_bright_as_the_render(
    look: str, pebble: Surface, rendered: Callable[..., RenderedFrame]
) -> None:
    layers = rendered(surface=pebble, look=LOOKS[look], quality=QUALITY)
    shape = Shape(pebble.vertices, pebble.normals, pebble.faces, LOOKS[look], closed=True)
    setup = StageSetup(LIGHTS["studio"], STAGES["cyclorama"], StagePlacement())
    drawn = preview(shape, setup, CAMERA, (QUALITY.width, QUALITY.height), "srgb").picture
    light = to_display(layers["beauty"], display="srgb")
    inside = layers["matte"] > 0.5
    for part in (inside, ~inside):
        assert np.abs(drawn[part].mean(axis=0) - light[part].mean(axis=0)).max() < TOLERANCE


def test_a_plinth_is_as_grey_as_in_the_render_whatever_the_colour_of_the_wall(
    pebble: Surface, rendered: Callable[..., RenderedFrame]
) -> None:
    stage = replace(STAGES["plinth"], colour=(0.5, 0.1, 0.05))
    layers = rendered(surface=pebble, look=LOOKS["clay"], quality=QUALITY, stage=stage)
    shape = Shape(pebble.vertices, pebble.normals, pebble.faces, LOOKS["clay"], closed=True)
    setup = StageSetup(LIGHTS["studio"], stage, StagePlacement())
    drawn = preview(shape, setup, CAMERA, (QUALITY.width, QUALITY.height), "srgb").picture
    light = to_display(layers["beauty"], display="srgb")
    plinth = np.all(np.abs(layers["albedo"] - PLINTH) < 1e-2, axis=2) & (layers["matte"] == 0.0)
    assert np.count_nonzero(plinth) > 300
    shown, expected = (picture[plinth].mean(axis=0) for picture in (drawn, light))
    assert np.abs((shown - shown.mean()) - (expected - expected.mean())).max() < TOLERANCE / 2


LOW = Camera((2.0, 0.4, 9.0), (0.0, 1.4, 0.0), field_of_view=math.radians(50.0))
"""A camera that sees ground and sky."""

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def assert_sky_and_ground_are_alike(
    rig: LightRig,
    stage: Stage,
    placement: StagePlacement,
    pebble: Surface,
    rendered: Callable[..., RenderedFrame],
) -> None:
    layers = rendered(
        surface=pebble, lights=rig, stage=stage, placement=placement, camera=LOW, quality=QUALITY
    )
    shape = Shape(pebble.vertices, pebble.normals, pebble.faces, LOOKS["clay"], closed=True)
    drawn = preview(shape, StageSetup(rig, stage, placement), LOW, (QUALITY.width, QUALITY.height), "srgb")
    light = to_display(layers["beauty"], display="srgb")
    around = layers["matte"] == 0.0
    for part in (around & (drawn.nearness == 0.0), around & (drawn.nearness > 0.0)):
        if np.count_nonzero(part) > 50:
            assert_as_bright(part, drawn, light)
            assert np.abs(drawn.picture[part].mean(axis=0) - light[part].mean(axis=0)).max() < TOLERANCE


@pytest.mark.parametrize(
    ("daylight", "turn"),
    [
        (Daylight(), 0.0),
        (Daylight(), 1.2),
        (Daylight(elevation=math.radians(6.0), azimuth=math.radians(150.0)), 0.0),
        (Daylight(elevation=math.radians(65.0), turbidity=7.3), 0.0),
    ],
)
def test_sky_and_ground_of_daylight_are_those_of_the_render(
    daylight: Daylight, turn: float, pebble: Surface, rendered: Callable[..., RenderedFrame]
) -> None:
    rig, placement = LightRig(daylight=daylight), StagePlacement(turn=turn)
    assert_sky_and_ground_are_alike(rig, STAGES["ground"], placement, pebble, rendered)


def test_a_sun_behind_the_wall_of_a_cyclorama_lights_no_floor(
    pebble: Surface, rendered: Callable[..., RenderedFrame]
) -> None:
    low = LightRig(daylight=Daylight(elevation=math.radians(17.0), azimuth=math.radians(-62.0)))
    assert_sky_and_ground_are_alike(low, STAGES["cyclorama"], StagePlacement(), pebble, rendered)


@pytest.mark.parametrize("stage", ["cyclorama", "ground", "none"])
@pytest.mark.parametrize("is_visible", [True, False])
def test_a_gradient_sky_is_seen_where_the_render_shows_it(
    stage: str, is_visible: bool, pebble: Surface, rendered: Callable[..., RenderedFrame]
) -> None:
    sky = Sky((0.1, 0.2, 0.5), (0.6, 0.4, 0.3), (0.05, 0.05, 0.1), visible=is_visible)
    assert_sky_and_ground_are_alike(LightRig(sky=sky), STAGES[stage], StagePlacement(), pebble, rendered)


def test_an_environment_map_with_a_sun_lights_the_ground_as_in_the_render(
    tmp_path: Path, pebble: Surface, rendered: Callable[..., RenderedFrame]
) -> None:
    light = np.full((64, 128, 3), (0.1, 0.15, 0.3), np.float32)
    light[32:] = 0.1
    light[12:14, 40:42] = (900.0, 800.0, 600.0)
    rig = LightRig(environment=written(tmp_path / "sun.exr", light))
    for turn in (0.0, 1.2):
        turned = replace(rig, environment=replace(rig.environment, turn=turn))
        assert_sky_and_ground_are_alike(turned, STAGES["ground"], StagePlacement(), pebble, rendered)


def test_a_haze_at_the_horizon_has_the_colours_of_the_sky(
    pebble: Surface, rendered: Callable[..., RenderedFrame]
) -> None:
    stage = replace(STAGES["ground"], horizon_fade=math.radians(4.0))
    assert_sky_and_ground_are_alike(LIGHTS["daylight"], stage, StagePlacement(), pebble, rendered)


def of_a_set(
    name: str, pebble: Surface, rendered: Callable[..., RenderedFrame]
) -> tuple[Preview, Pixels, NDArray[np.bool_]]:
    """Return a set's preview, its render (H, W, 3), and which pixels (H, W) are around the pebble."""
    text = "title: A\nframes: 1-2\nsubject: {solid: box}\nresample: {max_edge_length: 0.5}\n"
    picture = read_shot("a.yaml", f"{text}set: {name}\n").picture
    (framing,) = Framer([picture.camera.at(0.0)], lambda _: pebble.vertices, 16 / 9).all()
    framing = framing.with_stage_in_view(picture.stage, 16 / 9)
    place = {"stage": picture.stage, "placement": framing.placement, "camera": framing.camera}
    layers = rendered(surface=pebble, lights=picture.lights, quality=QUALITY, **place)
    shape = Shape(pebble.vertices, pebble.normals, pebble.faces, LOOKS["clay"], closed=True)
    setup = StageSetup(picture.lights, picture.stage, framing.placement)
    drawn = preview(shape, setup, framing.camera, (QUALITY.width, QUALITY.height), "srgb")
    light = to_display(layers["beauty"], picture.lights.exposure, display="srgb")
    return drawn, light, layers["matte"] == 0.0


def assert_as_bright(part: NDArray[np.bool_], drawn: Preview, light: Pixels) -> None:
    shown, expected = (float(each[part].mean(axis=0) @ LUMINANCE) for each in (drawn.picture, light))
    assert shown == pytest.approx(expected, rel=0.1, abs=0.01)


@pytest.mark.parametrize("name", SETS)
def test_a_set_looks_like_its_render(
    name: str, pebble: Surface, rendered: Callable[..., RenderedFrame]
) -> None:
    drawn, light, around = of_a_set(name, pebble, rendered)
    for part in (around & (drawn.nearness == 0.0), around & (drawn.nearness > 0.0)):
        if np.count_nonzero(part) > 50:
            assert_as_bright(part, drawn, light)


def test_the_wall_of_a_shelf_is_dark_where_its_boards_hide_the_light(
    pebble: Surface, rendered: Callable[..., RenderedFrame]
) -> None:
    drawn, light, around = of_a_set("shelf", pebble, rendered)
    below_the_board = np.zeros_like(around)
    below_the_board[:3] = True
    assert_as_bright(below_the_board, drawn, light)


@pytest.mark.parametrize(
    "daylight",
    [Daylight(), Daylight(elevation=0.1, turbidity=1.0), Daylight(elevation=1.5, turbidity=9.7, width=0.1)],
)
def test_the_sky_without_mitsubas_engine_is_mitsubas(daylight: Daylight, engine: Engine) -> None:
    directions = np.random.default_rng(5).normal(size=(64, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    strength = emitters.daylight_exposure(daylight)
    above, light = directions[:, 1] > 0.05, clear_sky.sky_radiance(daylight, directions)
    expected = emitters.daylight_map(replace(daylight, sun=0.0))
    rows, columns = expected.shape[:2]
    across = np.arctan2(directions[:, 0], -directions[:, 2]) / (2.0 * math.pi) % 1.0
    down = np.arccos(directions[:, 1]) / math.pi
    row, column = (down * rows).astype(int), (across * columns).astype(int)
    np.testing.assert_allclose(light[above], expected[row, column][above], rtol=0.05)
    assert not light[directions[:, 1] < 0.0].any()
    sun = strength * emitters.daylight_irradiances(daylight)[0]
    np.testing.assert_allclose(clear_sky.sun_irradiance(daylight), sun, rtol=0.05)
