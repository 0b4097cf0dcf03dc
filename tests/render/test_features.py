"""Auxiliary features: what the lens sees first, and what mirrors and glass show."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.mitsuba.mitsuba_scene import build_scene
from flowsculpt.render.post.denoise import denoise, denoiser_features
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS, Metal
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.surface import Surface

Rendered = Callable[..., RenderedFrame]

CAMERA = Camera((3.2, 2.9, 8.8), (0.0, 0.95, 0.0))


def test_a_mirror_shows_the_denoiser_the_floor_below_it(rendered: Rendered, engine: Engine) -> None:
    if engine.variant == "scalar_rgb":
        pytest.skip("the scalar variant follows no paths")
    mirror = rendered(look=LOOKS["chrome"])
    row, column = np.argwhere((mirror["matte"] == 1.0) & (mirror["normal"][..., 1] < -0.4))[0]
    assert mirror["denoise_normal"][row, column, 1] > 0.9
    assert mirror["albedo"][row, column] == pytest.approx(LOOKS["chrome"].colour, abs=1e-3)
    floor = mirror["albedo"][-1, 0]
    shown = floor * np.array(LOOKS["chrome"].colour)
    assert mirror["denoise_albedo"][row, column] == pytest.approx(shown, abs=0.02)
    outside = mirror["matte"] == 0.0
    assert np.array_equal(mirror["denoise_normal"][outside], mirror["normal"][outside])


@pytest.mark.parametrize("look", [LOOKS["clay"], LOOKS["glaze"], Metal((0.8, 0.8, 0.8), roughness=0.4)])
def test_rough_surfaces_need_no_further_features(rendered: Rendered, look: Any) -> None:
    assert "denoise_albedo" not in rendered(look=look).arrays


def test_the_albedo_of_glass_is_its_colour_and_behind_it_lies_the_stage(
    rendered: Rendered, engine: Engine
) -> None:
    clear = rendered(look=LOOKS["glass"])
    inside = clear["matte"] == 1.0
    assert np.abs(clear["albedo"][inside] - np.array(LOOKS["glass"].auxiliary_colour)).max() < 1e-3
    if engine.variant != "scalar_rgb":
        assert np.abs(clear["denoise_normal"] - clear["normal"])[inside].max() > 0.5
        assert clear["denoise_albedo"].max() <= 1.0


def test_the_matte_is_the_coverage_of_the_light(sphere: Surface, engine: Engine) -> None:
    if engine.variant == "scalar_rgb":
        pytest.skip("the scalar variant samples features by themselves")
    scene = Scene(sphere, LOOKS["clay"], LIGHTS["studio"], STAGES["none"], StagePlacement(), CAMERA)
    scenes = build_scene(scene, Quality(32, 18, samples=4, depth=3))
    alpha = scenes.beauty.path_tracer.render(4, 0, 7)[..., 5]
    assert np.array_equal(scenes.features.render(4, 0, 7)["matte"][..., 0], alpha)
    assert 0.0 < alpha.mean() < 1.0


def test_features_that_mirrors_and_glass_show_are_filtered(rendered: Rendered, engine: Engine) -> None:
    if engine.variant == "scalar_rgb":
        pytest.skip("the scalar variant follows no paths")
    for shown in (rendered(look=LOOKS[name]) for name in ("chrome", "glass")):
        features = denoiser_features(shown)
        assert not np.array_equal(features.albedo, shown["denoise_albedo"])
        assert not np.array_equal(features.normal, shown["denoise_normal"])


def test_a_pixel_that_is_not_finite_does_not_spoil_the_denoised_picture(picture: RenderedFrame) -> None:
    beauty = picture["beauty"].copy()
    beauty[3, 4], beauty[10, 20] = np.inf, np.nan
    spoiled = RenderedFrame({**picture.arrays, "beauty": beauty}, picture.facts)
    clean = denoise(spoiled)
    assert np.isfinite(clean).all()
    assert clean.mean() == pytest.approx(denoise(picture).mean(), rel=0.02)
