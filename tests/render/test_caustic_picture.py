"""Photons bring the sun's caustics that paths leave to them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from render.mitsuba.engine import Engine
from render.mitsuba.scene import build_scene
from render.scene.camera import Camera
from render.scene.light_groups import LightGroup
from render.scene.lights import LightRig, Softbox
from render.scene.materials import LOOKS
from render.scene.quality import Crop, Quality
from render.scene.scene import Scene
from render.scene.sky import Daylight
from render.scene.stage import STAGES, Stage, StagePlacement
from render.scene.surface import Surface

SIZE = (48, 27)
LUMA = np.array([0.2126, 0.7152, 0.0722])
SUN = LightRig(daylight=Daylight(width=0.2))
"""A sun so wide that paths find its caustics too."""

NOISE = 0.08
"""Greatest relative difference: the paths that find caustics have 1 to 3% of noise."""

PINHOLE = Camera((3.2, 2.9, 8.8), (0.0, 0.0, 0.0))
MATT, SHINY = STAGES["cyclorama"], replace(STAGES["cyclorama"], roughness=0.3)


@pytest.fixture(scope="module")
def tracer(sphere: Surface, engine: Engine) -> Callable[..., Any]:
    if engine.variant == "scalar_rgb":
        pytest.skip("the plain variant follows Mitsuba's own paths")

    def build(
        look: str,
        lights: LightRig = SUN,
        stage: Stage = MATT,
        lens: Camera = PINHOLE,
        crop: Crop | None = None,
        seed: int = 1,
    ) -> Any:
        scene = Scene(sphere, LOOKS[look], lights, stage, StagePlacement((0.0, 0.0, 0.0), 1.0, 0.0), lens)
        return build_scene(
            scene, Quality(*SIZE, samples=512, depth=6, crop=crop), seed=seed
        ).beauty.path_tracer

    return build


@pytest.mark.parametrize(
    ("look", "stage", "lens", "crop"),
    [
        ("glass", MATT, PINHOLE, None),
        ("glass", SHINY, PINHOLE, (4, 10, 40, 27)),
        ("chrome", MATT, PINHOLE, None),
        ("chrome", MATT, replace(PINHOLE, lens_radius=0.3, focus_distance=9.0), None),
    ],
    ids=["glass", "glass on a shiny floor, cropped", "chrome", "chrome out of focus"],
)
def test_photons_bring_the_light_that_paths_leave_to_them(
    look: str, stage: Stage, lens: Camera, crop: Crop | None, tracer: Callable[..., Any]
) -> None:
    from render.integrator.caustic_guide import guide_of
    from render.integrator.photons import trace_photons

    ours = tracer(look, stage=stage, lens=lens, crop=crop)
    photons = ours.caustics @ LUMA
    light = trace_photons(ours.scene, ours.light_sampler, ours.caustic_sun, ours.max_depth, 1 << 16)
    assert light is not None
    guide = guide_of(light)
    all_light = replace(ours, caustics=None, guide=guide).render(1024, 0, 5)[..., :3] @ LUMA
    nothing = np.zeros_like(ours.caustics)
    left = replace(ours, caustics=nothing, guide=guide).render(1024, 0, 5)[..., :3] @ LUMA
    by_paths = all_light - left
    assert photons.mean() > 0.001 * all_light.mean()
    assert photons.mean() == pytest.approx(by_paths.mean(), rel=NOISE)
    others = tracer(look, stage=stage, lens=lens, crop=crop, seed=2).caustics @ LUMA
    bright = others > np.quantile(others, 0.9)
    assert photons[bright].mean() == pytest.approx(by_paths[bright].mean(), rel=NOISE)


def test_light_groups_sum_to_all_light(tracer: Callable[..., Any]) -> None:
    groups = (LightGroup("sun", ("sun",)), LightGroup("rest", ("sky", "background")))
    picture = tracer("glass", replace(SUN, groups=groups)).render(4, 0, 5)
    sun, rest = (
        tracer("glass", replace(SUN, groups=groups)).caustics.reshape(*SIZE[::-1], 2, 3).sum((0, 1, 3))
    )
    assert sun > 10.0 * rest
    assert picture[..., 5:8] + picture[..., 8:11] == pytest.approx(picture[..., :3], rel=1e-5)


def test_chosen_pixels_get_their_own_light(tracer: Callable[..., Any]) -> None:
    ours, pixels = tracer("glass"), np.arange(900, 1000)
    assert np.array_equal(ours.render(4, 0, 5, pixels), ours.render(4, 0, 5).reshape(-1, 8)[pixels][:, :])


def test_a_caustic_has_less_than_a_tenth_of_the_noise(tracer: Callable[..., Any]) -> None:
    ours = tracer("glass", LightRig(daylight=Daylight()))
    floor = ours.caustics @ LUMA > np.quantile(ours.caustics @ LUMA, 0.8)
    noise = []
    for each in (ours, replace(ours, caustics=None)):
        pictures = np.array([each.render(16, 0, seed)[..., :3] @ LUMA for seed in range(6)])
        noise.append(float(np.var(pictures, axis=0, ddof=1)[floor].mean()))
    others = np.array(
        [tracer("glass", LightRig(daylight=Daylight()), seed=n).caustics @ LUMA for n in range(4)]
    )
    noise[0] += float(np.var(others, axis=0, ddof=1)[floor].mean())
    assert noise[0] < 0.1 * noise[1]


def test_photons_are_the_same_for_any_number_of_threads(tracer: Callable[..., Any]) -> None:
    import drjit as dr

    threads, pictures = dr.thread_count(), []
    for count in (1, 2):
        dr.set_thread_count(count)
        pictures.append(tracer("chrome").caustics)
    dr.set_thread_count(threads)
    assert np.array_equal(*pictures)


def test_paths_find_what_photons_would_not(tracer: Callable[..., Any]) -> None:
    softbox = Softbox((3.0, 5.0, 2.0), 1.0, 1.0, (60.0, 60.0, 60.0))
    assert tracer("clay").caustics is None, "matt"
    assert tracer("frosted").caustics is None, "rough glass"
    assert tracer("glass", replace(SUN, softboxes=(softbox,))).caustics is None, "a softbox too"
    assert tracer("glass", stage=replace(MATT, shadow_catcher=True)).caustics is None
    assert not tracer("glass", stage=STAGES["none"]).caustics.any(), "nothing to throw light on"
