"""Rays to softboxes leave out the cyclorama around everything, which changes no bit of a picture."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from flowsculpt.render.mitsuba.emitters import shadowing_softboxes
from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.mitsuba.mitsuba_scene import build_scene
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS, LightRig, Softbox
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.surface import Surface

QUALITY = Quality(64, 36, samples=4, depth=4, auxiliary_samples=1)
CAMERA = Camera((3.2, 2.9, 8.8), (0.0, 0.95, 0.0))


@pytest.fixture(autouse=True)
def _always_pays(engine: Engine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flowsculpt.render.mitsuba.tracers.SAMPLES_PER_FACE", 0)


@pytest.mark.parametrize(
    ("stage", "look"), [("cyclorama", "clay"), ("plinth", "chrome"), ("turntable", "glaze")]
)
def test_a_picture_is_the_same_without_the_cyclorama_in_the_way(
    rendered: Callable[..., RenderedFrame], monkeypatch: pytest.MonkeyPatch, stage: str, look: str
) -> None:
    arguments = {"stage": STAGES[stage], "look": LOOKS[look], "quality": QUALITY}
    without = rendered(**arguments)
    monkeypatch.setattr("flowsculpt.render.mitsuba.tracers.SAMPLES_PER_FACE", 10**9)
    assert np.array_equal(rendered(**arguments)["beauty"], without["beauty"])


@pytest.mark.parametrize(
    ("lights", "stage", "camera", "is_left_out"),
    [
        ("studio", "cyclorama", CAMERA, True),
        ("gallery", "plinth", CAMERA, True),
        ("studio", "none", CAMERA, False),
        ("studio", "ground", CAMERA, False),
        ("daylight", "cyclorama", CAMERA, False),
        ("studio", "cyclorama", replace(CAMERA, origin=(3.2, -2.0, 8.8)), False),
        ("studio", "cyclorama", replace(CAMERA, lens_radius=4.0), False),
    ],
)
def test_only_a_cyclorama_around_lens_and_softboxes_is_left_out(
    sphere: Surface, engine: Engine, lights: str, stage: str, camera: Camera, is_left_out: bool
) -> None:
    if engine.variant == "scalar_rgb":
        pytest.skip("there Mitsuba's integrators render the light")
    scene = Scene(sphere, LOOKS["clay"], LIGHTS[lights], STAGES[stage], StagePlacement(), camera)
    tracer = build_scene(scene, QUALITY).beauty.path_tracer
    left = tracer.scene if tracer.occluders is None else tracer.occluders
    everything, names = ({shape.id() for shape in each.shapes()} for each in (tracer.scene, left))
    softboxes = set(shadowing_softboxes(scene, QUALITY.size))
    assert everything - names == softboxes | ({"stage"} if is_left_out else set())


def test_a_softbox_that_the_lens_does_not_see_takes_no_light_from_others(
    rendered: Callable[..., RenderedFrame], engine: Engine
) -> None:
    if engine.variant == "scalar_rgb":
        pytest.skip("there Mitsuba's integrators render the light")
    key = Softbox((-2.6, 9.0, -2.5), 0.6, 0.6, (400.0,) * 3, target=(1.0, 0.0, -2.5))
    before_key = Softbox((-0.2, 3.0, -2.5), 1.0, 1.0, (1e-3,) * 3, target=(-0.2, 9.0, -2.5))
    quality = replace(QUALITY, samples=64)

    right, up, _ = CAMERA.project([[1.0, 0.0, -2.5]], 64 / 36)[0]
    column, row = int(32.0 * (1.0 + right)), int(18.0 * (1.0 - up))

    def shown(*boxes: Softbox) -> float:
        picture = rendered(lights=LightRig(boxes), quality=quality)["beauty"]
        return float(picture[row - 1 : row + 2, column - 2 : column + 3].mean())

    alone = shown(key)
    assert shown(key, before_key) == pytest.approx(alone, rel=0.02)
    assert shown(key, replace(before_key, visible=True)) < 0.8 * alone


@pytest.mark.parametrize("rig", ["studio", "three_point", "softbox", "daylight", "porcelain"])
def test_the_usual_camera_sees_no_shadow_of_the_softboxes_of_a_rig(rig: str, sphere: Surface) -> None:
    camera = Camera((0.0, 2.6, 6.6), (0.0, 0.95, 0.0), field_of_view=math.radians(26.0))
    scene = Scene(sphere, LOOKS["clay"], LIGHTS[rig], STAGES["cyclorama"], StagePlacement(), camera)
    assert shadowing_softboxes(scene, (64, 36)) == []
