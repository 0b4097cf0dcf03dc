"""Contact sheets: every picture in its place to the last bit, words beside and never on them."""

from __future__ import annotations

import numpy as np
import pytest

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.graphics.contact_sheet import (
    GROUND,
    MAX_PIXELS,
    VACANT,
    ContactSheet,
    reduced,
    reduction,
)

SIZE = (64, 36)
CAPTIONS = tuple((("strength", f"{s}"), ("max_edge_length", f"{m}")) for s in (1, 2) for m in (0.1, 0.2, 0.3))
GREY = round(255 * GROUND)


def picture(value: int, dtype: type = np.uint8) -> np.ndarray:
    """Return a picture in a colour that no word has."""
    return np.full((SIZE[1], SIZE[0], 3), (value, 0, 255), dtype)


def found(page: np.ndarray, value: int) -> tuple[slice, slice]:
    """Return the rows and columns of the pixels of a value."""
    rows, columns = np.nonzero((page == (value, 0, 255)).all(axis=2))
    return slice(rows.min(), rows.max() + 1), slice(columns.min(), columns.max() + 1)


def test_pictures_stand_in_rows_at_equal_distances_and_unchanged() -> None:
    page = ContactSheet("A shot", CAPTIONS, SIZE, 3).picture([picture(200 + i) for i in range(6)], "frame 3")
    places = [found(page, 200 + i) for i in range(6)]
    for i, place in enumerate(places):
        assert (page[place] == (200 + i, 0, 255)).all() and page[place].shape == (36, 64, 3)
    lefts, tops = ([place[axis].start for place in places] for axis in (1, 0))
    assert lefts[:3] == lefts[3:] and lefts[1] - lefts[0] == lefts[2] - lefts[1] > SIZE[0]
    assert tops[0] == tops[1] == tops[2] < tops[3]
    inked = np.nonzero((page != GREY).any(axis=2))
    left, right = inked[1].min(), page.shape[1] - 1 - inked[1].max()
    assert abs(left - right) <= 2, "margins are even"


def test_captions_are_read_below_their_own_picture() -> None:
    alike = ContactSheet("", CAPTIONS, SIZE, 3).picture([picture(0)] * 6)
    other = [*CAPTIONS[:5], (("strength", "9"), CAPTIONS[5][1])]
    changed = ContactSheet("", other, SIZE, 3).picture([picture(0)] * 6)
    rows, columns = np.nonzero((alike != changed).any(axis=2))
    place = found(ContactSheet("", CAPTIONS, SIZE, 3).picture([picture(200 + i) for i in range(6)]), 205)
    assert len(rows) and rows.min() >= place[0].stop and columns.min() >= place[1].start


def test_a_picture_that_is_missing_leaves_the_others_where_they_are() -> None:
    sheet = ContactSheet("A shot", CAPTIONS, (160, 90), 3)
    shown = np.full((90, 160, 3), 250, np.uint8)
    page, whole = sheet.picture([None, *[shown] * 5]), sheet.picture([shown] * 6)
    rows, columns = np.nonzero((page != whole).any(axis=2))
    assert (rows.max() - rows.min() + 1, columns.max() - columns.min() + 1) == (90, 160)
    vacant = page[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    assert vacant.max() > 100 > np.median(vacant), "it says so"


@pytest.mark.parametrize("value", ["x" * 90, "", "1.25"])
def test_whatever_is_written_stays_on_the_page_and_off_its_neighbour(value: str) -> None:
    captions = [(("a_long_name_of_something", value),), (("", value),)]
    page = ContactSheet("heading " * 40, captions, SIZE, 2).picture([picture(3), picture(5)], "frame 1")
    inked = np.nonzero((page != GREY).any(axis=2))
    assert inked[1].min() >= 20 and inked[1].max() < page.shape[1] - 20
    assert page.shape[1] < 1200
    assert (page[found(page, 5)] == (5, 0, 255)).all()


def test_pages_of_a_movie_have_sixteen_bits_and_one_size() -> None:
    sheet = ContactSheet("A shot", CAPTIONS, SIZE, 2, bits=16)
    pages = [sheet.picture([picture(value, np.uint16)] * 6, f"frame {value}") for value in (1, 60000)]
    assert pages[0].dtype == np.uint16 and pages[0].shape == pages[1].shape
    assert pages[0][0, 0].tolist() == [round(65535 * GROUND)] * 3


def test_a_smaller_picture_stands_in_the_middle_of_its_place() -> None:
    sheet = ContactSheet("A shot", CAPTIONS[:1], SIZE, 1)
    place = found(sheet.picture([picture(7)]), 7)
    small = sheet.picture([picture(7)[:20, :30]])[place].reshape(SIZE[1], SIZE[0], 3)
    top, left = (SIZE[1] - 20) // 2, (SIZE[0] - 30) // 2
    assert (small[top : top + 20, left : left + 30] == picture(7)[:20, :30]).all()
    assert (small[:top] == round(255 * VACANT)).all(), "around it the place is empty"


def test_what_cannot_be_on_a_sheet_is_refused() -> None:
    sheet = ContactSheet("A shot", CAPTIONS, SIZE, 3)
    with pytest.raises(BadInputError, match="5 pictures for 6 captions"):
        sheet.picture([picture(1)] * 5)
    with pytest.raises(BadInputError, match=r"on this sheet it must be uint8 of at most \(36, 64, 3\)"):
        sheet.picture([picture(1, np.uint16)] * 6)
    with pytest.raises(BadInputError, match="0 pictures"):
        ContactSheet("A shot", (), SIZE, 3)


def test_columns_make_a_sheet_like_a_screen() -> None:
    assert [ContactSheet.columns_for(count, (480, 270)) for count in (1, 2, 4, 9, 16, 100)] == [
        1,
        2,
        2,
        3,
        4,
        10,
    ]
    assert ContactSheet.columns_for(3, (480, 270)) == 3, "no empty place"


def test_large_sheets_show_smaller_pictures() -> None:
    assert reduction(4, 2, (480, 270)) == 1
    factor = reduction(100, 10, (1920, 1080))
    assert 10 * 1920 / factor <= MAX_PIXELS
    light = np.arange(5 * 7 * 3, dtype=np.float32).reshape(5, 7, 3)
    small = reduced(light, 2)
    assert small.shape == (2, 3, 3)
    assert np.allclose(small[1, 2], light[2:4, 4:6].mean(axis=(0, 1)))
