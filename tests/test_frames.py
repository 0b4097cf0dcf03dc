"""Frames and their rate."""

from __future__ import annotations

from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st

from pipeline.frames import FrameRate

RATES = ("24", "23.976", "29.97", "60", "1000/7")


@given(st.sampled_from(RATES), st.integers(-(10**12), 10**12) | st.floats(-1e12, 1e12))
def test_a_time_is_the_nearest_that_a_number_can_say(rate: str, frames: float) -> None:
    fps = FrameRate.of(rate)
    assert fps.seconds(frames) == float(Fraction(frames) / fps.fps)
