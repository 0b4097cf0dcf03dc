"""Light groups sum to the beauty, and a scaled group is the light of a scaled emitter."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.mitsuba.mitsuba_scene import build_scene
from flowsculpt.render.post.image import read_exr, write_exr
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS, LightRig, Sky, Softbox, Sun, groups_in, with_beauty
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.sky import Daylight
from tests.render.conftest import CAMERA, ball

QUALITY = Quality(48, 27, samples=16, depth=4, auxiliary_samples=1)
WHITE = (1.0, 1.0, 1.0)


def assert_sums_exactly(frame: RenderedFrame, folder: Path) -> None:
    """Assert that the groups of a frame, as they are in a file, sum to the beauty in the file."""
    write_exr(folder / "frame.exr", frame, {})
    layers = read_exr(folder / "frame.exr")[0]
    groups = groups_in(layers.arrays)
    total = sum(groups.values(), np.zeros_like(layers["beauty"]))
    assert groups and np.array_equal(total.clip(-65504, 65504).astype(np.float16), layers["beauty"])


@given(st.lists(arrays(np.float64, (2, 3, 3), elements=st.floats(-1e-3, 1e6)), min_size=1, max_size=5))
def test_groups_of_any_brightness_sum_to_the_beauty_to_the_last_bit(pictures: list[np.ndarray]) -> None:
    layers = with_beauty({f"g{number}": picture for number, picture in enumerate(reversed(pictures))})
    total = sum(groups_in(layers).values(), np.zeros((2, 3, 3), np.float32))
    assert np.array_equal(total, layers["beauty"]) and np.isfinite(total).all()


@pytest.mark.parametrize(
    ("convention", "channel"),
    [("blender", "ViewLayer.Combined_key.R"), ("arnold", "RGBA_key.R"), ("nuke", "light_key.R")],
)
def test_groups_have_the_names_of_other_programs(convention: str, channel: str, tmp_path: Path) -> None:
    layers = with_beauty({"key": np.full((2, 3, 3), 0.3), "rim": np.full((2, 3, 3), 0.1)})
    write_exr(tmp_path / "a.exr", RenderedFrame(layers), {}, convention=convention)
    assert channel in oiio.ImageInput.open(str(tmp_path / "a.exr")).spec().channelnames
    assert groups_in(read_exr(tmp_path / "a.exr")[0].arrays).keys() == {"key", "rim"}


@pytest.mark.parametrize(
    "lights",
    [
        LIGHTS["studio"].grouped({}),
        LIGHTS["gallery"].grouped({"sides": ["left", "right"], "others": ["top", "sky"]}),
        LightRig(suns=(Sun((-1.0, -1.0, -0.5), WHITE),), sky=Sky(WHITE, WHITE, WHITE, True)).grouped({}),
        LightRig((Softbox((0.0, 4.0, 4.0), 1.0, 1.0, (20.0, 20.0, 20.0)),)).grouped({}),
    ],
    ids=["each", "named", "sun and visible sky", "one light"],
)
def test_groups_of_a_file_sum_to_its_beauty(
    lights: LightRig, rendered: Callable[..., RenderedFrame], tmp_path: Path
) -> None:
    frame = rendered(lights=lights, quality=QUALITY, look=LOOKS["glaze"])
    assert {group.layer for group in lights.groups} <= frame.arrays.keys()
    assert_sums_exactly(frame, tmp_path)


def test_a_frame_without_groups_has_the_light_of_one_with_them(
    rendered: Callable[..., RenderedFrame],
) -> None:
    plain, grouped = rendered(quality=QUALITY), rendered(quality=QUALITY, lights=LIGHTS["studio"].grouped({}))
    assert not groups_in(plain.arrays)
    assert np.allclose(plain["beauty"], grouped["beauty"], rtol=2e-3, atol=1e-4)


@pytest.mark.parametrize(
    "rig", [LIGHTS["studio"].grouped({"cool": ["rim", "sky"]}), LIGHTS["daylight"].grouped({})]
)
def test_each_light_has_its_own_group(rig: LightRig, rendered: Callable[..., RenderedFrame]) -> None:
    """A render of that light alone gives the same picture, but for noise."""
    groups = groups_in(rendered(lights=rig, quality=QUALITY).arrays)
    for group in rig.groups[:2]:
        alone = rendered(lights=rig.only(group).grouped({}), quality=QUALITY)["beauty"]
        assert groups[group.name].mean() == pytest.approx(alone.mean(), rel=0.03)


def test_a_brighter_group_is_the_light_of_a_brighter_emitter(rendered: Callable[..., RenderedFrame]) -> None:
    rig = LIGHTS["three_point"].grouped({})
    groups = groups_in(rendered(lights=rig, quality=QUALITY).arrays)
    mixed = sum((3.0 if name == "rim" else 1.0) * light for name, light in groups.items())
    brighter = rendered(lights=rig.dimmed({"rim": 3.0}), quality=QUALITY)["beauty"]
    assert np.asarray(mixed).mean() == pytest.approx(brighter.mean(), rel=0.01)
    assert np.abs(mixed - brighter).mean() < 0.05 * brighter.mean()


@pytest.mark.parametrize("daylight", [False, True])
def test_the_sky_that_the_lens_sees_is_a_group_of_its_own(
    daylight: bool, rendered: Callable[..., RenderedFrame], tmp_path: Path
) -> None:
    """A low sun stands in the picture; a softbox is seen too, and stays in its group."""
    box = Softbox((-1.5, 1.5, -2.0), 1.0, 1.0, (2.0, 1.0, 0.5), target=(0.0, 1.0, 3.0), name="key")
    sun = Daylight(math.radians(12.0), math.pi + 0.14, width=0.02) if daylight else None
    rig = LightRig((box,), sky=Sky(WHITE, WHITE, WHITE, True), daylight=sun).grouped({})
    # The matte is that of the beauty's samples, and no firefly is spread.
    quality = replace(QUALITY, auxiliary_samples=16, fireflies="keep")
    camera = Camera((0.0, 0.5, 9.0), (0.0, 2.0, 0.0))
    frame = rendered(lights=rig, quality=quality, stage=STAGES["none"], camera=camera)
    groups, beside = groups_in(frame.arrays), frame["matte"] == 0.0
    assert_sums_exactly(frame, tmp_path)
    assert not groups["background"][frame["matte"] == 1.0].any() and not groups["sky"][beside].any()
    assert (groups["key"][beside].max(axis=1) > 1.0).mean() < 0.1  # the box
    seen = frame["beauty"] - groups["key"]
    assert np.allclose(groups["background"][beside], seen[beside], rtol=1e-3)
    assert groups["background"].max() > (1e3 if daylight else 0.9)
    assert not daylight or not groups["sun"][beside].any()


def test_a_visible_sky_can_be_of_the_group_of_its_light() -> None:
    rig = LIGHTS["daylight"].grouped({"distant": ["sky", "background"]})
    assert [group.name for group in rig.groups] == ["distant", "sun"]
    assert "background" not in [group.name for group in LIGHTS["studio"].grouped({}).groups]


def test_groups_of_smoke_sum_to_its_light(engine: Engine) -> None:
    """Mitsuba's integrator renders each group by itself, along the same paths."""
    rig = replace(LIGHTS["softbox"], sky=Sky(WHITE, WHITE, WHITE, True)).grouped({})
    scene = Scene(ball(), LOOKS["smoke"], rig, STAGES["none"], StagePlacement(), CAMERA)
    renderer = build_scene(scene, Quality(32, 18, samples=4, depth=4)).beauty
    radiance = renderer.render(4, 5)[..., :3]
    groups = dict(
        zip([group.name for group in rig.groups], renderer.render_groups(4, 5, radiance), strict=True)
    )
    assert np.allclose(sum(groups.values()), radiance, rtol=1e-4, atol=1e-5)
    above = [groups[name][0] for name in ("background", "sky")]
    assert (above[0] == 1.0).all() and not above[1].any() and groups["sky"].max() > 0.1


def test_a_look_that_is_drawn_without_lights_has_no_groups(rendered: Callable[..., RenderedFrame]) -> None:
    with pytest.raises(BadInputError, match=r"no light groups\. Remove light_groups"):
        rendered(look=LOOKS["symbolics_1990"], lights=LIGHTS["studio"].grouped({}))
