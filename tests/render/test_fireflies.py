"""Fireflies: single pixels whose light comes from too few samples."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.frame.accumulator import Accumulator
from flowsculpt.render.frame.fireflies import (
    BRIGHT_FACTOR,
    EVERYWHERE,
    REACH,
    RELIABLE_COUNT,
    FireflyFilter,
    _blurred,
    find_fireflies,
    kept_fractions,
)
from flowsculpt.render.scene.render_quality import Quality

SIZE = (18, 32)
GREY = 0.2


def filter_of(
    samples: NDArray[np.float64], treatment: str = "soft"
) -> tuple[FireflyFilter, NDArray[np.float64]]:
    """Return the filter of luminances (N, H, W) of samples, and their mean."""
    mean, square = samples.mean(axis=0), (samples * samples).mean(axis=0)
    counts, matte = np.full(mean.shape, float(len(samples))), np.zeros(mean.shape)
    return find_fireflies(mean, square, counts, matte, treatment), mean


def filtered(samples: NDArray[np.float64], treatment: str = "soft") -> NDArray[np.float64]:
    firefly_filter, mean = filter_of(samples, treatment)
    return firefly_filter.apply(mean[..., None])[..., 0]


def test_a_lone_spark_is_spread_and_no_light_is_lost() -> None:
    samples = np.full((16, *SIZE), GREY)
    samples[3, 9, 16] = 30.0
    light = filtered(samples)
    assert light.max() < 4.0 * GREY
    assert light.sum() == pytest.approx(samples.mean(axis=0).sum())
    others = np.delete(light.ravel(), 9 * 32 + 16)
    assert others.min() >= GREY - 1e-9
    assert np.abs(np.diff(light, axis=0))[:, 17:].max() < 0.02 * GREY  # no edge shows


def test_firm_removes_the_light_of_a_spark_and_tells_how_much() -> None:
    samples = np.full((16, *SIZE), GREY)
    samples[3, 9, 16] = 30.0
    firm, mean = filter_of(samples, "firm")
    light = firm.apply(mean[..., None])
    assert firm.facts(mean)["light_removed"] == pytest.approx(1.0 - light.sum() / mean.sum(), rel=0.01)
    assert firm.facts(mean)["light_spread"] == 0.0
    soft, mean = filter_of(samples, "soft")
    assert soft.facts(mean) == {
        "light_removed": 0.0,
        "light_left": 0.0,
        "light_spread": firm.facts(mean)["light_removed"],
    }


def test_a_sample_too_bright_for_the_whole_picture_stays_and_the_rest_is_hardly_brighter() -> None:
    samples = np.full((16, *SIZE), GREY)
    samples[3, 9, 16] = 1e5
    soft, mean = filter_of(samples)
    light = soft.apply(mean[..., None])[..., 0]
    assert light.sum() == pytest.approx(mean.sum())
    others = np.delete(light.ravel(), 9 * 32 + 16)
    assert others.max() < 1.021 * GREY
    facts = soft.facts(mean)
    assert facts["light_removed"] == 0.0
    assert facts["light_left"] + facts["light_spread"] == pytest.approx(
        filter_of(samples, "firm")[0].facts(mean)["light_removed"], rel=0.01
    )


def test_keep_changes_nothing() -> None:
    samples = np.full((4, *SIZE), GREY)
    samples[0, 9, 16] = 1e6
    firefly_filter, mean = filter_of(samples, "keep")
    assert np.array_equal(firefly_filter.apply(mean[..., None])[..., 0], mean)


@pytest.mark.parametrize("treatment", ["soft", "firm"])
def test_a_caustic_a_line_and_a_glint_of_many_samples_keep_their_light(treatment: str) -> None:
    chance = np.random.default_rng(1)
    caustic = np.where(chance.random((64, *SIZE)) < 0.02, 30.0, GREY)  # one sample in fifty, everywhere
    line = np.full((16, *SIZE), GREY)
    line[:, :, 16] = 50.0
    glint = np.full((64, *SIZE), GREY)
    glint[::4, 9, 16] = 50.0
    for samples in (caustic, line, glint):
        assert np.array_equal(filtered(samples, treatment), samples.mean(axis=0))


def test_less_light_is_removed_the_more_samples_are_taken() -> None:
    chance = np.random.default_rng(2)
    samples = np.where(chance.random((1024, *SIZE)) < 0.001, 30.0, GREY)
    removed = [
        1.0 - filtered(samples[:n], "firm").sum() / samples[:n].mean(axis=0).sum() for n in (16, 64, 256)
    ]
    assert removed[0] > removed[1] > removed[2]
    assert removed[2] < 0.001
    assert np.array_equal(filtered(samples, "firm"), samples.mean(axis=0))


def test_light_of_the_subject_stays_on_the_subject() -> None:
    mean, square = np.full(SIZE, GREY), np.full(SIZE, GREY * GREY)
    mean[9, 13], square[9, 13] = 1.5, 16 * 2.25
    matte = np.zeros(SIZE)
    matte[:, :16] = 1.0
    firefly_filter = find_fireflies(mean, square, np.full(SIZE, 16.0), matte, "soft")
    light = firefly_filter.apply(mean[..., None])[..., 0]
    assert light[:, :16].sum() == pytest.approx(mean[:, :16].sum())
    assert np.array_equal(light[:, 16:], mean[:, 16:])


@settings(max_examples=25, deadline=None)
@given(
    arrays(np.float64, (4, 6, 9), elements=st.floats(0.0, 1e5)),
    arrays(np.float64, (6, 9), elements=st.floats(0.0, 1.0)),
    st.sampled_from(["keep", "soft", "firm"]),
)
def test_light_groups_sum_to_the_beauty_and_light_is_neither_made_nor_lost(
    samples: NDArray[np.float64], share: NDArray[np.float64], treatment: str
) -> None:
    firefly_filter, mean = filter_of(samples, treatment)
    whole = firefly_filter.apply(mean[..., None])
    groups = [firefly_filter.apply((mean * part)[..., None]) for part in (share, 1.0 - share)]
    assert np.allclose(groups[0] + groups[1], whole, rtol=1e-9, atol=1e-9 * mean.max())
    if treatment == "firm":
        assert whole.sum() <= mean.sum() * (1.0 + 1e-9)
    else:
        assert whole.sum() == pytest.approx(mean.sum(), rel=1e-9)
    assert (whole >= -1e-9 * mean.max()).all()


@settings(max_examples=25, deadline=None)
@given(arrays(np.float64, (4, 6, 9), elements=st.floats(0.0, 100.0)))
def test_a_pixel_keeps_what_its_neighbours_and_like_samples_around_it_support(
    samples: NDArray[np.float64],
) -> None:
    mean, square = samples.mean(axis=0), (samples * samples).mean(axis=0)
    kept = kept_fractions(mean, square, np.full(mean.shape, 4.0), "soft")
    padded = np.pad(mean, 1, mode="edge")
    bright = square / np.maximum(mean, 1e-12)
    for y, x in np.ndindex(mean.shape):
        neighbours = np.delete(padded[y : y + 3, x : x + 3].ravel(), 4)
        bound = BRIGHT_FACTOR * np.sort(neighbours)[-3] + 1e-3
        around = np.s_[max(y - REACH, 0) : y + REACH + 1, max(x - REACH, 0) : x + REACH + 1]
        expected = 1.0
        if mean[y, x] > bound and 4.0 * mean[y, x] ** 2 < RELIABLE_COUNT * square[y, x]:
            count = np.sum(4.0 * square[around] / np.maximum(bright[y, x], bright[around]) ** 2)
            reliability = np.clip((count - 1.0) / (RELIABLE_COUNT - 1.0), 0.0, 1.0)
            expected = (bound + reliability * (mean[y, x] - bound)) / mean[y, x]
        assert kept[y, x] == pytest.approx(expected)


@pytest.mark.parametrize("shape", [(5, 7), (40, 70)])
@pytest.mark.parametrize("radius", [1, 6, 20])
def test_a_blur_is_two_box_means_along_both_axes_with_black_beyond(
    shape: tuple[int, int], radius: int
) -> None:
    picture = np.random.default_rng(3).random(shape)
    box = np.full(2 * radius + 1, 1.0 / (2 * radius + 1))

    def twin(line: NDArray[np.float64]) -> NDArray[np.float64]:
        once = np.convolve(line, box)[radius:-radius]
        return np.convolve(once, box)[radius:-radius]

    expected = np.apply_along_axis(twin, 1, np.apply_along_axis(twin, 0, picture))
    assert np.allclose(_blurred(picture, radius), expected, rtol=1e-12)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from([(9, 14), (64, 80)]))
def test_light_is_spread_to_the_bit_as_if_all_of_the_picture_were_blurred(
    seed: int, shape: tuple[int, int]
) -> None:
    rng = np.random.default_rng(seed)
    light = rng.random((*shape, 3))
    spread, reached, brightness = rng.random(shape), 1.0 + rng.random(shape), rng.random(shape)
    is_far = rng.random(shape) < 0.02
    radius = np.where(is_far, rng.choice([2, 6, 20, EVERYWHERE], shape), 0).astype(np.int32)
    subject = rng.random(shape) < 0.5
    expected = light * (1.0 - spread)[..., None]
    for part in (subject, ~subject):
        for reach in sorted({*radius[part].tolist()} - {0}):
            weight = np.where(part & (radius == reach), spread / reached, 0.0)
            for channel in range(3):
                blurred = _blurred(light[..., channel] * weight, reach)
                expected[..., channel] += np.where(part, brightness, 0.0) * blurred
    firefly_filter = FireflyFilter(1.0 - spread, brightness, subject, spread, reached, radius)
    assert np.array_equal(firefly_filter.apply(light), expected)


def test_a_sample_that_is_not_finite_spoils_nothing() -> None:
    quality = Quality(16, 9, samples=4, depth=2)
    accumulator = Accumulator(quality, ())
    light = np.full((9, 16, 5), GREY)
    light[4, 8] = np.nan
    light[2, 2, 1] = np.inf
    for name, channels in (("albedo", 3), ("normal", 3), ("position", 3), ("depth", 1), ("matte", 1)):
        accumulator.add(name, np.ones((9, 16, channels)), 4)
    accumulator.add("beauty", light, 4)
    assert np.isfinite(accumulator.frame_aovs()["beauty"]).all()
    assert accumulator.frame_aovs()["beauty"][0, 0, 0] == np.float32(GREY)


def test_an_unknown_treatment_is_refused_with_the_known_ones() -> None:
    with pytest.raises(BadInputError, match="fireflies is 'hard'; it can be keep, soft or firm"):
        Quality(16, 9, samples=4, depth=2, fireflies="hard")
