"""Half floats have the bits that numpy gives them."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.render.post.half_floats import fill_from_half, to_half

_INTERESTING = [
    0.0,
    2**-25,
    3 * 2**-25,
    2**-24,
    2**-14,
    1 + 2**-11,
    1 + 3 * 2**-11,
    65504.0,
    65520.0,
    np.inf,
    np.nan,
]


@given(st.lists(st.integers(0, (1 << 32) - 1), max_size=50))
def test_floats_are_rounded_as_numpy_rounds_them(bits: list[int]) -> None:
    signed = np.array([*_INTERESTING, *np.negative(_INTERESTING)], np.float32)
    values = np.concatenate([signed, np.array(bits, np.uint32).view(np.float32)])
    with np.errstate(invalid="ignore"):
        expected = np.clip(values, np.float32(-65504), np.float32(65504)).astype(np.float16)
    assert np.array_equal(to_half(values).view(np.uint16), expected.view(np.uint16))


def test_every_half_float_becomes_its_float() -> None:
    halves = np.arange(1 << 16, dtype=np.uint16).view(np.float16).reshape(256, 256)
    joined = np.full((256, 256, 3), 7.0, np.float32)
    fill_from_half(joined, 1, halves)
    assert np.array_equal(joined[..., 1].view(np.uint32), halves.astype(np.float32).view(np.uint32))
    assert (joined[..., ::2] == 7.0).all()
