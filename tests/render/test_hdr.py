"""Movies of high dynamic range show the nits that ACES 2.0 asks for, and say what light they hold."""

from __future__ import annotations

import struct
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.movie.codecs import HDR10, HDR10_AV1, HLG, Encode
from flowsculpt.render.movie.encode import write_movie
from flowsculpt.render.post.colour import quantise, to_display
from flowsculpt.render.post.hdr import (
    HDR_DISPLAYS,
    hlg_of_nits,
    nits_of_hlg,
    nits_of_pq,
    pq_of_nits,
)
from flowsculpt.render.post.view import ACES


def nits(values: np.ndarray, display: str) -> np.ndarray:
    return nits_of_pq(values) if display == "pq" else nits_of_hlg(values)


@given(st.floats(0.01, 10000.0))
def test_pq_gives_back_its_nits(value: float) -> None:
    assert nits_of_pq(pq_of_nits(np.array(value))) == pytest.approx(value, rel=1e-9)


@given(st.tuples(*[st.floats(0.01, 600.0)] * 3))  # HLG holds no pure blue of 1000 nits
def test_hlg_gives_back_its_nits(colour: tuple[float, float, float]) -> None:
    assert nits_of_hlg(hlg_of_nits(np.array(colour))) == pytest.approx(np.array(colour), rel=1e-6)


def test_the_curves_pass_through_the_points_of_the_recommendation() -> None:
    assert pq_of_nits(np.array([100.0, 203.0, 1000.0])) == pytest.approx([0.508, 0.581, 0.752], abs=5e-4)
    assert hlg_of_nits(np.full(3, 203.0)) == pytest.approx(0.75, abs=2e-3)


def light_of(value: float) -> np.ndarray:
    """Grey light (128, 192, 3) that ACES shows with these nits, found by bisection."""
    low, high = 0.0, 2000.0
    for _ in range(50):
        middle = (low + high) / 2
        shown = nits_of_pq(to_display(np.full((1, 1, 3), middle, np.float32), display="pq"))[0, 0, 0]
        low, high = (middle, high) if shown < value else (low, middle)
    return np.full((128, 192, 3), high, np.float32)


@pytest.mark.renderer
@pytest.mark.parametrize("encode", [HDR10, HDR10_AV1, HLG], ids=lambda encode: encode.name)
@pytest.mark.parametrize("value", [100.0, 203.0, 999.9])
def test_a_grey_card_comes_back_with_its_nits(encode: Encode, value: float, tmp_path: Path) -> None:
    frame = quantise(to_display(light_of(value), display=encode.display), 16)
    light = (round(value), round(value) - 1) if encode.display == "pq" else None
    write_movie(tmp_path / "a.mp4", iter([frame] * 3), Fraction(24), encode, light=light)
    with av.open(str(tmp_path / "a.mp4")) as container:
        shown = next(container.decode(video=0))
        luma = (shown.reformat(format="yuv444p16le").to_ndarray()[..., 0] / 256.0 - 16.0) / 219.0
        names = ("CONTENT_LIGHT_LEVEL", "MASTERING_DISPLAY_METADATA")
        levels, display = (bytes(shown.side_data.get(name) or b"") for name in names)
    found = nits(np.repeat(luma.mean()[None], 3), encode.display)
    assert found == pytest.approx(value, rel=0.01)
    if light is None:
        return
    assert struct.unpack_from("=II", levels) == light
    numbers = struct.unpack_from("=20i", display)
    red_x, peak = numbers[0] / numbers[1], numbers[18] / numbers[19]
    assert (red_x, peak) == pytest.approx((0.68, 1000.0), rel=1e-3)


@pytest.mark.parametrize("display", HDR_DISPLAYS)
def test_the_baked_view_is_that_of_opencolorio(display: str) -> None:
    from flowsculpt.render.post.colour import view_exactly

    light = np.repeat(np.geomspace(1e-2, 900.0, 200, dtype=np.float32)[None, :, None], 3, axis=2)
    exact = nits_of_pq(view_exactly(light, view=ACES.in_hdr()))
    assert nits(to_display(light, display=display), display) == pytest.approx(exact, rel=0.01)


def test_another_view_is_refused() -> None:
    with pytest.raises(BadInputError, match=r"'Raw'.* leave its view out, or deliver h265"):
        to_display(np.ones((1, 1, 3), np.float32), display="pq", view=replace(ACES, view="Raw"))
