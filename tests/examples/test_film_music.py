"""The music of the films: quiet, build, burst and rest are heard as such, and the file holds the piece."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from examples import film_music as music
from flowsculpt.pipeline.shot import read_film
from flowsculpt.render.movie.movie_sound import Sound, blocks
from tests.needed_plugins import needed_by_gallery, needs_plugins

PROJECT = Path(__file__).parents[2]
FILE = PROJECT / "shots" / "film_music.opus"


def stored() -> np.ndarray:
    """Return the file's samples (2, N)."""
    return np.concatenate(list(blocks(Sound(FILE), Fraction(music.SECONDS).limit_denominator(100))), axis=1)


def test_it_swells_from_quiet_over_build_to_burst_and_rests_without_clipping() -> None:
    samples, bar = stored(), round(music.BAR * music.RATE)
    parts = (music.QUIET, music.BUILD, music.BURST, music.REST, music.END)
    quiet, build, burst, rest = (
        20 * np.log10(np.std(samples[:, a * bar : b * bar])) for a, b in pairwise(parts)
    )
    assert quiet + 2 < build < burst - 2 and rest < burst - 4
    assert 0.5 < np.abs(samples).max() < 0.9
    assert FILE.stat().st_size < 700_000


@needs_plugins(*needed_by_gallery())
def test_the_showreel_is_as_long_as_its_music_and_cuts_on_beats() -> None:
    reel = read_film(PROJECT / "shots" / "showreel.yaml")
    assert reel.seconds == pytest.approx(music.SECONDS)
    assert all(len(clip.frames) % 16 == 0 for clip in reel.clips)


@pytest.mark.soak
def test_the_file_holds_what_the_script_composes() -> None:
    composed = music.compose()
    assert composed.shape == (2, round(music.SECONDS * music.RATE))
    assert np.corrcoef(composed[0], stored()[0, : composed.shape[1]])[0, 1] > 0.95
