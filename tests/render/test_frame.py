"""A frame is the same to the last bit, and shows what it was asked to show."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt import render
from flowsculpt.render.base.aligned_array import aligned
from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.frame.batch_schedule import seed_of
from flowsculpt.render.frame.render_frame import ShutterInterval, render_frame
from flowsculpt.render.mitsuba.emitters import shadowing_softboxes
from flowsculpt.render.mitsuba.engine import DEFAULT_ORDER, Engine
from flowsculpt.render.post.denoise import denoise
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS, Diffuse
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import QUALITIES, Quality
from flowsculpt.render.scene.scene import MotionSample, Scene
from flowsculpt.render.scene.scene_lights import LIGHTS, LightRig, Sky, Sun
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.surface import Surface
from tests.render.conftest import TINY

Rendered = Callable[..., RenderedFrame]

CAMERA_ORIGIN, CAMERA_TARGET = CAMERA_VIEW = (3.2, 2.9, 8.8), (0.0, 0.95, 0.0)


def same_bits(one: RenderedFrame, other: RenderedFrame) -> bool:
    return one.facts == other.facts and all(
        np.array_equal(one[name].view(np.uint32), other[name].view(np.uint32)) for name in one.arrays
    )


def test_rendering_again_gives_the_same_bits(rendered: Rendered, picture: RenderedFrame) -> None:
    assert same_bits(rendered(), picture)


def test_one_thread_and_two_give_the_same_bits(
    rendered: Rendered, picture: RenderedFrame, engine: Engine
) -> None:
    alone = rendered(engine=replace(engine, threads=1))
    engine.start()
    assert same_bits(alone, picture)


def test_another_seed_gives_another_noise(rendered: Rendered, picture: RenderedFrame) -> None:
    other = rendered(seed=8)
    assert not np.array_equal(other["beauty"], picture["beauty"])
    assert abs(other["beauty"].mean() / picture["beauty"].mean() - 1.0) < 0.05


def test_the_sphere_is_lit_and_covers_what_the_camera_projects(picture: RenderedFrame) -> None:
    assert np.isfinite(picture["beauty"]).all()
    assert 0.05 < picture["beauty"].mean() < 2.0
    matte = picture["matte"]
    assert matte[13, 24] == 1.0
    assert matte[0].max() == matte[:, 0].max() == 0.0
    # A sphere at distance d has the angular radius asin(1/d); the lens spans 26° over 48 pixels.
    distance = np.linalg.norm(np.subtract(CAMERA_ORIGIN, (0.0, 1.0, 0.0)))
    radius = np.tan(np.arcsin(1.0 / distance)) / np.tan(np.radians(13.0)) * 24.0
    assert matte.sum() == pytest.approx(np.pi * radius**2, rel=0.06)


def test_layers_tell_where_the_surface_is(picture: RenderedFrame) -> None:
    inside = picture["matte"] == 1.0
    centre = picture["position"][inside] - [0.0, 1.0, 0.0]
    assert np.linalg.norm(centre, axis=1) == pytest.approx(1.0, abs=0.05)
    assert (centre * picture["normal"][inside]).sum(axis=1).min() > 0.9
    away = np.linalg.norm(picture["position"][inside] - np.array(CAMERA_ORIGIN), axis=1)
    assert picture["depth"][inside] == pytest.approx(away, rel=0.01)
    assert picture["albedo"][inside] == pytest.approx(
        np.tile(LOOKS["clay"].colour, (inside.sum(), 1)), abs=1e-3
    )


def test_an_enlarged_copy_on_an_enlarged_stage_is_the_same_picture(
    rendered: Rendered, picture: RenderedFrame, sphere: Surface
) -> None:
    size, origin = 8.0, np.array([16.0, -4.0, 32.0])
    moved = replace(sphere, vertices=(sphere.vertices * size + origin).astype(np.float32))
    camera = Camera(
        tuple(np.multiply(CAMERA_ORIGIN, size) + origin),
        tuple(np.multiply(CAMERA_TARGET, size) + origin),
    )
    large = rendered(surface=moved, placement=StagePlacement(tuple(origin), size), camera=camera)
    assert np.abs(large["matte"] - picture["matte"]).max() <= 0.25  # one sample of four may change sides
    difference = np.abs(large["beauty"] - picture["beauty"])
    assert np.median(difference) < 1e-3
    assert large["beauty"].mean() == pytest.approx(picture["beauty"].mean(), rel=5e-3)


def test_a_camera_that_goes_around_with_the_stage_sees_the_same_light(rendered: Rendered) -> None:
    turn = math.radians(70.0)
    cos, sin = math.cos(turn), math.sin(turn)
    x, y, z = CAMERA_ORIGIN
    camera = Camera((cos * x + sin * z, y, cos * z - sin * x), CAMERA_TARGET)
    quality = Quality(48, 27, samples=16, depth=3, auxiliary_samples=4)
    picture = rendered(quality=quality)
    turned = rendered(camera=camera, placement=StagePlacement(turn=turn), quality=quality)
    assert np.median(np.abs(turned["beauty"] - picture["beauty"])) < 2e-2
    assert turned["beauty"].mean() == pytest.approx(picture["beauty"].mean(), rel=5e-3)
    fixed = rendered(camera=camera, quality=quality)
    assert np.median(np.abs(fixed["beauty"] - picture["beauty"])) > 2e-2


def test_the_lens_does_not_see_the_lamps(rendered: Rendered) -> None:
    key = LIGHTS["studio"].softboxes[0]
    x, y, z = key.position
    into_it = Camera((x / 2, y / 2, z / 2), key.position)
    assert rendered(camera=into_it)["beauty"].max() < min(key.radiance) / 10.0


def test_a_lamp_in_the_picture_shows_in_no_layer(rendered: Rendered, picture: RenderedFrame) -> None:
    rig = LIGHTS["studio"]
    lamp = replace(rig.softboxes[0], position=(1.2, 1.6, 3.0), width=1.0, height=1.0)
    crowded = rendered(lights=replace(rig, softboxes=(*rig.softboxes, lamp)))
    for name in ("albedo", "normal", "position", "depth", "matte"):
        assert crowded[name] == pytest.approx(picture[name], abs=1e-3)
    assert not np.array_equal(crowded["beauty"], picture["beauty"])


@pytest.mark.parametrize("name", LOOKS)
def test_every_look_renders(name: str, rendered: Rendered, sphere: Surface) -> None:
    speed = np.abs(sphere.vertices[:, :1])
    brought = replace(sphere, rest=sphere.vertices, attributes={Surface.SPEED: speed})
    layers = rendered(look=LOOKS[name], surface=brought)
    inside = layers["matte"] == 1.0
    assert np.isfinite(layers["beauty"]).all()
    assert layers["beauty"][inside].mean() > 0.02
    assert layers["albedo"].max() <= 1.0


def test_a_subject_may_stand_before_the_sky_alone(rendered: Rendered) -> None:
    sky = Sky((0.1, 0.2, 0.8), (0.9, 0.8, 0.7), (0.2, 0.2, 0.2), visible=True)
    rig = LightRig(suns=(Sun((1.0, -1.0, -1.0), (2.0, 2.0, 2.0)),), sky=sky)
    layers = rendered(stage=STAGES["none"], lights=rig)
    top, middle = layers["beauty"][0].mean(axis=0), layers["beauty"][8].mean(axis=0)
    assert top.min() > 0.0
    assert layers["beauty"][layers["matte"] == 1.0].mean() > 0.05
    assert not np.allclose(top, middle)


def test_a_look_takes_its_colour_from_an_attribute(rendered: Rendered, sphere: Surface) -> None:
    speed = np.zeros((len(sphere.vertices), 3), dtype=np.float32)
    speed[:, 1] = 0.5
    layers = rendered(
        surface=replace(sphere, attributes={"speed": speed}),
        look=Diffuse((1.0, 1.0, 1.0), colour_from="speed"),
    )
    assert layers["albedo"][layers["matte"] == 1.0] == pytest.approx(
        np.tile([0.0, 0.5, 0.0], (int((layers["matte"] == 1.0).sum()), 1)), abs=1e-3
    )


def test_a_missing_attribute_is_named(rendered: Rendered) -> None:
    with pytest.raises(BadInputError, match="'speed'"):
        rendered(look=Diffuse((1.0, 1.0, 1.0), colour_from="speed"))


def _spoilt(surface: Surface, **changes: object) -> Surface:
    return replace(surface, **changes)  # type: ignore[arg-type]


def test_surfaces_that_would_render_wrongly_are_refused(rendered: Rendered, sphere: Surface) -> None:
    broken = sphere.vertices.copy()
    broken[5, 1] = np.nan
    outside = sphere.faces.copy()
    outside[3, 2] = len(sphere.vertices)
    nothing = np.zeros((0, 3), dtype=np.float32)
    cases = {
        "empty": _spoilt(sphere, faces=np.zeros((0, 3), dtype=np.int32)),
        "it needs at least one triangle": Surface(nothing, nothing, np.zeros((0, 3), dtype=np.int32)),
        "not finite at vertex 5": _spoilt(sphere, vertices=broken),
        "names vertex": _spoilt(sphere, faces=outside),
        "normals have shape": _spoilt(sphere, normals=sphere.normals[:-1]),
        "attribute 'speed'": _spoilt(sphere, attributes={"speed": np.zeros((2, 3), dtype=np.float32)}),
    }
    for message, surface in cases.items():
        with pytest.raises(BadInputError, match=message):
            rendered(surface=surface)


def test_passes_are_reported_and_can_be_stopped(rendered: Rendered) -> None:
    seen: list[tuple[int, int]] = []
    rendered(
        quality=Quality(16, 9, samples=32, depth=2, auxiliary_samples=4),
        on_batch=lambda *each: seen.append(each),
    )
    assert seen == [(1, 3), (2, 3), (3, 3)]

    def stop(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        rendered(on_batch=stop)


def test_more_samples_are_less_noisy(rendered: Rendered) -> None:
    def noise(samples: int) -> float:
        quality = Quality(32, 18, samples=samples, depth=3, auxiliary_samples=4)
        one, other = (rendered(quality=quality, seed=seed)["beauty"] for seed in (1, 2))
        return float(np.median(np.abs(one - other)))

    assert noise(64) < 0.7 * noise(4)


def test_denoising_takes_the_noise_and_leaves_the_light(rendered: Rendered, picture: RenderedFrame) -> None:
    truth = rendered(quality=replace(QUALITIES["draft"], width=48, height=27, samples=256, depth=3))["beauty"]
    clean = denoise(picture)
    assert clean.shape == truth.shape
    assert clean.dtype == np.float32
    assert np.abs(clean - truth).mean() < 0.8 * np.abs(picture["beauty"] - truth).mean()
    assert clean.mean() == pytest.approx(truth.mean(), rel=0.03)


def test_the_last_row_is_as_bright_as_those_above() -> None:
    """The denoiser alone makes it 7% darker or brighter where the height is no multiple of 16."""
    noise = np.random.default_rng(1).gamma(2.0, 0.05, (270, 96, 3)).astype(np.float32)
    flat = np.full_like(noise, 0.5)
    rows = denoise(RenderedFrame({"beauty": noise, "albedo": flat, "normal": flat})).mean(axis=(1, 2))
    assert rows[-1] == pytest.approx(rows[-8:-1].mean(), rel=0.02)


def test_black_light_stays_black(picture: RenderedFrame) -> None:
    """As that of a light group whose lights are off."""
    assert not denoise(RenderedFrame({**picture.arrays, "beauty": np.zeros_like(picture["beauty"])})).any()


def test_denoising_is_repeatable(picture: RenderedFrame) -> None:
    assert np.array_equal(denoise(picture), denoise(picture))


@given(st.lists(st.one_of(st.integers(), st.text(max_size=5)), min_size=1, max_size=4))
def test_seeds_fit_and_tell_their_parts_apart(parts: list[int | str]) -> None:
    assert 0 <= seed_of(*parts) < 2**32
    assert seed_of(*parts) == seed_of(*parts)
    assert seed_of(*parts, 0) != seed_of(*parts, 1)


def test_samples_that_make_no_whole_passes_are_refused(rendered: Rendered) -> None:
    with pytest.raises(BadInputError, match="24 samples"):
        rendered(quality=Quality(16, 9, samples=24, depth=2))


def test_render_frame_needs_nothing_but_arrays(sphere: Surface, engine: Engine) -> None:
    camera = Camera(CAMERA_ORIGIN, CAMERA_TARGET)
    layers = render_frame(
        Scene(sphere, LOOKS["glaze"], LIGHTS["studio"], STAGES["cyclorama"], StagePlacement(), camera),
        Quality(16, 9, samples=1, depth=2, auxiliary_samples=1),
        1,
        engine,
    )
    assert layers.size == (16, 9)
    assert layers.facts["variant"] == engine.variant


@pytest.mark.parametrize("dtype", [np.float32, np.uint32])
def test_arrays_for_compiled_code_are_aligned_copies(dtype: type) -> None:
    for count in range(1, 200, 7):
        values = np.arange(3 * count, dtype=np.float64).reshape(3, count).T
        copy = aligned(values, dtype)
        assert copy.ctypes.data % 64 == 0 and copy.dtype == dtype
        assert np.array_equal(copy, values.ravel())


def test_frames_of_a_shot_share_compiled_code(rendered: Rendered, sphere: Surface, engine: Engine) -> None:
    if engine.variant == "scalar_rgb":
        pytest.skip("nothing is ever compiled there")
    import drjit as dr

    def code(**changes: object) -> set[str]:
        """Return the hashes of the kernels of light and features: others are small."""
        dr.kernel_history_clear()
        rendered(**changes)
        return {str(each["hash"]) for each in dr.kernel_history() if each.get("operation_count", 0) > 500}

    def sliding(offset: float) -> MotionSample:
        moved = (sphere.vertices + np.float32([offset, 0.0, 0.0])).astype(np.float32)
        return MotionSample(replace(sphere, vertices=moved), StagePlacement(), Camera(*CAMERA_VIEW))

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        first = code()
        assert len(first) == 2
        places = np.random.default_rng(1).uniform(1.0, 2.0, (6, 5))
        codes: dict[bool, set[frozenset[str]]] = {False: set(), True: set()}
        for x, y, z, size, turn in (*places, (0.0, 0.0, 0.0, 1.0, 0.0)):
            placement, camera = StagePlacement((x, y, z), size, turn), Camera(*CAMERA_VIEW)
            scene = Scene(sphere, LOOKS["clay"], LIGHTS["studio"], STAGES["cyclorama"], placement, camera)
            code_of_frame = code(placement=placement, camera=camera)
            assert len(code_of_frame) == 2
            codes[bool(shadowing_softboxes(scene, TINY.size))].add(frozenset(code_of_frame))
        assert [len(each) for each in codes.values()] == [1, 1], (
            "one each for frames with and without shadows of softboxes that the lens does not see"
        )
        assert code(look=LOOKS["glaze"], stage=STAGES["plinth"]) != first
        assert code() == first, "neither the look nor the stage before is in the code"
        finer = Quality(48, 27, samples=64, depth=3, auxiliary_samples=4)
        assert len(code(quality=finer, shutter=ShutterInterval(-0.2, 0.3, sliding))) == 2


_ANOTHER_PROCESS = """
import sys
from pathlib import Path
import numpy as np
from flowsculpt import render
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.mitsuba.engine import choose
from flowsculpt.render.frame.render_frame import ShutterInterval, render_frame
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import MotionSample, Scene
from flowsculpt.render.scene.surface import Surface
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement

arrays = np.load(sys.argv[1])
surface = Surface(arrays["vertices"], arrays["normals"], arrays["faces"])
camera = Camera((3.2, 2.9, 8.8), (0.0, 0.95, 0.0))
layers = render_frame(
    Scene(surface, LOOKS["clay"], LIGHTS["studio"], STAGES["cyclorama"], StagePlacement(), camera),
    Quality(48, 27, samples=4, depth=3, auxiliary_samples=4), 7,
    choose([sys.argv[2]], threads=int(sys.argv[4])),
)
np.savez(sys.argv[3], **layers.arrays)
"""


@pytest.mark.parametrize("variant", DEFAULT_ORDER)
def test_two_processes_give_the_same_bits(
    variant: str, sphere: Surface, picture: RenderedFrame, engine: Engine, tmp_path: Path
) -> None:
    if variant == "llvm_ad_rgb" and engine.variant != variant:
        pytest.skip("there is no libLLVM here")
    np.savez(tmp_path / "in.npz", vertices=sphere.vertices, normals=sphere.normals, faces=sphere.faces)
    found = [picture.arrays] if variant == engine.variant else []  # of this process, in two threads
    for threads in ("1", "2")[: 2 - len(found)]:
        out = tmp_path / f"{threads}.npz"
        command = [
            sys.executable,
            "-c",
            _ANOTHER_PROCESS,
            str(tmp_path / "in.npz"),
            variant,
            str(out),
            threads,
        ]
        subprocess.run(command, check=True, cwd=Path(render.__file__).parent.parent)
        found.append(np.load(out))
    assert found[0].keys() == found[1].keys()
    for name in found[0]:
        assert np.array_equal(found[0][name], found[1][name]), name
