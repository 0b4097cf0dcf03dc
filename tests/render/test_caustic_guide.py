"""Paths guided to caustics find the light that other paths find, with less noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.mitsuba.mitsuba_scene import build_scene
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LightRig, Softbox
from flowsculpt.render.scene.scene_stage import STAGES, Stage, StagePlacement
from flowsculpt.render.scene.sky import Daylight
from flowsculpt.render.scene.surface import Surface

SIZE = (48, 27)
SAMPLES = 512
"""Samples of the quality, by which photons are counted: 65,536 of them."""

LUMA = np.array([0.2126, 0.7152, 0.0722])
SOFTBOX = LightRig((Softbox((3.0, 5.0, 2.0), 1.0, 1.0, (60.0, 60.0, 60.0)),))


@pytest.fixture(scope="module")
def tracer(sphere: Surface, engine: Engine) -> Callable[..., Any]:
    if engine.variant == "scalar_rgb":
        pytest.skip("the plain variant follows Mitsuba's own paths")

    def build(look: str, lights: LightRig, samples: int = SAMPLES, stage: Stage = STAGES["cyclorama"]) -> Any:
        lens = Camera((3.2, 2.9, 8.8), (0.0, 0.0, 0.0))
        scene = Scene(sphere, LOOKS[look], lights, stage, StagePlacement((0.0, 0.0, 0.0), 1.0, 0.0), lens)
        with pytest.MonkeyPatch.context() as patch:  # photons would bring the caustics of smooth glass
            patch.setattr("flowsculpt.render.mitsuba.tracers.can_draw", lambda scene, sources: False)
            return build_scene(scene, Quality(*SIZE, samples=samples, depth=6)).beauty.path_tracer

    return build


@pytest.mark.parametrize(
    ("look", "lights"),
    [("glass", SOFTBOX), ("chrome", SOFTBOX), ("frosted", LightRig(daylight=Daylight(width=0.2)))],
    ids=["glass", "chrome", "rough glass in daylight"],
)
def test_guided_paths_find_the_light_that_others_find(
    look: str, lights: LightRig, tracer: Callable[..., Any]
) -> None:
    guided = tracer(look, lights)
    assert guided.guide is not None
    ours = guided.render(512, 0, 5)[..., :3] @ LUMA
    others = replace(guided, guide=None).render(1024, 0, 6)[..., :3] @ LUMA
    assert ours.mean() == pytest.approx(others.mean(), rel=0.01)
    ours, others = (each.reshape(3, 9, 6, 8).mean(axis=(1, 3)) for each in (ours, others))
    assert np.sqrt(((ours / others - 1.0) ** 2).mean()) < 0.03


def test_a_caustic_has_less_than_half_the_noise(tracer: Callable[..., Any]) -> None:
    guided = tracer("glass", SOFTBOX)
    noise = []
    for each in (guided, replace(guided, guide=None)):
        pictures = np.array([each.render(16, 0, seed)[..., :3] @ LUMA for seed in range(6)])
        noise.append(float(np.var(pictures, axis=0, ddof=1).mean()))
    assert noise[0] < 0.5 * noise[1]


def test_directions_come_with_their_density(tracer: Callable[..., Any]) -> None:
    import drjit as dr
    import mitsuba as mi

    guide = tracer("glass", SOFTBOX).guide
    cells, count = len(np.array(guide.fractions)), 1 << 16
    assert cells > 20
    random: Any = mi.PCG32(count)
    cell = mi.UInt32(cells - 1)
    everywhere = mi.warp.square_to_uniform_sphere(mi.Point2f(random.next_float32(), random.next_float32()))
    density = guide.pdf(cell, everywhere, mi.Bool(True))
    assert float(dr.mean(density)[0]) * 4.0 * np.pi == pytest.approx(1.0, rel=0.05)
    sampled = guide.sample(cell, mi.Point2f(random.next_float32(), random.next_float32()), mi.Bool(True))
    assert np.allclose(np.array(dr.norm(sampled)), 1.0, atol=1e-5)
    mean = np.array(everywhere * density).mean(axis=1) * 4.0 * np.pi
    assert np.array(sampled).mean(axis=1) == pytest.approx(mean, abs=0.03)


def test_the_guide_is_the_same_for_any_number_of_threads(tracer: Callable[..., Any]) -> None:
    import drjit as dr

    threads, pictures = dr.thread_count(), []
    for count in (1, 2):
        dr.set_thread_count(count)
        pictures.append(tracer("glass", SOFTBOX).render(4, 0, 5))
    dr.set_thread_count(threads)
    assert np.array_equal(*pictures)


def test_only_mirrors_and_glass_have_a_guide(tracer: Callable[..., Any]) -> None:
    assert tracer("clay", SOFTBOX).guide is None
    assert tracer("glaze", SOFTBOX).guide is None
    assert tracer("glass", SOFTBOX, stage=STAGES["none"]).guide is None, "nothing to throw light on"
    assert tracer("glass", SOFTBOX, samples=4).guide is None, "too few samples for photons"
    catcher = replace(STAGES["cyclorama"], shadow_catcher=True)
    assert tracer("glass", SOFTBOX, stage=catcher).guide is None
