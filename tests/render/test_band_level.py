"""The level of a band is that of the closed form, whatever the file's format."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.arrays import Floats
from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.movie.band_level import BandLevel, _analysed, band_level
from tests.sounds import sine, times, write_sound


def level_of(path: Path, low: float, high: float) -> BandLevel:
    return band_level(path, hashlib.sha256(path.read_bytes()).hexdigest(), low, high)


def middle(level: BandLevel) -> Floats:
    """Levels away from the ends, which windows share with silence."""
    return level.levels[len(level.levels) // 4 : 3 * len(level.levels) // 4]


@pytest.mark.parametrize("band", [(20.0, 250.0), (250.0, 4000.0), (4000.0, 20000.0)])
def test_a_sine_in_a_band_has_its_amplitude_and_others_are_left_out(
    band: tuple[float, float], tmp_path: Path
) -> None:
    parts = {100.0: 0.5, 1000.0: 0.25, 9000.0: 0.125}
    path = write_sound(tmp_path / "a.wav", np.sum([sine(f, 1, a) for f, a in parts.items()], axis=0))
    expected = next(a for f, a in parts.items() if band[0] <= f <= band[1])
    np.testing.assert_allclose(middle(level_of(path, *band)), expected, atol=5e-4)


def test_all_bands_together_have_the_power_of_the_sound(tmp_path: Path) -> None:
    noise = np.random.default_rng(3).uniform(-0.5, 0.5, 96_000)
    path = write_sound(tmp_path / "a.wav", noise)
    whole, parts = level_of(path, 0, 24000), [level_of(path, f, f + 8000) for f in (0, 8000, 16000)]
    power = np.sum([np.mean(middle(part) ** 2) for part in parts])
    assert np.mean(middle(whole) ** 2) == pytest.approx(2 * np.mean(noise**2), rel=0.01)
    assert power == pytest.approx(np.mean(middle(whole) ** 2), rel=1e-5)


@pytest.mark.parametrize(
    ("codec", "rate", "layout"),
    [("pcm_s16le", 44100, "mono"), ("pcm_s24le", 48000, "stereo"), ("pcm_f32le", 96000, "5.1")],
)
def test_formats_rates_and_channels_have_the_same_level(
    codec: str, rate: int, layout: str, tmp_path: Path
) -> None:
    channels = {"mono": 1, "stereo": 2, "5.1": 6}[layout]
    wave = sine(441, 0.5, 0.5, rate) * np.array([(-1) ** c for c in range(channels)])[:, None]  # out of phase
    path = write_sound(tmp_path / "a.wav", wave, rate, layout, codec)
    level = level_of(path, 250, 4000)
    assert level.seconds == 0.5
    np.testing.assert_allclose(middle(level), 0.5, rtol=2e-3)


def test_a_step_rises_at_its_time(tmp_path: Path) -> None:
    path = write_sound(tmp_path / "a.wav", np.where(times(1) < 0.5, 0, sine(3000, 1)))
    level = level_of(path, 250, 4000)
    half = np.interp(0.25**0.5 * 0.5, level.levels[:110], np.arange(110) * level.interval)  # half the power
    assert half == pytest.approx(0.5, abs=0.004)


def test_a_long_file_is_read_in_parts_with_the_same_levels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = str(write_sound(tmp_path / "a.wav", np.random.default_rng(1).uniform(-0.3, 0.3, 30_000)))
    whole = _analysed(path, "250", "4000")
    monkeypatch.setattr("flowsculpt.render.movie.band_level._MOST_AT_ONCE", 4000)
    assert _analysed(path, "250", "4000") == whole


def damaged(path: Path, how: str) -> Path:
    """Write a file that is no whole sound."""
    if how == "cut off":
        write_sound(path, sine(400, 0.5))
        path.write_bytes(path.read_bytes()[:20_000])
    elif how == "holds none":
        write_sound(path, np.zeros(1))
        path.write_bytes(path.read_bytes()[:-3])
        content = path.read_bytes().rpartition(b"data")[0]
        path.write_bytes(
            content[:4] + (len(content)).to_bytes(4, "little") + content[8:] + b"data" + bytes(4)
        )
    elif how == "not a finite number":
        write_sound(path, np.where(times(0.5) == 0.25, np.nan, 0.1), codec="pcm_f32le")
    else:
        path.write_bytes(b"words, and no sound" * 100)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("how", ["cut off", "holds none", "not a finite number", "Invalid data"])
def test_a_bad_file_is_refused_with_its_name_and_the_reason(how: str, tmp_path: Path) -> None:
    path = damaged(tmp_path / "a.wav", how)
    with pytest.raises(BadInputError, match=rf"a\.wav: cannot be read as sound \(.*{how}.*\); save it"):
        level_of(path, 20, 250)


def test_a_band_above_half_of_the_sample_rate_is_refused(tmp_path: Path) -> None:
    path = write_sound(tmp_path / "a.wav", sine(400, 0.5, rate=8000), 8000)
    with pytest.raises(BadInputError, match="8000 samples a second, so it has nothing above 4000 Hz"):
        level_of(path, 4000, 20000)
