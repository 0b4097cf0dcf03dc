"""Lines of mixed directions: each case by the rules of UAX 9 that decide it, Hebrew in capitals there."""

from __future__ import annotations

from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.plugins.lettering.fonts import font_file
from flowsculpt.pipeline.plugins.lettering.text_direction import embedding_levels, visual_runs
from flowsculpt.pipeline.plugins.lettering.text_outlines import TextSettings, letters

HEBREW = dict(zip("ABCDEF", "אבגדהו", strict=True))
ARABIC = dict(zip("XYZ", "ابت", strict=True)) | dict(zip("789", "٧٨٩", strict=True))


def in_letters(text: str) -> str:
    return "".join((HEBREW | ARABIC).get(character, character) for character in text)


@pytest.mark.parametrize(
    ("text", "seen"),
    [
        ("abc", "abc"),
        ("ABC", "CBA"),
        ("AB 12", "12 BA"),
        ("12 AB", "BA 12"),
        ("abc DEF 12", "abc 12 FED"),
        ("abc DEF ghi", "abc FED ghi"),
        ("AB cd EF", "FE cd BA"),
        ("AB 1,5", "1,5 BA"),
        ("AB 1-5", "1-5 BA"),
        ("AB 10%", "10% BA"),
        ("XY 1-5", "5-1 YX"),
        ("XY 7,8", "7,8 YX"),
        ("AB 78", "78 BA"),
        ("a 12 B", "a 12 B"),
        ("ab (CD) ef", "ab (DC) ef"),
        ("AB (cd) EF", "FE (cd) BA"),
        ("AB (CD 12)", "(12 DC) BA"),
        ("a (B) c", "a (B) c"),
        ("A! ", " !A"),
        ("A!", "!A"),
        ("!A", "A!"),
        ("12, 34", "12, 34"),
        ("AB 12 cd 34", "cd 34 12 BA"),
    ],
)
def test_lines_are_ordered_as_uax_9_says(text, seen):
    line = in_letters(text)
    order = [
        place
        for run in visual_runs(line)
        for place in (range(run.start, run.end)[::-1] if run.is_leftwards else range(run.start, run.end))
    ]
    mirrored = {"(": ")", ")": "("}
    levels = embedding_levels(line)
    shown = [mirrored.get(text[i], text[i]) if levels[i] % 2 else text[i] for i in order]
    assert "".join(shown) == seen


def test_digits_in_a_hebrew_line_are_set_rightwards_and_letters_keep_their_numbers():
    shapes = letters("אב 12", TextSettings(Path(font_file(""))))
    assert [shape.name for shape in shapes] == ["'א'", "'ב'", "'1'", "'2'"]
    alef, bet, one, two = (shape.region.centroid.x for shape in shapes)
    assert one < two < bet < alef


def test_scripts_are_set_apart():
    assert [(run.start, run.end) for run in visual_runs("aб, в")] == [(0, 1), (1, 5)]


@pytest.mark.parametrize("control", ["\u202e", "\u2067", "\u202c"])
def test_controls_of_direction_are_refused(control):
    with pytest.raises(UsageError, match=rf"U\+{ord(control):04X}, a control of direction"):
        visual_runs(f"a{control}b")
