"""While the shutter is open things move, and a picture shows all of it: as wide as it is long, as bright."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.render.frame.batch_schedule import (
    MAX_MOTION_SAMPLES,
    MAX_STEP,
    MIN_SAMPLES,
    SampleBatch,
    batch_schedule,
    chosen_pixels,
    motion_sample_count,
    multijitter_rounds,
    traced_rounds,
)
from flowsculpt.render.frame.render_frame import SampleBatches, ShutterInterval
from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.mitsuba.mitsuba_scene import build_scene
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import BATCH_SAMPLES, Quality
from flowsculpt.render.scene.scene import MotionSample, Scene
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.surface import Surface

Rendered = Callable[..., RenderedFrame]

CAMERA = Camera((3.2, 2.9, 8.8), (0.0, 0.95, 0.0))
FINE = Quality(48, 27, samples=32, depth=3, auxiliary_samples=16)


def sliding(surface: Surface, way: float, opens: float = -0.25, closes: float = 0.25) -> ShutterInterval:
    """The surface goes `way` scene units to the right of the picture in a frame."""
    right = CAMERA.axes()[0]

    def at(offset: float) -> MotionSample:
        moved = (surface.vertices + way * offset * right).astype(np.float32)
        return MotionSample(replace(surface, vertices=moved), StagePlacement(), CAMERA)

    return ShutterInterval(opens, closes, at)


def test_a_shutter_over_what_stands_still_changes_no_bit(rendered: Rendered, sphere: Surface) -> None:
    still, plain = rendered(quality=FINE, shutter=sliding(sphere, 0.0)), rendered(quality=FINE)
    assert still.facts["motion_samples"] == 1
    assert all(np.array_equal(still[name], plain[name]) for name in plain.arrays)


def test_a_sliding_ball_is_smeared_by_its_way_in_pixels(rendered: Rendered, sphere: Surface) -> None:
    """Along the middle row the matte falls from 1 to 0 over a pixel and the way: of a box, its variance is
    that of the edge at rest and a twelfth of the square of the way."""
    way = 2.0
    shutter = sliding(sphere, way)
    layers, plain = rendered(quality=FINE, shutter=shutter), rendered(quality=FINE)
    path = 0.5 * way / (np.tan(np.radians(13.0)) * np.linalg.norm(CAMERA.origin)) * 24.0
    assert shutter.longest_motion((48, 27)) == pytest.approx(path, rel=0.15)
    columns = np.arange(48.0)

    def spread(matte: np.ndarray) -> float:
        share = matte / matte.sum()
        return float((share * (columns - (share * columns).sum()) ** 2).sum())

    smear = np.mean([spread(layers["matte"][r]) - spread(plain["matte"][r]) for r in range(10, 17)])
    assert np.sqrt(12.0 * smear) == pytest.approx(path, rel=0.1)
    assert layers["matte"].sum() == pytest.approx(plain["matte"].sum(), rel=0.01)


def test_what_is_smeared_is_as_bright(rendered: Rendered, sphere: Surface) -> None:
    layers, plain = (rendered(quality=FINE, shutter=s) for s in (sliding(sphere, 1.5), None))
    assert layers["beauty"].mean() == pytest.approx(plain["beauty"].mean(), rel=0.01)
    assert layers.facts["motion_samples"] > 4


def test_the_way_is_that_of_the_shutter_alone(rendered: Rendered, sphere: Surface) -> None:
    """One that opens with the frame shows the ball ahead of where one that closes with it does."""
    late = rendered(quality=FINE, shutter=sliding(sphere, 2.0, 0.0, 0.5))["matte"]
    early = rendered(quality=FINE, shutter=sliding(sphere, 2.0, -0.5, 0.0))["matte"]
    columns = np.arange(48.0)
    ahead = (late.sum(axis=0) @ columns) / late.sum() - (early.sum(axis=0) @ columns) / early.sum()
    path = 0.5 * 2.0 / (np.tan(np.radians(13.0)) * np.linalg.norm(CAMERA.origin)) * 24.0
    assert ahead == pytest.approx(path, rel=0.1)


def test_a_camera_that_pans_smears_what_stands_still(rendered: Rendered, sphere: Surface) -> None:
    right = CAMERA.axes()[0]

    def at(offset: float) -> MotionSample:
        target = tuple(CAMERA.target + 2.0 * offset * right)
        return MotionSample(sphere, StagePlacement(), replace(CAMERA, target=target))

    layers = rendered(quality=FINE, shutter=ShutterInterval(-0.25, 0.25, at))
    assert layers.facts["motion_samples"] > 2
    assert ((layers["matte"] > 0.05) & (layers["matte"] < 0.95)).sum() > 60


def test_blurred_pictures_are_the_same_on_one_thread_and_two(
    rendered: Rendered, sphere: Surface, engine: Engine
) -> None:
    marked = replace(sphere, attributes={"velocity": sphere.vertices})
    arguments = {"surface": marked, "shutter": sliding(marked, 1.0), "aovs": ("velocity", "noise")}
    both = rendered(quality=FINE, **arguments)
    alone = rendered(quality=FINE, engine=replace(engine, threads=1), **arguments)
    engine.start()
    assert both.facts == alone.facts
    assert all(np.array_equal(both[name], alone[name]) for name in both.arrays)


def test_every_sample_is_taken_and_every_pass_told(rendered: Rendered, sphere: Surface) -> None:
    told: list[tuple[int, int]] = []
    layers = rendered(
        quality=Quality(48, 27, samples=32, depth=2, auxiliary_samples=4),
        shutter=sliding(sphere, 2.0),
        aovs=("samples",),
        on_batch=lambda *each: told.append(each),
    )
    assert (layers["samples"] == 32).all()
    assert told == [(n, len(told)) for n in range(1, len(told) + 1)]


COUNTS = st.sampled_from([1, 2, 3, 4, 5, 6, 7, 9, 12, 16, 32, 48, 64, 80])


@given(way=st.floats(0.0, 100.0), samples=COUNTS)
def test_multijitter_shares_all_samples_evenly(way: float, samples: int) -> None:
    quality = Quality(16, 9, samples=samples, depth=2, auxiliary_samples=1)
    (only,) = multijitter_rounds(quality, way)
    count = len(only.times)
    assert 1 <= count <= MAX_MOTION_SAMPLES
    sizes = [batch.samples for batch in batch_schedule(quality, [only]) if batch.kind == "beauty"]
    assert sum(sizes) == samples
    assert len(set(sizes)) == 1 and sizes[0] <= BATCH_SAMPLES
    if samples >= 2 * MIN_SAMPLES:
        assert count == 1 or sizes[0] >= MIN_SAMPLES
    if samples in (16, 32, 64) and count < samples // MIN_SAMPLES:
        assert way <= MAX_STEP * count


@given(
    way=st.floats(0.0, 200.0),
    samples=COUNTS,
    auxiliary=COUNTS,
    affordable=st.integers(0, 100),
    is_adaptive=st.booleans(),
    crop=st.sampled_from([None, (3, 2, 16, 8)]),
)
def test_every_pixel_may_get_all_samples_once(
    way: float,
    samples: int,
    auxiliary: int,
    affordable: int,
    is_adaptive: bool,
    crop: tuple[int, int, int, int] | None,
) -> None:
    threshold = 0.02 if is_adaptive else None
    quality = Quality(
        16, 9, samples=samples, depth=2, auxiliary_samples=auxiliary, crop=crop, noise_threshold=threshold
    )
    rounds = traced_rounds(quality, way, affordable, 7)
    width, height = quality.rendered_size
    taken: dict[str, list[list[int]]] = {
        kind: [[] for _ in range(width * height)] for kind in ("auxiliary", "beauty")
    }
    for batch in batch_schedule(quality, rounds):
        assert 0.0 <= batch.time <= 1.0
        for pixel in chosen_pixels(quality, batch, 7, np.arange(width * height)):
            taken[batch.kind][pixel] += range(batch.first, batch.first + batch.samples)
    most = 2 * samples if quality.is_adaptive and way <= MAX_STEP else samples  # for edges
    assert all(numbers == list(range(most)) for numbers in taken["beauty"])
    assert all(
        len(numbers) >= auxiliary and len(set(numbers)) == len(numbers) for numbers in taken["auxiliary"]
    )
    assert len({len(numbers) for numbers in taken["auxiliary"]}) == 1


def test_a_crop_chooses_as_the_whole_picture() -> None:
    whole, crop = Quality(16, 9, samples=4, depth=2), Quality(16, 9, samples=4, depth=2, crop=(3, 2, 9, 8))
    batch = SampleBatch(0.5, "beauty", 1, 2, (1, 4))
    chosen, of_crop = (
        chosen_pixels(quality, batch, 7, np.arange(np.prod(quality.rendered_size)))
        for quality in (whole, crop)
    )
    rows, columns = np.divmod(chosen, 16)
    inside = (columns >= 3) & (columns < 9) & (rows >= 2) & (rows < 8)
    expected = (rows[inside] - 2) * 6 + columns[inside] - 3
    assert np.array_equal(of_crop, expected)
    assert 0.15 < len(rows) / (16 * 9) < 0.35


def test_slow_things_are_not_cut_up() -> None:
    assert motion_sample_count(0.0, 64, 999) == motion_sample_count(MAX_STEP, 64, 999) == 1
    assert [motion_sample_count(way, 64, 999) for way in (1.5, 3.0, 6.0, 50.0)] == [2, 4, 8, 64]


def test_fast_things_are_sampled_at_more_times_than_a_pixel_has_samples() -> None:
    counts = [motion_sample_count(126.0, samples, 999) for samples in (4, 16, 64)]
    assert counts == [128, 128, 128]
    assert motion_sample_count(126.0, 16, 40) == 32
    assert motion_sample_count(126.0, 16, 0) == 16


def test_times_that_show_are_random_in_their_parts() -> None:
    coarse, others = (traced_rounds(FINE, 100.0, 0, seed)[0].times for seed in (7, 8))
    assert coarse != others
    assert [int(time * len(coarse)) for time in coarse] == list(range(len(coarse)))
    fine = traced_rounds(FINE, 8.0, 0, 7)[0].times
    assert fine == [(i + 0.5) / 8 for i in range(8)]


def test_pixels_that_choose_their_times_are_as_bright(sphere: Surface, engine: Engine) -> None:
    """A streak of 4 samples at 16 times is, over its rows, that of 16 samples at all of them."""
    engine.start()
    shutter = sliding(sphere, 4.0)

    def columns(samples: int) -> np.ndarray:
        quality = Quality(48, 27, samples=samples, depth=2, auxiliary_samples=samples)
        (whole,) = traced_rounds(quality, 20.0, 16, 7)
        assert len(whole.times) == 16
        batches = SampleBatches(quality, batch_schedule(quality, [whole]), (), 7)
        for batch in batches.remaining():
            moved = shutter.at(shutter.offset(batch.time))
            scene = Scene(
                moved.subject, LOOKS["clay"], LIGHTS["studio"], STAGES["cyclorama"], moved.placement, CAMERA
            )
            batches.render(batch, build_scene(scene, quality))
        return batches.accumulator.frame_aovs(scene.objects)["matte"].mean(axis=0)

    np.testing.assert_allclose(columns(4), columns(16), atol=0.06)
