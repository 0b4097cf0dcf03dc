"""Frames and their rate."""

from __future__ import annotations

from fractions import Fraction

import fileseq
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.pipeline.frames import FrameRange, FrameRate

RATES = ("24", "23.976", "29.97", "60", "1000/7")


@given(st.sampled_from(RATES), st.integers(-(10**12), 10**12) | st.floats(-1e12, 1e12))
def test_a_time_is_the_nearest_that_a_number_can_say(rate: str, frames: float) -> None:
    fps = FrameRate.of(rate)
    assert fps.seconds(frames) == float(Fraction(frames) / fps.fps)


@given(
    st.integers(0, 3000), st.integers(0, 3000), st.sampled_from(("{}-{}", "00{}-0{}", "{}-{}x3", " {}-{}"))
)
def test_a_plain_range_is_what_the_grammar_says(first: int, last: int, written: str) -> None:
    text = written.format(first, last)
    assert FrameRange.parse(text).numbers == tuple(fileseq.FrameSet(text))
