"""Few keys stand for many samples: within the tolerance, in time, and nearly as few as there can be."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.flow.keyframes import Handle, Keyframes
from flowsculpt.pipeline.plugins.preview.curve_fitting import FittedKey, evaluate, fit


def hand(seed: int, seconds: float, width: int = 1, rate: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Return the frames and values of somebody's hand: smooth turns, at uneven times."""
    random = np.random.default_rng(seed)
    times = np.sort(random.uniform(1.0, 1.0 + 24 * seconds, int(rate * seconds)))
    grid = np.arange(0.0, seconds + 2.0, 0.4)
    values = np.zeros((len(times), width))
    for part in range(width):
        coarse = random.normal(size=len(grid))
        near = np.exp(-(((times[:, None] - 1.0) / 24 - grid) ** 2) / 0.08)
        values[:, part] = (near * coarse).sum(axis=1) / near.sum(axis=1)
    return times, values


def on_curve(keys: list[FittedKey], times: np.ndarray) -> np.ndarray:
    """Return the values (T, K) of a curve between its first and its last key."""
    solved = np.array([[key.value, key.slope] for key in keys])
    return evaluate(np.array([key.time for key in keys]), solved, times)


def shown(keys: list[FittedKey], frame: float) -> tuple[float, ...]:
    """Return what the shot shows of the keys: by their handles."""
    times = tuple(key.time for key in keys)
    sides: list[list[Handle | None]] = []
    for step in (-1, 1):
        handles: list[Handle | None] = []
        for i, key in enumerate(keys):
            if not 0 <= i + step < len(keys):
                handles.append(None)
                continue
            third = (times[i + step] - times[i]) / 3.0
            handles.append(Handle(third, tuple((key.slope * third).tolist())))
        sides.append(handles)
    rows = tuple(tuple(key.value.tolist()) for key in keys)
    curve = Keyframes(times, rows, ("bezier",) * len(keys), tuple(sides[0]), tuple(sides[1]))
    return curve.at(frame)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), width=st.sampled_from([1, 3]), share=st.sampled_from([0.003, 0.01, 0.05]))
def test_no_sample_is_farther_away_than_the_tolerance(seed: int, width: int, share: float) -> None:
    times, values = hand(seed, 5.0, width)
    tolerance = share * np.ptp(values, axis=0)
    curve = fit(times, values, tolerance)
    assert curve.keys[0].time == times[0] and curve.keys[-1].time == times[-1]
    assert (np.abs(on_curve(curve.keys, times) - values) <= tolerance * (1 + 1e-9)).all()
    assert (curve.error <= tolerance * (1 + 1e-9)).all()
    assert (np.diff([key.time for key in curve.keys]) > 0).all()


def test_the_shots_own_curve_through_the_keys_is_the_fitted_one() -> None:
    times, values = hand(4, 3.0, 3)
    keys = fit(times, values, 0.01).keys
    for frame in np.linspace(times[0], times[-1], 50):
        assert shown(keys, frame) == pytest.approx(on_curve(keys, np.array([frame]))[0], abs=1e-9)


def test_a_minute_of_a_hand_takes_a_few_keys_a_second() -> None:
    times, values = hand(1, 60.0, rate=120)
    curve = fit(times, values, 0.01 * np.ptp(values))
    assert len(curve.keys) < 4 * 60
    assert fit(times, values, 0.03 * np.ptp(values)).keys.__len__() < len(curve.keys)


def test_a_step_is_two_keys_and_does_not_swing_past_its_ends() -> None:
    times = np.concatenate([np.linspace(1, 10, 60), np.linspace(10.01, 20, 60)])
    values = np.where(times <= 10, 2.0, 5.0)[:, None]
    keys = fit(times, values, 0.03).keys
    between = on_curve(keys, np.linspace(1, 20, 2000))
    assert between.min() > 2.0 - 0.1 and between.max() < 5.0 + 0.1 and len(keys) <= 6


@pytest.mark.parametrize("count", [1, 2, 3])
def test_as_few_samples_as_there_can_be_are_kept(count: int) -> None:
    times, values = np.arange(3.0, 3.0 + count), np.arange(count, dtype=float)[:, None]
    curve = fit(times, values, 0.01)
    assert on_curve(curve.keys, times) == pytest.approx(values, abs=0.01)


def test_of_two_samples_at_one_time_the_later_one_stays() -> None:
    curve = fit([1.0, 2.0, 2.0, 3.0], np.array([[0.0], [0.0], [1.0], [1.0]]), 0.01)
    assert on_curve(curve.keys, np.array([2.0])) == pytest.approx(1.0, abs=0.011)


def test_keys_are_on_whole_frames_where_that_is_asked() -> None:
    times, values = hand(2, 10.0)
    curve = fit(times, values, 0.02 * np.ptp(values), whole=True)
    assert all(key.time.is_integer() for key in curve.keys)
    assert curve.keys[0].time <= times[0] and curve.keys[-1].time >= times[-1]
    assert curve.error[0] <= 0.025 * np.ptp(values)


def fewest(times: np.ndarray, values: np.ndarray, tolerance: float) -> int:
    """Return the fewest keys of any curve of cubics whose slopes may even break at keys, by trying all."""

    @cache
    def keys_from(start: int) -> int:
        if start == len(times) - 1:
            return 1
        ends = range(start + 1, len(times))
        return 1 + min(keys_from(end) for end in ends if fits(start, end))

    def fits(start: int, end: int) -> bool:
        share = (times[start : end + 1] - times[start]) / (times[end] - times[start])
        basis = np.vander(share, 4)
        rows = values[start : end + 1]
        solved = np.linalg.lstsq(basis, rows, rcond=None)[0]
        return bool(np.abs(basis @ solved - rows).max() <= tolerance)

    return keys_from(0)


@pytest.mark.parametrize("seed", range(4))
def test_hardly_any_key_could_be_spared(seed: int) -> None:
    times, values = hand(seed, 4.0, rate=15)
    tolerance = 0.02 * float(np.ptp(values))
    assert len(fit(times, values, tolerance).keys) <= 1.5 * fewest(times, values, tolerance) + 1
