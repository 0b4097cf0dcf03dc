"""The shots of the gallery: each is good, says what it is for, and is on its page and in the showreel."""

from __future__ import annotations

from pathlib import Path

import pytest

from flowsculpt.pipeline.shot import read_film, read_shot
from flowsculpt.pipeline.shot.yaml.inheritance import DEFAULTS
from flowsculpt.pipeline.shot.yaml.named_files import is_edit

PROJECT = Path(__file__).parents[2]
SHOTS = sorted(
    path for path in (PROJECT / "shots").glob("*.yaml") if not is_edit(path) and path.name != DEFAULTS
)
EDITS = sorted(path for path in (PROJECT / "shots").glob("*.yaml") if is_edit(path))

TWO_MINUTES = 120.0
"""Seconds that a showreel may last."""


@pytest.mark.parametrize("path", SHOTS, ids=lambda path: path.stem)
def test_a_shot_has_one_sentence_of_intent_and_a_sensible_length(path: Path) -> None:
    shot = read_shot(path)
    assert shot.intent.endswith(".") and shot.intent.count(". ") == 0
    assert 2.0 <= shot.rate.seconds(len(shot.frames)) <= 12.0


@pytest.mark.parametrize("path", SHOTS, ids=lambda path: path.stem)
def test_the_gallery_shows_every_shot_with_its_intent(path: Path) -> None:
    page = (PROJECT / "docs" / "gallery.md").read_text(encoding="utf-8")
    assert f"(pictures/gallery/{path.stem}.webp)" in page
    assert read_shot(path).intent in page
    assert (PROJECT / "docs" / "pictures" / "gallery" / f"{path.stem}.webp").is_file()


def test_the_showreel_holds_every_shot_and_lasts_two_minutes_at_most() -> None:
    reel = read_film(PROJECT / "shots" / "showreel.yaml")
    assert {shot.name for shot in reel.shots} == {path.stem for path in SHOTS}
    assert TWO_MINUTES / 2 <= reel.seconds <= 1.1 * TWO_MINUTES


def test_every_edit_is_good() -> None:
    assert {"film", "showreel"} <= {path.stem for path in EDITS}
    for path in EDITS:
        assert read_film(path).clips
