"""A curve of a sound follows its level as attack and release say, and has an exact integral."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.pipeline.flow.keyframes import Envelope, Normalisation, SoundCurve, elapsed

STEP = (0.0,) * 20 + (0.5,) * 200


def envelope(
    levels: tuple[float, ...] = STEP,
    attack: float = 0.0,
    release: float = 0.0,
    normalise: Normalisation = "full_scale",
) -> Envelope:
    return Envelope("digest", (20.0, 250.0), attack, release, normalise, 0.005, levels)


def test_a_step_rises_and_falls_by_63_percent_in_its_times() -> None:
    follower = envelope(attack=0.1, release=0.2)
    top = follower.at(219 * 0.005)
    assert top == pytest.approx(0.5 * (1 - math.exp(-200 * 0.005 / 0.1)), abs=1e-5)
    assert follower.at(0.095 + 0.1) == pytest.approx(0.5 * (1 - math.exp(-1)), abs=1e-5)
    assert follower.at(219 * 0.005 + 0.2) == pytest.approx(top * math.exp(-1), abs=1e-5)


def test_without_times_it_is_the_level_itself_and_0_outside() -> None:
    sharp = envelope()
    assert [sharp.at(s) for s in (-1.0, 0.05, 0.5, 1.099)] == pytest.approx([0.0, 0.0, 0.5, 0.1], abs=0.5)
    assert (sharp.at(-0.001), sharp.at(0.5), sharp.at(5.0)) == (0.0, 0.5, 0.0)


def test_the_loudest_moment_is_1_and_silence_is_not_raised() -> None:
    assert max(envelope(attack=0.3, normalise="loudest").values) == 1.0
    silent = envelope((1e-5,) * 50, normalise="loudest")
    assert silent.is_silent and max(silent.values) == 0.0


def test_equal_contents_and_settings_are_equal_curves() -> None:
    one, other = (SoundCurve(envelope(levels), 0.5, (0.0,), (1.0,)) for levels in (STEP, tuple(STEP)))
    assert one == other and hash(one) == hash(other)
    assert one != SoundCurve(envelope(release=0.1), 0.5, (0.0,), (1.0,))


@given(
    levels=st.lists(st.floats(0, 1), min_size=2, max_size=60),
    start=st.floats(-0.1, 0.3),
    base=st.floats(-3, 3),
    gain=st.floats(-3, 3),
    time=st.floats(0, 0.6),
)
def test_the_integral_is_that_of_straight_pieces(
    levels: list[float], start: float, base: float, gain: float, time: float
) -> None:
    curve = SoundCurve(envelope(tuple(levels), 0.01, 0.01), start, (base,), (gain,))
    times = np.unique([t for t in curve.times(time) if t <= time])
    middles, lengths = 0.5 * (times[1:] + times[:-1]), np.diff(times)
    exact = math.fsum(length * curve.at(middle)[0] for middle, length in zip(middles, lengths, strict=True))
    assert elapsed(curve, time) == pytest.approx(exact, abs=1e-9 + 0.005 * abs(gain))
    assert elapsed(curve, 0.0) == 0.0


def test_a_speed_that_follows_a_sound_passes_time_only_while_it_is_heard() -> None:
    speed = SoundCurve(envelope(), 1.0, (0.0,), (2.0,))
    assert elapsed(speed, 1.0) == 0.0
    assert elapsed(speed, 1.6) == pytest.approx(2.0 * 0.5 * 0.5, abs=0.005)
    assert elapsed(speed, 9.0) == elapsed(speed, 3.0)
