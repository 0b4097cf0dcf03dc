"""How cards of an edit look, and where their words lie."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.production.request.edit import Edit
from flowsculpt.pipeline.shot import Film, read_film
from flowsculpt.pipeline.shot.shot import Card
from flowsculpt.render.graphics.cards import Screen
from flowsculpt.render.scene.render_camera import PERSPECTIVE

SHOT = (Path(__file__).parent / "cube.yaml").read_text(encoding="utf-8")
SECONDS = "title_seconds: 0.5\ncredits_seconds: 0.5\ncredits: [Made by hand]\n"


def film(folder: Path, more: str, entries: str = "A, {card: Two, seconds: 0.5}, A") -> Film:
    (folder / "A.yaml").write_text(SHOT, encoding="utf-8")
    (folder / "film.yaml").write_text(f"title: Reel\nshots: [{entries}]\n{SECONDS}{more}", encoding="utf-8")
    return read_film(folder / "film.yaml")


def pictures(edit: Edit) -> list[Any]:
    """The frames of an edit whose shots are black, 96 by 54 pixels."""
    screen, black = Screen(PERSPECTIVE, (96, 54)), np.zeros((54, 96, 3), np.uint16)
    return list(edit.frames(screen, lambda _clip: iter([black] * 96), lambda frame: frame))


def test_a_card_looks_as_the_films_cards_do_unless_it_says_otherwise(tmp_path: Path) -> None:
    entries = "{card: One}, A, {card: Two, ground: '#808080', size: 2}"
    read = film(tmp_path, "cards: {font: DroidSerif, colour: '#ff8000', size: 1.5}\n", entries)
    title, one, _, two, credits = read.entries
    assert all(isinstance(each, Card) for each in (title, one, two, credits))
    styles = [each.style for each in (title, one, two, credits)]  # type: ignore[union-attr]
    assert {style.font for style in styles} == {"DroidSerif"} and [s.size for s in styles] == [
        1.5,
        1.5,
        2,
        1.5,
    ]
    assert styles[2].ground == pytest.approx([128 / 255] * 3, abs=1e-6)
    assert styles[0].colour == pytest.approx([1, 128 / 255, 0], abs=1e-6)


def test_words_over_pictures_take_no_time_and_lie_where_their_card_stands(tmp_path: Path) -> None:
    plain, over = film(tmp_path, ""), film(tmp_path, "cards: {ground: picture}\n")
    shot = over.length // 2
    assert plain.length == over.length + 3 * 12 and over.seconds == over.length / 24
    edit = Edit.of(over, "film")
    assert [(item.first, item.frames) for item in edit.over] == [(0, 12), (shot, 12), (2 * shot - 12, 12)]
    lit = [number for number, picture in enumerate(pictures(edit)) if picture.any()]
    expected = {*range(12), *range(shot, shot + 12), *range(2 * shot - 12, 2 * shot)}
    assert {*lit} <= expected and len(lit) >= 0.7 * len(expected)


def test_words_over_pictures_are_low_in_the_picture_or_where_the_edit_says(tmp_path: Path) -> None:
    for position, (first, last) in {"": (32, 54), "high": (0, 22), "middle": (14, 40)}.items():
        more = f"cards: {{ground: picture{f', position: {position}' if position else ''}}}\n"
        rows = np.flatnonzero(pictures(Edit.of(film(tmp_path, more), "film"))[6].any(axis=(1, 2)))
        assert first <= rows.min() and rows.max() < last, position


def test_words_stand_in_a_half_of_a_wide_picture_where_the_sculpture_does_not(tmp_path: Path) -> None:
    for position, (first, last) in {"left": (0, 48), "right": (48, 96)}.items():
        edit = Edit.of(film(tmp_path, f"cards: {{ground: picture, position: {position}}}\n"), "film")
        columns = np.flatnonzero(pictures(edit)[6].any(axis=(0, 2)))
        assert first < columns.min() and columns.max() < last - 1, position


def test_a_card_on_a_coloured_ground_has_its_colours(tmp_path: Path) -> None:
    read = film(tmp_path, "cards: {ground: '#c04020', colour: '#ffffff'}\n")
    picture = pictures(Edit.of(read, "film"))[6] / 65535 * 255
    assert picture[0, 0] == pytest.approx([192, 64, 32], abs=1) and picture.max() > 200


def test_an_edit_whose_cards_say_nothing_keeps_its_key(tmp_path: Path) -> None:
    edit = Edit.of(film(tmp_path, ""), "film")
    assert edit.over == () and all(item.style == edit.items[0].style for item in edit.items)


@pytest.mark.parametrize(
    ("more", "entries", "message"),
    [
        (
            "cards: {font: DroidSanz}",
            "A",
            r"film\.yaml:6:9: cards\.font: font 'DroidSanz' not found. Did you mean 'DroidSans'",
        ),
        ("cards: {position: bottom}", "A", r"'bottom' is not a position"),
        ("cards: {ground: pictures}", "A", r"'pictures' is not a colour"),
        ("cards: {size: 9}", "A", r"must be at most 4"),
        (
            "cards: {ground: picture}",
            "A, {card: x, dissolve: 3}",
            r"film\.yaml:2:\d+: words over pictures do not dissolve",
        ),
        ("cards: {ground: picture}", "{shot: A, dissolve: 3}", r"there is nothing before the first entry"),
        (
            "cards: {ground: picture}",
            "{shot: A, frames: 1-20}",
            r"film\.yaml:2:1: words lie over 24 frames, and the film has 20",
        ),
    ],
)
def test_cards_that_cannot_be_are_told_with_their_place(
    tmp_path: Path, more: str, entries: str, message: str
) -> None:
    with pytest.raises(ShotError, match=message):
        film(tmp_path, more + "\n", entries)
