"""While the shutter is open things move, and a picture shows all of it: as wide as it is long, as bright."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from render.frame.sample_batches import (
    MAX_MOTION_SAMPLES,
    MAX_STEP,
    MIN_SAMPLES,
    ShutterInterval,
    batch_sizes,
    motion_sample_count,
)
from render.mitsuba.engine import Engine
from render.scene.aovs import RenderedFrame
from render.scene.camera import Camera
from render.scene.quality import BATCH_SAMPLES, Quality
from render.scene.scene import MotionSample
from render.scene.stage import StagePlacement
from render.scene.surface import Surface

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


@given(way=st.floats(0.0, 100.0), samples=st.sampled_from([1, 2, 3, 4, 5, 6, 7, 9, 12, 16, 32, 48, 64, 80]))
def test_subframes_share_all_samples_evenly(way: float, samples: int) -> None:
    count = motion_sample_count(way, samples)
    assert 1 <= count <= MAX_MOTION_SAMPLES
    each = batch_sizes(samples, count)
    assert sum(each) * count == samples
    assert len(set(each)) == 1 and each[0] <= BATCH_SAMPLES
    if samples >= 2 * MIN_SAMPLES:
        assert count == 1 or each[0] >= MIN_SAMPLES
    if samples in (16, 32, 64) and count < samples // MIN_SAMPLES:
        assert way <= MAX_STEP * count


def test_slow_things_are_not_cut_up() -> None:
    assert motion_sample_count(0.0, 64) == motion_sample_count(MAX_STEP, 64) == 1
    assert [motion_sample_count(way, 64) for way in (1.5, 3.0, 6.0, 50.0)] == [2, 4, 8, 16]
