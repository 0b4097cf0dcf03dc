"""A slate says what a clip is, shows by what a display is judged, and is always the same."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from flowsculpt.pipeline.plugins.delivery.slate import BARS, GREYS, Slate, failure_card
from flowsculpt.render.graphics.cards import TitleCard, title_frames
from flowsculpt.render.graphics.typesetting import Font

FACTS = (("version", "v003"), ("frames", "1-48"), ("quality", "final"))
PICTURE = np.tile(np.linspace(0.3, 0.7, 96, dtype=np.float32)[:, None], (54, 1, 3))


def test_a_slate_carries_bars_and_greys_of_exact_colours() -> None:
    slate = Slate("A010_cube", "A cube", FACTS).draw((960, 540))
    row = slate[465]
    for colour in BARS:
        assert (np.abs(row - np.float32(colour)).max(axis=1) == 0).any()
    for step in range(GREYS):
        assert (np.abs(row - np.float32(step / (GREYS - 1))).max(axis=1) == 0).any()


def test_the_same_shot_has_the_same_slate() -> None:
    one, other = (Slate("A010_cube", "A cube", FACTS, PICTURE).draw((480, 270)) for _ in range(2))
    assert one.dtype == np.float32
    assert (one == other).all()
    assert ((one >= 0.0) & (one <= 1.0)).all()


def test_a_picture_stands_on_it_small_and_unchanged_in_light() -> None:
    with_picture = Slate("A010_cube", "", FACTS, PICTURE).draw((960, 540))
    without = Slate("A010_cube", "", FACTS).draw((960, 540))
    rows, columns = np.nonzero(np.abs(with_picture - without).max(axis=2) > 0.05)
    shown = with_picture[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    assert abs(shown.shape[1] / shown.shape[0] - 96 / 54) < 0.03
    assert abs(shown.mean() - PICTURE.mean()) < 0.01


@pytest.mark.parametrize("size", [(1, 1), (16, 9), (5, 200), (200, 5), (270, 480), (2048, 858)])
def test_slates_and_cards_have_any_size(size: tuple[int, int]) -> None:
    slate = Slate("A", "b", FACTS, PICTURE)
    for page in (slate.draw(size), failure_card(size, "frame 17 failed", "disk full")):
        assert page.shape == (size[1], size[0], 3)
        assert np.isfinite(page).all()


@pytest.mark.slow
def test_a_long_name_is_set_smaller_and_a_long_reason_in_several_lines() -> None:
    slate = Slate("B" * 60, "T" * 300, [("key", "k" * 400)], PICTURE).draw((960, 540))
    assert np.abs(slate[60:200, 920:] - slate[60:200, 919:920]).max() < 0.02
    card = failure_card((960, 540), "frame 17 failed", "the surface is not finite " * 40)
    assert np.abs(card[:, 930:] - card[:, 929:930]).max() < 0.02


@pytest.mark.parametrize("size", [(270, 480), (270, 270), (1, 1), (5, 9), (480, 270)])
def test_titles_of_any_length_lie_within_cards_of_any_shape(size: tuple[int, int]) -> None:
    width, height = size
    words = TitleCard("A card with quite a few words on it", "and a subtitle that is longer still")
    page = next(itertools.islice(title_frames(words, size, 9, 4), 4, None))
    ground = next(itertools.islice(title_frames(TitleCard(""), size, 9, 4), 4, None))
    rows, columns = np.nonzero(np.abs(page - ground).max(axis=2) > 0.2)
    assert page.shape == (height, width, 3)
    if width > 100:
        assert columns.min() >= 0.09 * width and columns.max() <= 0.91 * width
        assert rows.min() > 0 and rows.max() < height - 1
        least = {270: 90, 480: 40}[width]
        assert np.ptp(rows) > least, "narrow cards have several lines, not small ones"


def test_an_upright_slate_shows_its_picture_below_its_facts() -> None:
    with_picture = Slate("A010_cube", "", FACTS, PICTURE).draw((540, 960))
    without = Slate("A010_cube", "", FACTS).draw((540, 960))
    rows, columns = np.nonzero(np.abs(with_picture - without).max(axis=2) > 0.05)
    assert rows.min() > 0.35 * 960 and columns.min() < 0.15 * 540 and np.ptp(columns) > 0.5 * 540


def test_words_are_wrapped_within_their_room() -> None:
    font = Font("DroidSans", 12)
    lines = font.wrap("the flow at frame 16 tears the surface apart", 100.0, max_lines=3)
    assert len(lines) == 3
    assert all(font.width(each) <= 100 for each in lines)
    assert font.cut_short("abc", 0.0) == ""
    assert font.cut_short("abc", 500.0) == "abc"


def x_height(with_words, without):
    """Return how many rows words of the letter x are high, and their contrast to the ground (WCAG 2.2)."""
    changed = np.abs(with_words - without).max(axis=2)
    rows = np.flatnonzero((changed > 0.5 * changed.max()).any(axis=1))
    spot = np.unravel_index(changed.argmax(), changed.shape)
    bright, dark = (
        np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4) @ (0.2126, 0.7152, 0.0722)
        for c in (with_words[spot], without[spot])
    )
    return rows[-1] - rows[0] + 1, (bright + 0.05) / (dark + 0.05)


def test_words_of_cards_can_be_read_in_the_smallest_quality():
    small = (480, 270)

    def title(subtitle):
        return next(itertools.islice(title_frames(TitleCard("", subtitle), small, 24, 4), 12, None))

    def slate(value):
        return Slate("A", "", [("", value)]).draw(small)

    def failure(reason):
        return failure_card(small, "A", reason)

    for drawn, least in ((title, 7), (slate, 5), (failure, 5)):
        height, contrast = x_height(drawn("xxx"), drawn(""))
        assert height >= least and contrast >= 4.5
