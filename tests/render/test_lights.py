"""Lights come from where they are said to, as strongly as they are said to."""

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

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import to_plain
from flowsculpt.render.mitsuba.emitters import daylight_exposure, daylight_irradiances
from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.raster import Shape, StageSetup, preview
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene_lights import LIGHTS, LightRig, Sky, Softbox, Sun
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.sky import WIDEST, Daylight, Environment, read_map, sun_position
from flowsculpt.render.scene.surface import Surface

Rendered = Callable[..., RenderedFrame]
angles = st.floats(-7.0, 7.0)


def written(path: Path, pixels: np.ndarray) -> Environment:
    """A map of light on disk."""
    height, width, channels = pixels.shape
    out = oiio.ImageOutput.create(str(path))
    out.open(str(path), oiio.ImageSpec(width, height, channels, oiio.FLOAT))
    out.write_image(np.ascontiguousarray(pixels, dtype=np.float32))
    out.close()
    return Environment(str(path.stat().st_mtime_ns), path=str(path))


def dark() -> np.ndarray:
    return np.full((32, 64, 3), 0.01)


FULL = ("studio", "gallery", "three_point", "softbox", "daylight")


@pytest.mark.parametrize("name", LIGHTS)
def test_every_rig_exposes_its_subject_well(name: str, rendered: Rendered) -> None:
    layers = rendered(lights=LIGHTS[name], quality=Quality(48, 27, samples=16, depth=3, auxiliary_samples=4))
    subject = layers["beauty"][layers["matte"] == 1.0].mean(axis=-1)
    assert (0.35 if name in FULL else 0.1) < subject.mean() < (1.3 if name in FULL else 3.0)
    assert np.percentile(subject, 90) > (1.8 if name in FULL else 2.5) * np.percentile(subject, 10)


WINDOW = Softbox((0.0, 3.0, -6.0), 3.0, 3.0, (5.0, 5.0, 5.0), target=(0.0, 1.0, 0.0), name="window")
LAMP = Softbox((-2.5, 1.5, -6.0), 1.0, 1.0, (9.0, 1.0, 1.0), target=(0.0, 1.0, 0.0), name="lamp")
ROOM = Camera((0.0, 1.6, 9.0), (0.0, 1.6, 0.0), field_of_view=math.radians(50.0))


@pytest.mark.parametrize("sky", [False, True], ids=["hidden sky", "visible sky"])
@pytest.mark.parametrize("window", [False, True], ids=["hidden window", "visible window"])
@pytest.mark.parametrize("lamp", [False, True], ids=["hidden lamp", "visible lamp"])
def test_the_lens_sees_the_visible_softboxes_alone_whatever_the_sky_is(
    sky: bool, window: bool, lamp: bool, rendered: Rendered
) -> None:
    blue = Sky((0.0, 0.0, 0.5), (0.0, 0.0, 0.5), (0.0, 0.0, 0.5), visible=sky)
    rig = LightRig((replace(WINDOW, visible=window), replace(LAMP, visible=lamp)), sky=blue)
    quality = Quality(64, 36, samples=16, depth=3, auxiliary_samples=4)
    layers = rendered(lights=rig, camera=ROOM, stage=STAGES["none"], quality=quality)
    outside = layers["matte"] == 0.0
    beauty, behind = layers["beauty"], (0.0, 0.0, 0.5) if sky else (0.0, 0.0, 0.0)
    seen_window, seen_lamp = beauty[..., 1] > 4.0, (beauty[..., 0] > 8.0) & (beauty[..., 1] < 2.0)
    assert (seen_window & outside).any() == window and (seen_lamp & outside).any() == lamp
    corner = beauty[:3, -3:].reshape(-1, 3)
    assert corner == pytest.approx(np.tile(behind, (9, 1)), abs=1e-6)
    assert layers["alpha"][:3, -3:].max() == float(sky)
    assert layers["beauty"][layers["matte"] == 1.0].mean() > 0.05, "they shine all the same"


def test_smoke_shows_all_lights_in_the_picture_or_none(rendered: Rendered) -> None:
    rig = LightRig((replace(WINDOW, visible=True), LAMP), sky=Sky((0.5,) * 3, (0.5,) * 3, (0.5,) * 3))
    with pytest.raises(BadInputError, match="sees some lights in the picture and not others"):
        rendered(look=LOOKS["smoke"], lights=rig, camera=ROOM, stage=STAGES["none"])


@given(angles, angles)
def test_a_rig_turned_twice_is_turned_by_both(one: float, other: float) -> None:
    rig = replace(LIGHTS["gallery"], suns=(Sun((1.0, -1.0, 0.5), (1.0, 1.0, 1.0)),), daylight=Daylight())
    twice, once = rig.turned(one).turned(other), rig.turned(one + other)
    for a, b in zip(twice.softboxes, once.softboxes, strict=True):
        assert a.position == pytest.approx(b.position, abs=1e-9)
    assert twice.suns[0].direction == pytest.approx(once.suns[0].direction, abs=1e-9)
    assert twice.daylight is not None and once.daylight is not None
    assert twice.daylight.direction == pytest.approx(once.daylight.direction, abs=1e-9)


def test_turning_a_rig_is_turning_its_stage(rendered: Rendered) -> None:
    turned = rendered(lights=LIGHTS["studio"].turned(0.7))
    stage = rendered(placement=StagePlacement(turn=0.7))
    assert np.median(np.abs(turned["beauty"] - stage["beauty"])) < 2e-2


def test_only_the_light_that_is_named_is_dimmed() -> None:
    rig = LIGHTS["studio"].dimmed({"rim": 0.5, "sky": 2.0})
    for before, after in zip(LIGHTS["studio"].softboxes, rig.softboxes, strict=True):
        factor = 0.5 if before.name == "rim" else 1.0
        assert after == replace(before, radiance=tuple(factor * part for part in before.radiance))
    assert rig.sky.horizon == pytest.approx([2.0 * part for part in LIGHTS["studio"].sky.horizon])
    assert LIGHTS["studio"].dimmed({}) == LIGHTS["studio"]


def test_lights_of_a_rig_have_names_of_their_own() -> None:
    for rig in LIGHTS.values():
        names = [box.name for box in rig.softboxes]
        assert all(names) and len(set(names)) == len(names)


def test_the_sun_stands_where_almanacs_have_it() -> None:
    """At noon of an equinox it is as far from the zenith as the place from the equator; at midsummer in
    Paris (48.86° N) it rises at 3.9 h by the sun, in the north-east, and culminates at 64.6°."""
    noon, south = sun_position(12.0, math.radians(48.86), 81)
    assert math.degrees(noon) == pytest.approx(90.0 - 48.86, abs=0.5)
    assert math.degrees(south) == pytest.approx(180.0)
    assert math.degrees(sun_position(12.0, math.radians(48.86), 172)[0]) == pytest.approx(64.6, abs=0.1)
    rising, east = sun_position(4.0, math.radians(48.86), 172)
    assert abs(math.degrees(rising)) < 1.5 and 45.0 < math.degrees(east) < 60.0
    assert sun_position(12.0, math.radians(-70.0), 172)[0] < 0.0


def test_daylight_is_a_warm_sun_and_a_blue_sky_and_dusk_is_not_black(engine: Engine) -> None:
    low, high = (Daylight(math.radians(angle)) for angle in (4.0, 60.0))
    for day in (low, high):
        sun, sky = daylight_irradiances(day)
        assert sun[0] > sun[2] and sky[2] / sky[0] > sun[2] / sun[0]
        facing = float((sun + sky / 2.0) @ [0.2126, 0.7152, 0.0722]) * daylight_exposure(day)
        assert 4.0 < facing < 9.0
    sun, _ = daylight_irradiances(high)
    soft, _ = daylight_irradiances(replace(high, width=0.1))
    assert soft == pytest.approx(sun, rel=0.02)


def test_shadows_fall_away_from_the_sun(rendered: Rendered) -> None:
    """Seen from the front, with the sun from the right, the shadow lies on the left; the stage turns with
    the camera and the sun does not."""
    for turn in (0.0, 1.0):
        rig = LightRig(daylight=Daylight(math.radians(30.0), math.radians(90.0), visible=False))
        front = Camera((0.0, 3.0, 9.0), (0.0, 0.9, 0.0))
        layers = rendered(lights=rig, camera=front, placement=StagePlacement(turn=turn))
        floor = layers["beauty"][20:23].mean(axis=(0, 2))
        assert floor[:16].mean() < 0.8 * floor[-16:].mean()


def test_a_map_shines_from_where_its_bright_part_is(rendered: Rendered, tmp_path: Path) -> None:
    """The middle of the map is behind the subject as seen from the front; its right is the camera's right."""
    pixels = dark()
    pixels[10:18, 44:52] = 40.0  # three quarters along: a quarter turn to the right of the middle
    map_ = written(tmp_path / "right.exr", pixels)
    front = Camera((0.0, 1.6, 9.0), (0.0, 0.9, 0.0))

    def sides(map_: Environment) -> tuple[float, float]:
        layers = rendered(lights=LightRig(environment=map_), camera=front, stage=STAGES["none"])
        subject = np.where(layers["matte"] == 1.0, layers["beauty"].mean(axis=2), np.nan)
        return float(np.nanmean(subject[:, :24])), float(np.nanmean(subject[:, 24:]))

    left, right = sides(map_)
    assert right > 3.0 * left
    left, right = sides(replace(map_, turn=math.pi))
    assert left > 3.0 * right


def test_the_lens_sees_the_middle_of_a_map_behind_the_subject(rendered: Rendered, tmp_path: Path) -> None:
    pixels = dark()
    pixels[:, 28:36] = [0.2, 0.9, 0.1]
    rig = LightRig(environment=written(tmp_path / "back.exr", pixels))
    front = Camera((0.0, 1.0, 9.0), (0.0, 1.0, 0.0))
    seen = rendered(lights=rig, camera=front, stage=STAGES["none"])
    outside = seen["matte"] == 0.0
    assert seen["beauty"][outside].mean(axis=0) == pytest.approx([0.2, 0.9, 0.1], abs=0.02)
    assert seen["albedo"][outside].max() == 0.0
    hidden = rendered(
        lights=replace(rig, environment=replace(rig.environment, visible=False)),
        camera=front,
        stage=STAGES["none"],
    )
    assert np.percentile(hidden["beauty"][outside], 98) == 0.0


def test_a_fine_map_is_averaged_and_keeps_its_light(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert WIDEST == 4096
    monkeypatch.setattr("flowsculpt.render.scene.sky.WIDEST", 512)
    pixels = np.random.default_rng(1).random((512, 1024, 3), dtype=np.float32)
    made = written(tmp_path / "fine.exr", pixels)
    kept = read_map(made.path, made.digest)
    assert kept.shape == (256, 512, 3)
    assert kept.mean() == pytest.approx(pixels.mean(), rel=1e-4)


def _spoilt(name: str) -> np.ndarray:
    pixels = dark()
    if name == "nan":
        pixels[3, 5, 1] = math.nan
    if name == "negative":
        pixels[7, 9, 2] = -0.5
    if name == "huge":
        pixels[2, 4] = 1e30
    return pixels[:, :-1] if name == "shape" else pixels[..., :1] if name == "grey" else pixels


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("nan", "pixel 5, 3 and 0 others are not finite"),
        ("negative", "pixel 9, 7 is below 0"),
        ("huge", "pixel 4, 2 is 1e\\+30; light goes up to 1e\\+10. Clamp it"),
        ("shape", "it is 63 × 32 pixels; a map of all directions must be twice as wide as high"),
        ("grey", "a picture of 1 channels in openexr"),
    ],
)
def test_a_map_that_is_none_is_refused(name: str, told: str, tmp_path: Path) -> None:
    made = written(tmp_path / f"{name}.exr", _spoilt(name))
    with pytest.raises(BadInputError, match=told):
        read_map(made.path, made.digest)


def test_a_file_that_ends_too_early_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "cut.exr"
    written(path, np.random.default_rng(2).random((64, 128, 3)))
    path.write_bytes(path.read_bytes()[:20000])
    with pytest.raises(BadInputError, match="cannot be read to its end"):
        read_map(str(path), "cut")
    path.write_text("no picture at all")
    with pytest.raises(BadInputError, match="cannot be read as a picture"):
        read_map(str(path), "text")


def test_where_a_map_lies_is_no_part_of_the_picture() -> None:
    one, other = (LightRig(environment=Environment("abc", path=path)) for path in ("/a.exr", "/b.exr"))
    assert to_plain(one) == to_plain(other)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Daylight(elevation=-0.1),
        lambda: Daylight(turbidity=11.0),
        lambda: Daylight(width=1e-4),
        lambda: Daylight(sun=-1.0),
    ],
)
def test_a_day_that_cannot_be_is_refused(make: Callable[[], Daylight]) -> None:
    with pytest.raises(BadInputError):
        make()


@pytest.mark.parametrize("kind", ["daylight", "map"])
def test_quick_previews_know_light_from_all_around(kind: str, sphere: Surface, tmp_path: Path) -> None:
    rig = LIGHTS["daylight"]
    if kind == "map":
        rig = LightRig(environment=written(tmp_path / "grey.exr", np.full((16, 32, 3), 0.8, np.float32)))
    look = Shape(sphere.vertices, sphere.normals, sphere.faces, LOOKS["clay"])
    seen = preview(
        look,
        StageSetup(rig, STAGES["cyclorama"], StagePlacement()),
        Camera((3.2, 2.9, 8.8), (0.0, 0.95, 0.0)),
        (48, 27),
        "srgb",
    )
    assert 0.2 < seen.picture[13, 24].mean() < 0.95


def test_a_lamp_may_stand_right_above(rendered: Rendered) -> None:
    above = LightRig((Softbox((0.0, 6.0, 0.0), 2.0, 2.0, (60.0, 60.0, 60.0)),), sky=Sky())
    assert rendered(lights=above.turned(0.3))["beauty"].mean() > 0.05
