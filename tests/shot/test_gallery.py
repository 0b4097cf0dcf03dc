"""The shots of the gallery: each is good, says what it is for, and is on its page and in the showreel."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from flowsculpt.pipeline.shot import read_film, read_shot
from flowsculpt.pipeline.shot.yaml.inheritance import DEFAULTS
from flowsculpt.pipeline.shot.yaml.named_files import is_edit
from flowsculpt.pipeline.shot.yaml.yaml_source import YamlSource
from tests.needed_plugins import gallery_rows, needed_by, needed_by_gallery, needs_plugins

PROJECT = Path(__file__).parents[2]
SHOTS = sorted(
    path for path in (PROJECT / "shots").glob("*.yaml") if not is_edit(path) and path.name != DEFAULTS
)
EDITS = sorted(path for path in (PROJECT / "shots").glob("*.yaml") if is_edit(path))

TWO_MINUTES = 120.0
"""Seconds that a showreel may last."""


@pytest.mark.parametrize("path", gallery_rows(SHOTS))
def test_a_shot_has_one_sentence_of_intent_and_a_sensible_length(path: Path) -> None:
    shot = read_shot(path)
    assert shot.intent.endswith(".") and shot.intent.count(". ") == 0
    assert 2.0 <= shot.rate.seconds(len(shot.frames)) <= 12.0


@pytest.mark.parametrize("path", gallery_rows(SHOTS))
def test_the_gallery_shows_every_shot_with_its_intent(path: Path) -> None:
    page = (PROJECT / "docs" / "gallery.md").read_text(encoding="utf-8")
    assert f"(pictures/gallery/{path.stem}.webp)" in page
    assert read_shot(path).intent in page
    assert (PROJECT / "docs" / "pictures" / "gallery" / f"{path.stem}.webp").is_file()


@pytest.mark.parametrize("path", SHOTS, ids=lambda path: path.stem)
def test_a_shot_says_in_its_first_line_which_plug_ins_it_needs(path: Path) -> None:
    added = tomllib.loads((PROJECT / "pipeline/plugins/added.toml").read_text(encoding="utf-8"))
    owners = {name: plugin for plugin, names in added.items() for name in names}
    owners |= {plugin: plugin for plugin in added}  # as in people.person
    parsed = YamlSource.read(path).data
    used = {owners.get(name) or owners.get(name.partition(".")[0]) for name in names_in(parsed)}
    assert needed_by(path) == sorted(used - {None})


def names_in(data: object) -> Iterator[str]:
    """Yield the names of all entries of parsed YAML, and the suffixes of files in it."""
    if isinstance(data, dict):
        for name, value in data.items():
            yield str(name)
            yield from names_in(value)
    elif isinstance(data, list):
        for value in data:
            yield from names_in(value)
    elif isinstance(data, str):
        yield Path(data).suffix


@needs_plugins(*needed_by_gallery())
def test_the_showreel_holds_every_shot_and_lasts_two_minutes_at_most() -> None:
    reel = read_film(PROJECT / "shots" / "showreel.yaml")
    assert {shot.name for shot in reel.shots} == {path.stem for path in SHOTS}
    assert TWO_MINUTES / 2 <= reel.seconds <= 1.1 * TWO_MINUTES


@needs_plugins(*needed_by_gallery())
def test_the_teaser_lasts_15_seconds_and_the_poster_one_frame() -> None:
    assert read_film(PROJECT / "shots" / "teaser.yaml").seconds == 15.0
    assert read_film(PROJECT / "shots" / "poster.yaml").seconds == 1 / 24


@pytest.mark.parametrize("path", gallery_rows(EDITS))
def test_every_edit_is_good(path: Path) -> None:
    assert {"film", "showreel"} <= {edit.stem for edit in EDITS}
    assert read_film(path).clips
