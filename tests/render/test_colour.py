"""The baked view agrees with OpenColorIO, and rounding does not band."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.post import colour
from flowsculpt.render.post.colour import DISPLAYS, quantise, to_display, view_exactly
from flowsculpt.render.post.view import ACES


def scene_colours(purest: float) -> np.ndarray:
    """Greys from black to far above white, and colours of every hue and brightness up to that purity."""
    rng = np.random.default_rng(5)
    hues = rng.random((64, 64, 3)) ** 2
    hues = purest * hues + (1.0 - purest) * hues.max(axis=2, keepdims=True)
    greys = np.repeat(np.concatenate([[0.0], np.geomspace(1e-4, 100.0, 63)])[None, :, None], 3, axis=2)
    return np.concatenate([hues * 2.0 ** rng.uniform(-7.0, 2.0, (64, 64, 1)), greys]).astype(np.float32)


@pytest.mark.parametrize("display", DISPLAYS)
def test_what_surfaces_reflect_is_within_one_step_of_the_exact_view(display: str) -> None:
    light = scene_colours(purest=0.75)
    difference = np.abs(to_display(light, display=display) - view_exactly(light, display))
    assert difference.max() < 1.0 / 255.0


@pytest.mark.parametrize("display", DISPLAYS)
def test_pure_colours_are_close_to_the_exact_view(display: str) -> None:
    light = scene_colours(purest=1.0)
    difference = np.abs(to_display(light, display=display) - view_exactly(light, display))
    assert np.percentile(difference, 99.5) < 1.0 / 255.0
    assert difference.max() < 8.0 / 255.0


def test_exposure_is_in_stops() -> None:
    light = scene_colours(purest=1.0)
    assert np.array_equal(to_display(light, exposure=1.0), to_display(light * np.float32(2.0)))


def test_black_stays_black_and_brighter_is_never_darker() -> None:
    ramp = np.repeat(np.geomspace(1e-4, 60.0, 500, dtype=np.float32)[None, :, None], 3, axis=2)
    shown = to_display(ramp)
    assert to_display(np.zeros((1, 1, 3), np.float32)).max() == 0.0
    assert (np.diff(shown, axis=1) >= -1e-6).all()
    assert 0.95 < shown.max() <= 1.0


def test_what_is_not_a_number_is_black() -> None:
    bad = np.full((1, 1, 3), np.nan, np.float32)
    assert to_display(bad).max() == 0.0
    assert to_display(-np.ones((1, 1, 3), np.float32)).max() == 0.0


def test_an_unknown_display_is_named() -> None:
    with pytest.raises(BadInputError, match="'imax'"):
        to_display(np.zeros((1, 1, 3), np.float32), display="imax")


def test_a_damaged_cache_is_baked_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platformdirs.user_cache_path", lambda name: tmp_path)
    monkeypatch.setattr(colour, "_bake", lambda *_: np.full((65, 65, 65, 3), 0.25, np.float32))
    (tmp_path / "views").mkdir()
    fresh = colour._lut.__wrapped__(ACES, ACES.still)
    (file,) = (tmp_path / "views").iterdir()
    whole = file.read_bytes()
    for damaged in (whole[:1000], whole[:5000] + bytes(len(whole) - 9000) + whole[-4000:], b"", b"[]"):
        file.write_bytes(damaged)
        assert np.array_equal(colour._lut.__wrapped__(ACES, ACES.still), fresh)
        assert file.read_bytes() == whole


def test_dithering_keeps_the_mean_of_a_slow_gradient() -> None:
    ramp = np.linspace(0.2, 0.21, 256, dtype=np.float32)
    values = np.repeat(np.tile(ramp, (64, 1))[..., None], 3, axis=2)
    columns = quantise(values)[..., 0].reshape(64, 16, 16).mean(axis=(0, 2)) / 255.0
    assert columns == pytest.approx(ramp.reshape(16, 16).mean(axis=1), abs=0.1 / 255.0)


def test_quantised_ends_are_exact() -> None:
    for bits, top in ((8, 255), (10, 1023), (16, 65535)):
        assert quantise(np.zeros((8, 8, 3), np.float32), bits).max() == 0
        assert quantise(np.ones((8, 8, 3), np.float32), bits).min() == top
