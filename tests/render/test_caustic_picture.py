"""Photons bring the caustics that paths leave to them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.mitsuba.mitsuba_scene import build_scene
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Crop, Quality
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LightGroup, LightRig, Softbox, Sun
from flowsculpt.render.scene.scene_stage import STAGES, Stage, StagePlacement
from flowsculpt.render.scene.sky import Daylight
from flowsculpt.render.scene.surface import Surface

SIZE = (48, 27)
LUMA = np.array([0.2126, 0.7152, 0.0722])
SUN = LightRig(daylight=Daylight(width=0.2))
"""A sun so wide that paths find its caustics too."""

BOXES = LightRig(
    (
        Softbox((3.0, 5.0, 2.0), 1.0, 1.0, (60.0, 50.0, 40.0), name="key"),
        Softbox((-4.0, 3.0, 1.0), 2.0, 1.0, (20.0, 25.0, 30.0), name="fill"),
    )
)
BEFORE_THE_LENS = LightRig((*BOXES.softboxes, Softbox((1.6, 2.0, 4.0), 1.5, 1.5, (3.0, 3.0, 3.0))))
BOTH = replace(BOXES, daylight=SUN.daylight)

NOISE = {"glass": 0.06, "chrome": 0.05}
"""Greatest relative differences: paths that find caustics have 1 to 2% of noise, more on a shiny floor."""

PINHOLE = Camera((3.2, 2.9, 8.8), (0.0, 0.0, 0.0))
WIDE_OPEN = replace(PINHOLE, lens_radius=0.3, focus_distance=9.0)
MATT, SHINY = STAGES["cyclorama"], replace(STAGES["cyclorama"], roughness=0.3)


@pytest.fixture(scope="module")
def new_tracer(sphere: Surface, engine: Engine) -> Callable[..., Any]:
    """Return a function that traces the photons of a scene, for paths that are to be rendered with them."""
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


@pytest.fixture(scope="module")
def tracer(new_tracer: Callable[..., Any]) -> Callable[..., Any]:
    """Return `new_tracer`, which traces the photons of each scene once for all tests."""
    return cache(new_tracer)


def guide(ours: Any) -> Any:
    """Return a guide for the paths that find caustics."""
    from flowsculpt.render.integrator.caustic_guide import guide_of
    from flowsculpt.render.integrator.photons import trace_photons

    light = trace_photons(ours.scene, ours.light_sampler, ours.caustic_sun, ours.max_depth, 1 << 16)
    assert light is not None
    return guide_of(light)


@pytest.mark.parametrize(
    ("look", "lights", "stage", "lens", "crop"),
    [
        pytest.param("glass", SUN, MATT, PINHOLE, None, marks=pytest.mark.soak),
        ("glass", SUN, SHINY, PINHOLE, (4, 10, 40, 27)),
        pytest.param("chrome", SUN, MATT, PINHOLE, None, marks=pytest.mark.soak),
        ("chrome", SUN, MATT, WIDE_OPEN, None),
        pytest.param("glass", BOXES, MATT, PINHOLE, None, marks=pytest.mark.soak),
        ("chrome", BEFORE_THE_LENS, SHINY, PINHOLE, None),
        ("glass", BOTH, MATT, PINHOLE, None),
    ],
    ids=[
        *("glass", "glass on a shiny floor, cropped", "chrome", "chrome out of focus"),
        *("glass in a studio", "chrome on a shiny floor behind a softbox"),
        "glass by daylight and softboxes",
    ],
)
def test_photons_bring_the_light_that_paths_leave_to_them(
    look: str, lights: LightRig, stage: Stage, lens: Camera, crop: Crop | None, tracer: Callable[..., Any]
) -> None:
    others = tracer(look, lights, stage=stage, lens=lens, crop=crop, seed=2).caustics.radiance @ LUMA
    ours = tracer(look, lights, stage=stage, lens=lens, crop=crop)
    photons = ours.caustics.radiance @ LUMA
    guided = replace(ours, guide=guide(ours))
    all_light = replace(guided, caustics=None).render(1024, 0, 5)[..., :3] @ LUMA
    elsewhere = replace(ours.caustics.behind, middle=ours.caustics.behind.middle + 1e6)  # paths find the rest
    nothing = replace(ours.caustics, radiance=np.zeros_like(ours.caustics.radiance), behind=elsewhere)
    left = replace(guided, caustics=nothing).render(1024, 0, 5)[..., :3] @ LUMA
    by_paths = all_light - left
    assert photons.mean() > 0.001 * all_light.mean()
    assert photons.mean() == pytest.approx(by_paths.mean(), rel=NOISE[look])
    bright = others > np.quantile(others, 0.9)
    assert photons[bright].mean() == pytest.approx(by_paths[bright].mean(), rel=NOISE[look])


@pytest.mark.parametrize(
    ("look", "lights"),
    [
        pytest.param("glass", SUN, marks=pytest.mark.soak),
        ("glass", BOXES),
        ("chrome", SUN),
        pytest.param("chrome", BOXES, marks=pytest.mark.soak),
    ],
    ids=["glass in daylight", "glass in a studio", "chrome in daylight", "chrome in a studio"],
)
def test_caustics_behind_mirrors_and_glass_are_as_bright_as_by_paths(
    look: str, lights: LightRig, tracer: Callable[..., Any]
) -> None:
    ours = tracer(look, lights)
    by_photons = ours.render(512, 0, 5)
    by_paths = replace(ours, caustics=None, guide=guide(ours)).render(1024, 0, 6)
    behind = by_paths[..., 6] > 0.99  # seen in or through the sphere
    light, others = (picture[behind][:, :3] @ LUMA for picture in (by_photons, by_paths))
    assert light.mean() == pytest.approx(others.mean(), rel=0.01)
    nothing = replace(ours.caustics.behind, irradiances=0.0 * ours.caustics.behind.irradiances)
    dark = (
        replace(ours, caustics=replace(ours.caustics, behind=nothing)).render(512, 0, 5)[behind][:, :3] @ LUMA
    )
    assert light.mean() > 1.003 * dark.mean(), "a caustic is there to see"


def test_caustics_behind_glass_have_less_than_a_tenth_of_the_noise(tracer: Callable[..., Any]) -> None:
    tracers = [tracer("glass", LightRig(daylight=Daylight()), seed=seed) for seed in range(6)]
    noise = []
    for by_photons in (True, False):
        paths = tracers if by_photons else [replace(ours, caustics=None) for ours in tracers]
        pictures = [ours.render(16, 0, seed) for seed, ours in enumerate(paths)]
        behind = pictures[0][..., 6] > 0.99
        noise.append(float(np.var([each[behind][:, :3] @ LUMA for each in pictures], axis=0).mean()))
    assert noise[0] < 0.1 * noise[1]


@pytest.mark.usefixtures("engine")
def test_a_map_has_the_light_of_all_its_photons() -> None:
    """On a floor, by cells of all widths, some of them within others."""
    import drjit as dr
    import mitsuba as mi

    from flowsculpt.render.integrator.caustic_map import CausticMap

    random = np.random.default_rng(3)
    spread = np.concatenate([random.normal(0.0, width, (n, 2)) for width, n in ((0.1, 4000), (1.0, 900))])
    places = np.stack([spread[:, 0], np.zeros(len(spread)), spread[:, 1]], axis=1).astype(np.float32)
    light = random.random((len(places), 3))
    up = np.tile(np.float32([0.0, 1.0, 0.0]), (len(places), 1))
    found = CausticMap.of((mi.Point3f(0.0), mi.Float(1.0)), places, up, light)
    side = np.float32((np.arange(1024) + 0.5 - 512 - 0.37) / 64.0)
    x, z = np.meshgrid(side, side)
    value = found._value(mi.Point3f(x.ravel(), 0.0, z.ravel()), mi.Bool(True))
    irradiance = dr.gather(mi.Color3f, found.irradiances, value)
    assert np.unique(np.array(dr.gather(mi.Float, found.widths, value))).size == 4
    total = np.array([np.array(channel).sum(dtype=np.float64) for channel in irradiance]) / 64.0**2
    assert total == pytest.approx(light.sum(axis=0), rel=1e-3)


def test_light_groups_sum_to_all_light(tracer: Callable[..., Any]) -> None:
    groups = (LightGroup("sun", ("sun",)), LightGroup("rest", ("sky", "background")))
    ours = tracer("glass", replace(SUN, groups=groups))
    picture = ours.render(4, 0, 5)
    sun, rest = ours.caustics.radiance.reshape(*SIZE[::-1], 2, 3).sum((0, 1, 3))
    assert sun > 10.0 * rest
    assert picture[..., 5:8] + picture[..., 8:11] == pytest.approx(picture[..., :3], rel=1e-5)


def test_chosen_pixels_get_their_own_light(tracer: Callable[..., Any]) -> None:
    ours, pixels = tracer("glass"), np.arange(900, 1000)
    assert np.array_equal(ours.render(4, 0, 5, pixels), ours.render(4, 0, 5).reshape(-1, 8)[pixels][:, :])


def test_a_caustic_has_less_than_a_tenth_of_the_noise(tracer: Callable[..., Any]) -> None:
    ours = tracer("glass", LightRig(daylight=Daylight()), seed=1)
    floor = ours.caustics.radiance @ LUMA > np.quantile(ours.caustics.radiance @ LUMA, 0.8)
    noise = []
    for each in (ours, replace(ours, caustics=None)):
        pictures = np.array([each.render(16, 0, seed)[..., :3] @ LUMA for seed in range(6)])
        noise.append(float(np.var(pictures, axis=0, ddof=1)[floor].mean()))
    others = np.array(
        [tracer("glass", LightRig(daylight=Daylight()), seed=n).caustics.radiance @ LUMA for n in range(4)]
    )
    noise[0] += float(np.var(others, axis=0, ddof=1)[floor].mean())
    assert noise[0] < 0.1 * noise[1]


def test_photons_of_all_frames_share_compiled_code(new_tracer: Callable[..., Any]) -> None:
    """Each frame has another number of photons that the lens sees."""
    import drjit as dr

    def code(seed: int) -> set[str]:
        dr.kernel_history_clear()
        new_tracer("glass", BOTH, lens=WIDE_OPEN, seed=seed)
        return {str(each["hash"]) for each in dr.kernel_history() if "operation_count" in each}

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        code(1)
        assert code(2) == code(3)


def test_photons_are_the_same_for_any_number_of_threads(new_tracer: Callable[..., Any]) -> None:
    import drjit as dr

    threads, pictures = dr.thread_count(), []
    for count in (1, 2):
        dr.set_thread_count(count)
        pictures.append(new_tracer("chrome").caustics.radiance)
    dr.set_thread_count(threads)
    assert np.array_equal(*pictures)


def test_paths_find_what_photons_would_not(tracer: Callable[..., Any]) -> None:
    distant = Sun((-0.3, -1.0, -0.2), (3.0, 3.0, 3.0))
    assert tracer("clay").caustics is None, "matt"
    assert tracer("frosted").caustics is None, "rough glass"
    assert tracer("glass", replace(BOXES, suns=(distant,))).caustics is None, "paths find none of a point's"
    assert tracer("glass", stage=replace(MATT, shadow_catcher=True)).caustics is None
    assert not tracer("glass", stage=STAGES["none"]).caustics.radiance.any(), "nothing to throw light on"
