"""Our own paths find the light that Mitsuba's find, with less noise the longer they go on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flowsculpt.render.mitsuba.emitters import _distant
from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.mitsuba.mitsuba_scene import SceneRenderer, build_scene
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS, LightRig, Sky, Softbox, Sun, sampled_emitters
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.sky import Daylight, Environment
from flowsculpt.render.scene.surface import Surface

SIZE = (48, 27)
QUALITY = Quality(*SIZE, samples=16, depth=4, auxiliary_samples=4)
LUMA = np.array([0.2126, 0.7152, 0.0722])
MANY = LightRig(
    tuple(
        Softbox((4.0 * x, 4.0, 4.0 * z), 1.0, 1.0, (12.0, 12.0, 12.0))
        for x, z in ((1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1))
    )
)


@pytest.fixture(scope="module")
def built(sphere: Surface, engine: Engine) -> Callable[..., SceneRenderer]:
    if engine.variant == "scalar_rgb":
        pytest.skip("the plain variant follows Mitsuba's own paths")

    def build(look: str = "clay", lights: LightRig = LIGHTS["studio"], depth: int = 4) -> SceneRenderer:
        placement = StagePlacement((3.0, -1.0, 2.0), 1.0, 0.4)
        moved = replace(sphere, vertices=(sphere.vertices + np.float32([3.0, -1.0, 2.0])).astype(np.float32))
        lens = Camera((6.2, 1.9, 10.8), (3.0, -0.05, 2.0))
        stage = STAGES["cyclorama"]
        scene = Scene(moved, LOOKS[look], lights, stage, placement, lens)
        return build_scene(scene, Quality(*SIZE, samples=256, depth=depth)).beauty

    return build


def blocks(picture: np.ndarray) -> np.ndarray:
    """Means of 9 × 8 pixels, which are less noisy."""
    return np.asarray(picture[:27, :48, :3].reshape(3, 9, 6, 8, 3).mean(axis=(1, 3)))


@pytest.mark.parametrize(
    ("look", "lights", "within"),
    [
        ("clay", LIGHTS["studio"], 0.01),
        ("glaze", LIGHTS["gallery"], 0.01),
        ("glass", LIGHTS["three_point"], 0.04),
        ("frosted", LIGHTS["studio"], 0.02),
        ("putty", LightRig(daylight=Daylight()), 0.01),
        ("clay", LightRig(daylight=Daylight(sky=0.0)), 0.01),
        ("clay", LightRig(suns=(Sun((-1.0, -1.0, -0.5), (2.0, 2.0, 1.5)),), sky=Sky((0.1, 0.2, 0.3))), 0.01),
        ("clay", LightRig(sky=Sky((0.4, 0.5, 0.6), (0.4, 0.5, 0.6), (0.4, 0.5, 0.6), visible=True)), 0.01),
        ("putty", MANY, 0.01),
    ],
    ids=["studio", "gallery", "glass", "frosted", "daylight", "no sky", "sun", "sky", "many lamps"],
)
def test_they_find_the_same_light_as_mitsuba(
    look: str, lights: LightRig, within: float, built: Callable[..., SceneRenderer]
) -> None:
    """Glass gathers it in sparks, of which its mean hangs."""
    scene = built(look, lights)
    ours, theirs = scene.path_tracer.render(256, 0, 5)[..., :3], scene.render(1024, 6)
    assert ours.mean() == pytest.approx(theirs.mean(), rel=within)
    light = np.maximum(blocks(theirs), 0.05 * theirs.mean())
    assert np.sqrt((((blocks(ours) - blocks(theirs)) / light) ** 2).mean()) < 3.0 * within


def test_a_map_of_a_place_is_looked_for_and_a_plain_sky_is_not(tmp_path: Path) -> None:
    place = LightRig(environment=Environment("0" * 64, path=str(tmp_path / "place.exr")))
    assert [emitter.name for emitter in sampled_emitters(place, np.eye(4))] == ["sky"]
    assert [emitter.name for emitter in sampled_emitters(LIGHTS["softbox"], np.eye(4))] == ["softbox0"]


@pytest.mark.parametrize("daylight", [Daylight(), Daylight(elevation=0.5, azimuth=1.0), Daylight(width=0.1)])
def test_the_disc_of_a_sun_gives_the_light_that_mitsuba_samples(daylight: Daylight, engine: Engine) -> None:
    """Mitsuba rounds the rim of the disc, by up to 0.4% of its light."""
    if engine.variant == "scalar_rgb":
        pytest.skip("Mitsuba's own integrators serve the scalar variant")
    import drjit as dr
    import mitsuba as mi

    from flowsculpt.render.integrator.light_sampler import Cone

    emitter: Any = mi.load_dict(_distant(LightRig(daylight=replace(daylight, sky=0.0))))
    cone = Cone(daylight.direction, daylight.width, emitter)
    random: Any = mi.PCG32(1 << 20)
    numbers = mi.Point2f(random.next_float32(), random.next_float32())
    si = dr.zeros(mi.SurfaceInteraction3f, 1 << 20)
    theirs = np.array(emitter.sample_direction(si, numbers)[1], dtype=np.float64).mean()
    direction, density = cone.sample(numbers)
    si.wi = -direction
    ours = np.array(emitter.eval(si) * cone.correction / density, dtype=np.float64).mean()
    assert ours == pytest.approx(theirs, rel=1e-3)


def test_errors_fall_faster_than_those_of_passes_that_know_nothing_of_each_other(
    built: Callable[..., SceneRenderer],
) -> None:
    scene = built()
    truth = scene.path_tracer.render(1024, 0, 77)[..., :3] @ LUMA
    passes = [
        [scene.path_tracer.render(16, 16 * number, seed)[..., :3] @ LUMA for number in range(4)]
        for seed in range(4)
    ]
    one = np.mean([(each[0] - truth) ** 2 for each in passes])
    four = np.mean([(np.mean(each, axis=0) - truth) ** 2 for each in passes])
    assert four < one / 5.0  # a quarter, did they know nothing
    theirs = np.mean([(scene.render(16, seed)[..., :3] @ LUMA - truth) ** 2 for seed in range(4)])
    assert one < theirs / 1.5


def test_a_pass_of_sixteen_is_four_of_four(built: Callable[..., SceneRenderer]) -> None:
    light = built().path_tracer
    whole = light.render(16, 0, 5)
    parts = np.mean([light.render(4, first, 5) for first in (0, 4, 8, 12)], axis=0)
    assert np.allclose(whole, parts, rtol=1e-4, atol=1e-5)


def test_some_pixels_alone_are_those_of_all_pixels(built: Callable[..., SceneRenderer]) -> None:
    tracer = built("glaze").path_tracer
    whole = tracer.render(4, 4, 5)
    some = np.flatnonzero(np.random.default_rng(3).random(whole[..., 0].size) < 0.3)
    assert np.array_equal(tracer.render(4, 4, 5, some), whole.reshape(-1, whole.shape[2])[some])


def test_a_sequence_that_has_ended_goes_on_with_other_numbers(built: Callable[..., SceneRenderer]) -> None:
    light = built().path_tracer
    assert not np.allclose(light.render(4, 0, 5), light.render(4, 1024, 5), rtol=1e-2)


def test_pixels_know_nothing_of_each_other(built: Callable[..., SceneRenderer]) -> None:
    """Or a denoiser would take what they have in common for a pattern."""
    light = built().path_tracer
    truth = light.render(1024, 0, 77)[..., :3] @ LUMA
    off = np.stack([light.render(4, 0, seed)[..., :3] @ LUMA - truth for seed in range(32)])
    off /= off.std(axis=0) + 1e-6
    for one, other in ((off[:, :, 1:], off[:, :, :-1]), (off[:, 1:], off[:, :-1]), (off[1:], off[:-1])):
        assert abs((one * other).mean()) < 0.03


def test_a_part_has_the_noise_of_the_whole(rendered: Callable[..., RenderedFrame], engine: Engine) -> None:
    if engine.variant == "scalar_rgb":
        pytest.skip("there random numbers belong to places in what is rendered")
    whole = rendered(quality=QUALITY)["beauty"]
    part = rendered(quality=replace(QUALITY, crop=(10, 5, 34, 21)))["beauty"]
    inner = slice(6, 20), slice(11, 33)  # sparkles are looked for among neighbours
    assert np.allclose(part[1:-1, 1:-1], whole[inner], rtol=1e-3, atol=1e-5)
