"""A burn-in says which frame a picture is, on any picture, and costs next to nothing."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.graphics.typesetting import FIELDS, BurnIn, set_line
from flowsculpt.render.movie.codecs import timecode

VALUES = {
    "shot": "A010_cube",
    "version": "v003",
    "frame": 42,
    "timecode": "00:00:01:18",
    "key": "9f3a61c0d2",
    "quality": "draft",
}
GREY = np.full((540, 960, 3), 128, dtype=np.uint8)


def ink(picture: np.ndarray, rows: slice, columns: slice) -> bool:
    """Tell whether any pixel there is brighter than a darkened grey."""
    return bool(picture[rows, columns].max() > 140)


def test_every_corner_says_its_own() -> None:
    shown = BurnIn().over(GREY, VALUES)
    for rows in (slice(0, 40), slice(500, 540)):
        for columns in (slice(0, 120), slice(840, 960)):
            assert ink(shown, rows, columns)
    assert (shown[60:480] == GREY[60:480]).all()
    assert (GREY == 128).all()


@pytest.mark.parametrize("field", FIELDS)
def test_one_field_alone_stands_in_one_corner(field: str) -> None:
    shown = BurnIn((field,)).over(GREY, VALUES)
    corners = [
        ink(shown, rows, columns)
        for rows in (slice(0, 40), slice(500, 540))
        for columns in (slice(0, 200), slice(760, 960))
    ]
    assert sum(corners) == 1


def test_what_has_no_value_is_left_out() -> None:
    assert (BurnIn().over(GREY, {}) == GREY).all()
    assert (BurnIn().over(GREY, {"version": "", "shot": "  "}) == GREY).all()


@pytest.mark.parametrize("level", [0, 128, 255])
def test_type_can_be_read_on_any_ground(level: int) -> None:
    shown = BurnIn().over(np.full_like(GREY, level), VALUES)[510:535, 10:125, 1].astype(float)
    light = ((shown / 255.0) ** 2.4 + 0.05).clip(0.05)
    assert light.max() / light.min() > 4.5  # the contrast that WCAG 2 asks for


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
def test_pictures_of_any_depth_are_burnt_in_alike(kind: type) -> None:
    top = 1.0 if kind is np.float32 else np.iinfo(kind).max
    picture = np.full((108, 192, 3), 0.5 * top).astype(kind)
    shown = BurnIn().over(picture, VALUES)
    assert shown.dtype == kind
    reference = BurnIn().over(np.full((108, 192, 3), 0.5, dtype=np.float32), VALUES)
    assert np.abs(shown / top - reference).max() < 1 / 128


@pytest.mark.parametrize("size", [(1, 1), (9, 16), (5, 300), (300, 5), (36, 64)])
def test_tiny_pictures_show_what_has_room(size: tuple[int, int]) -> None:
    assert BurnIn().over(np.zeros((*size, 3), dtype=np.uint8), VALUES).shape == (*size, 3)


def test_long_names_leave_the_timecode_alone() -> None:
    long = BurnIn().over(GREY, {**VALUES, "shot": "A010_" + "very_" * 60 + "long"})
    assert (long[490:, 830:] == BurnIn().over(GREY, VALUES)[490:, 830:]).all()


def test_numbers_stand_still_while_they_count() -> None:
    burn_in = BurnIn(("frame", "timecode"))
    first, second = (burn_in.over(GREY, {"frame": n, "timecode": timecode(n, Fraction(24))}) for n in (0, 31))
    assert (first[500:, :885] == second[500:, :885]).mean() > 0.99


def test_an_unknown_field_is_told() -> None:
    with pytest.raises(BadInputError, match=r"'tiemcode' cannot be burnt in. Did you mean 'timecode'\?"):
        BurnIn.parse("shot,tiemcode")
    assert BurnIn.parse("all").fields == FIELDS
    assert BurnIn.parse("frame, shot").fields == ("frame", "shot")
    with pytest.raises(BadInputError, match="goes over a picture"):
        BurnIn().over(np.zeros((4, 4), dtype=np.uint8), VALUES)


def test_frames_that_count_on_typeset_no_letter_again() -> None:
    def typeset(numbers: range) -> int:
        """Return how many letters or lines are typeset, for frames burnt in one after another."""
        before = set_line.cache_info().misses
        for number in numbers:
            counting = {"frame": number, "timecode": timecode(number, Fraction(24))}
            BurnIn().over(GREY, {**VALUES, **counting})
        return set_line.cache_info().misses - before

    set_line.cache_clear()
    assert typeset(range(10)) > 10
    assert typeset(range(100, 140)) == 0


def test_timecode_counts_frames_of_the_nominal_rate() -> None:
    assert timecode(42, Fraction(24)) == "00:00:01:18"
    assert timecode(24 * 3600, Fraction(24000, 1001)) == "01:00:00:00"
    assert timecode(-1, Fraction(25)) == "23:59:59:24"
    assert timecode(99, Fraction(120)) == ""
    assert timecode(1, Fraction(121, 10)) == ""
