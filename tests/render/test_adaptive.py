"""Tiles take samples until they are quiet enough, each as many as it needs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.frame.accumulator import Accumulator
from flowsculpt.render.frame.render_frame import ShutterInterval
from flowsculpt.render.frame.tiles import TILE, Tiles, noise_of_tiles
from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import MotionSample
from flowsculpt.render.scene.scene_stage import StagePlacement
from flowsculpt.render.scene.surface import Surface

Rendered = Callable[..., RenderedFrame]

CAMERA = Camera((3.2, 2.9, 8.8), (0.0, 0.95, 0.0))
MOST = Quality(64, 36, samples=48, depth=3, auxiliary_samples=4, noise_threshold=1e-9, fireflies="keep")
SOME = replace(MOST, noise_threshold=0.04)


@given(light=st.floats(0.05, 20.0), share=st.floats(0.01, 0.3))
def test_noise_is_the_error_over_the_square_root_of_light_and_in_highlights_over_the_light(
    light: float, share: float
) -> None:
    tiles = Tiles.of(Quality(40, 20, samples=64, depth=3))
    luminance = np.full(800, light)
    noise = noise_of_tiles(tiles, luminance, (share * luminance) ** 2)
    assert noise == pytest.approx(np.full((3, 5), share * min(math.sqrt(light), 1.0)))


@given(left=st.integers(0, 30), top=st.integers(0, 20), width=st.integers(1, 30), height=st.integers(1, 20))
def test_a_crop_has_the_tiles_of_the_whole_picture(left: int, top: int, width: int, height: int) -> None:
    whole = Quality(60, 40, samples=64, depth=3)
    numbers = Tiles.of(whole).numbers.reshape(40, 60)[top : top + height, left : left + width].ravel()
    own = Tiles.of(replace(whole, crop=(left, top, left + width, top + height))).numbers
    assert len(np.unique(own)) == own.max() + 1
    assert np.array_equal(numbers[:, None] == numbers, own[:, None] == own)


def test_a_tile_stops_unless_a_neighbour_is_noisy_and_never_resumes() -> None:
    random = np.random.default_rng(7)
    quality = Quality(6 * TILE, 3 * TILE, samples=64, depth=3, noise_threshold=0.1, fireflies="keep")
    sums = Accumulator(quality, ())

    def add_round(noisy: int) -> None:
        """Add a round in which the tiles of a column are noisy."""
        rows = np.full((3 * TILE, 6 * TILE, 5), 0.5)
        rows[:, noisy * TILE : (noisy + 1) * TILE, 3] += random.uniform(-0.5, 0.5, (3 * TILE, TILE))
        pixels = sums.active_pixels
        sums.add("beauty", rows.reshape(-1, 5)[pixels], 4, pixels)
        sums.end_round(by_tile=True)

    def active_columns() -> list[int]:
        return sorted({int(n) for n in sums.active_pixels % quality.width // TILE})

    add_round(1)
    assert active_columns() == [0, 1, 2, 3, 4, 5]  # a single round cannot tell
    add_round(1)
    assert active_columns() == [0, 1, 2]
    add_round(5)
    assert active_columns() == [0, 1, 2] and not sums.has_converged


def test_edges_and_the_stage_go_on_where_smooth_parts_of_the_subject_stop() -> None:
    random = np.random.default_rng(7)
    quality = Quality(9 * TILE, TILE, samples=64, depth=3, noise_threshold=0.1, fireflies="keep")
    sums = Accumulator(quality, ())
    normal, matte = np.zeros((TILE, 9 * TILE, 3)), np.ones((TILE, 9 * TILE, 1))
    normal[..., 1] = 1.0
    normal[:, 10, 1] = 0.9  # an edge in the second tile
    matte[:, 6 * TILE :] = 0.0
    sums.add("normal", normal, 16)
    sums.add("matte", matte, 16)
    noise = 0.12 * random.uniform(-1.0, 1.0, (TILE, 9 * TILE))
    for sign in (1.0, -1.0):
        rows = np.full((TILE, 9 * TILE, 5), 0.5)
        rows[..., 3] += sign * noise
        sums.add("beauty", rows, 4)
        sums.end_round(by_tile=True)
    assert sorted({int(n) for n in sums.active_pixels % quality.width // TILE}) == [1, 6, 7, 8]


@pytest.mark.parametrize("edges", [1, 2])
def test_few_edges_take_more_than_the_samples_of_the_quality(edges: int) -> None:
    random = np.random.default_rng(7)
    quality = Quality(10 * TILE, TILE, samples=9, depth=3, noise_threshold=1e-6, fireflies="keep")
    sums = Accumulator(quality, ())
    normal = np.zeros((TILE, 10 * TILE, 3))
    normal[..., 1] = 1.0
    normal[:, : edges * TILE : TILE, 1] = 0.9
    sums.add("normal", normal, 16)
    sums.add("matte", np.ones((TILE, 10 * TILE, 1)), 16)
    for samples in (4, 5):
        rows = random.uniform(0.0, 1.0, (TILE, 10 * TILE, 5))
        sums.add("beauty", rows, samples)
        sums.end_round(by_tile=True)
    assert len(sums.active_pixels) == (TILE * TILE if edges == 1 else 0)


@pytest.mark.parametrize("error", [0.001, 0.3])
def test_frames_of_mitsubas_integrators_stop_as_a_whole(error: float) -> None:
    random = np.random.default_rng(7)
    quality = Quality(64, 32, samples=64, depth=3, noise_threshold=0.1, fireflies="keep")
    sums = Accumulator(quality, ())
    for _ in range(2):
        rows = np.full((32, 64, 5), 0.5)
        rows[:, :32, 3] += error * random.uniform(-1.0, 1.0, (32, 32))
        sums.add("beauty", rows, 16)
        sums.end_round(by_tile=False)
    assert sums.has_converged == (error < 0.01)
    assert sums.has_converged or len(sums.active_pixels) == 64 * 32


def test_each_tile_is_the_picture_of_as_many_samples(rendered: Rendered, engine: Engine) -> None:
    if engine.variant == "scalar_rgb":
        pytest.skip("there the whole frame stops")
    frame = rendered(quality=SOME, aovs=("samples", "noise"))
    counts = np.unique(frame["samples"])
    assert counts[0] == 8 and len(counts) > 2 and counts[-1] <= 48
    assert frame.facts["samples"] == pytest.approx(frame["samples"].mean(), abs=0.01)
    for count in map(int, counts[[0, -1]]):
        uniform = rendered(quality=replace(MOST, samples=count), aovs=("samples", "noise"))
        taken = frame["samples"] == count
        assert all(np.array_equal(frame[name][taken], uniform[name][taken]) for name in ("beauty", "noise"))


def test_the_measure_foretells_the_error(rendered: Rendered) -> None:
    """Against many more samples. Evenly spread samples have less error than their differences tell."""
    frame = rendered(quality=MOST)
    truth = rendered(quality=replace(MOST, samples=256, noise_threshold=None), seed=8)["beauty"]
    luma = np.array([0.2126, 0.7152, 0.0722])
    error = ((frame["beauty"] - truth) @ luma).ravel()
    noise = noise_of_tiles(Tiles.of(MOST), (truth @ luma).ravel(), error * error)
    true = np.quantile(noise, 0.95)
    assert 0.8 * true < frame.facts["noise"] < 2.0 * true


def test_a_crop_takes_the_samples_of_the_whole_picture(rendered: Rendered) -> None:
    whole = rendered(quality=SOME, aovs=("samples",))["samples"]
    part = rendered(quality=replace(SOME, crop=(8, 0, 48, 32)), aovs=("samples",))["samples"]
    inner = slice(0, 24), slice(16, 40)  # tiles at its edges do not see their neighbours beyond
    assert (part[inner[0], 8:32] == whole[inner]).mean() > 0.9


def test_moving_tiles_stop_between_rounds_and_threads_change_nothing(
    rendered: Rendered, sphere: Surface, engine: Engine
) -> None:
    right = CAMERA.axes()[0]

    def at(offset: float) -> MotionSample:
        moved = (sphere.vertices + 0.3 * offset * right).astype(np.float32)
        return MotionSample(replace(sphere, vertices=moved), StagePlacement(), CAMERA)

    moving = replace(SOME, samples=96)
    arguments = {"shutter": ShutterInterval(-0.25, 0.25, at), "aovs": ("samples", "noise"), "quality": moving}
    frame = rendered(**arguments)
    motion_samples = frame.facts["motion_samples"]
    assert motion_samples > 1 and 8 <= frame["samples"].min() < 96
    alone = rendered(engine=replace(engine, threads=1), **arguments)
    engine.start()
    assert frame.facts == alone.facts
    assert all(np.array_equal(frame[name], alone[name]) for name in frame.arrays)


@pytest.mark.parametrize("threshold", [0.0, -0.1, math.nan, math.inf])
def test_a_threshold_is_above_nothing(threshold: float) -> None:
    with pytest.raises(BadInputError, match="must be above 0"):
        Quality(64, 36, samples=64, depth=3, noise_threshold=threshold)
