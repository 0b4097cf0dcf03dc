"""The piece of music that a shot follows: its parts enter one after another, and the file holds it."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from examples import music
from flowsculpt.render.base.input_files import InputFile
from flowsculpt.render.movie.band_level import band_level
from flowsculpt.render.movie.movie_sound import Sound, blocks

FILE = Path(__file__).parents[2] / "shots" / "pulse.opus"
BAR = 4 * music.BEAT


def mean_level(low: float, high: float, bar: int) -> float:
    """Return the mean level of a band in a bar, over that of the fourth bar."""
    level = band_level(FILE, InputFile(FILE).digest(), low, high)
    first, fourth = (
        slice(int(b * BAR / level.interval), int((b + 0.9) * BAR / level.interval)) for b in (bar, 3)
    )
    return float(level.levels[first].mean() / level.levels[fourth].mean())


def test_bass_begins_strings_join_in_the_second_bar_and_hats_in_the_third() -> None:
    assert mean_level(20, 250, 0) > 0.5
    assert mean_level(250, 4000, 0) < 0.8 * mean_level(250, 4000, 1)
    assert mean_level(6000, 20000, 1) < 0.2 < 0.8 < mean_level(6000, 20000, 2)


@pytest.mark.slow
def test_the_file_holds_what_the_script_composes() -> None:
    composed = music.compose()
    assert composed.shape == (2, round(music.SECONDS * music.RATE)) and np.abs(composed).max() <= 1.0
    stored = np.concatenate(list(blocks(Sound(FILE), Fraction(music.SECONDS).limit_denominator(100))), axis=1)
    assert np.corrcoef(composed[0], stored[0])[0, 1] > 0.95
    assert FILE.stat().st_size < 300_000
