"""Rays to softboxes leave out the cyclorama around everything, which changes no bit of a picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.mitsuba.mitsuba_scene import build_scene
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS
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
    assert (tracer.occluders is not None) == is_left_out
    if is_left_out:
        names = {shape.id() for shape in tracer.occluders.shapes()}
        assert names == {shape.id() for shape in tracer.scene.shapes()} - {"stage"}
