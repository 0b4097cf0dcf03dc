"""Passes end where the picture is quiet enough, and what is left of them is what fewer samples would be."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from render.base.errors import BadInputError
from render.frame.accumulator import noise_of
from render.frame.sample_batches import ShutterInterval
from render.mitsuba.engine import Engine
from render.scene.aovs import RenderedFrame
from render.scene.camera import Camera
from render.scene.quality import Quality
from render.scene.scene import MotionSample
from render.scene.stage import StagePlacement
from render.scene.surface import Surface

Rendered = Callable[..., RenderedFrame]

CAMERA = Camera((3.2, 2.9, 8.8), (0.0, 0.95, 0.0))
MOST = Quality(64, 36, samples=96, depth=3, auxiliary_samples=4, noise_threshold=1e-9)


def passes(light: float, error: float, count: int, shape: tuple[int, int] = (64, 80)) -> list[np.ndarray]:
    random = np.random.default_rng(7)
    return [light + error * random.standard_normal(shape) for _ in range(count)]


@given(light=st.floats(0.05, 20.0), share=st.floats(0.01, 0.3), count=st.sampled_from([2, 3, 8]))
def test_noise_is_the_error_of_the_mean_over_the_square_root_of_light(
    light: float, share: float, count: int
) -> None:
    seen = passes(light, share * light, count)
    found = noise_of(sum(seen), sum(one * one for one in seen), count)
    assert found == pytest.approx(share * math.sqrt(light / count), rel=0.2)


def test_one_block_in_twenty_may_be_noisier_and_no_more() -> None:
    shape = (64, 160)  # 40 blocks
    for noisy, is_loud in ((2, False), (3, True)):
        seen = passes(1.0, 0.01, 4, shape)
        for one, loud in zip(seen, passes(0.0, 1.0, 4, shape), strict=True):
            one[:16, : 16 * noisy] += loud[:16, : 16 * noisy]
        assert (noise_of(sum(seen), sum(one * one for one in seen), 4) > 0.1) == is_loud


def test_what_stops_early_is_the_picture_of_fewer_samples(rendered: Rendered) -> None:
    whole = rendered(quality=MOST, aovs=("samples", "noise"))
    assert whole.facts["samples"] == 96
    plain = rendered(quality=replace(MOST, noise_threshold=None), aovs=("samples", "noise"))
    assert all(np.array_equal(whole[name], plain[name]) for name in plain.arrays)
    # Errors fall as 1 / √n, and faster as samples lie evenly.
    threshold = 1.2 * whole.facts["noise"]
    early = rendered(quality=replace(MOST, noise_threshold=threshold), aovs=("samples", "noise"))
    taken = early.facts["samples"]
    assert taken in (48, 64, 80) and early.facts["noise"] <= threshold
    assert (early["samples"] == taken).all()
    fewer = rendered(quality=replace(MOST, samples=taken, noise_threshold=None), aovs=("samples", "noise"))
    assert all(np.array_equal(early[name], fewer[name]) for name in fewer.arrays)


def test_the_measure_foretells_the_error(rendered: Rendered) -> None:
    """Against many more samples, over the square root of the light."""
    found = rendered(quality=replace(MOST, samples=48))
    truth = rendered(quality=replace(MOST, samples=256, noise_threshold=None), seed=8)["beauty"]
    luma = np.array([0.2126, 0.7152, 0.0722])
    error = ((found["beauty"] - truth) @ luma) / np.sqrt(np.maximum(truth @ luma, 0.01))
    blocks = [np.sqrt((error[y : y + 16, x : x + 16] ** 2).mean()) for y in (0, 16) for x in (0, 16, 32, 48)]
    assert found.facts["noise"] == pytest.approx(max(blocks), rel=0.5)


def test_every_sub_frame_is_given_the_same_and_threads_change_nothing(
    rendered: Rendered, sphere: Surface, engine: Engine
) -> None:
    right = CAMERA.axes()[0]

    def at(offset: float) -> MotionSample:
        moved = (sphere.vertices + 0.3 * offset * right).astype(np.float32)
        return MotionSample(replace(sphere, vertices=moved), StagePlacement(), CAMERA)

    arguments = {"shutter": ShutterInterval(-0.25, 0.25, at), "aovs": ("samples", "noise")}
    whole = rendered(quality=MOST, **arguments)
    count = whole.facts["motion_samples"]
    assert count == 3 and whole.facts["samples"] == 96
    threshold = 1.35 * whole.facts["noise"]
    early = rendered(quality=replace(MOST, noise_threshold=threshold), **arguments)
    assert early.facts["samples"] < 96 and early.facts["samples"] % count == 0
    assert (early["samples"] == early.facts["samples"]).all()
    alone = rendered(
        quality=replace(MOST, noise_threshold=threshold), engine=replace(engine, threads=1), **arguments
    )
    engine.start()
    assert early.facts == alone.facts
    assert all(np.array_equal(early[name], alone[name]) for name in early.arrays)


@pytest.mark.parametrize("threshold", [0.0, -0.1, math.nan, math.inf])
def test_a_threshold_is_above_nothing(threshold: float) -> None:
    with pytest.raises(BadInputError, match="must be above 0"):
        Quality(64, 36, samples=64, depth=3, noise_threshold=threshold)


def test_a_threshold_that_could_save_no_pass_is_refused() -> None:
    with pytest.raises(BadInputError, match="no batch to save of 32 samples; take 48 or more"):
        Quality(64, 36, samples=32, depth=3, noise_threshold=0.1)
