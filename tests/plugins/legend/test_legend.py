"""Legends: round numbers and dates, where parts stand, and what decides the pictures that have them."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.api import ShotError
from flowsculpt.api.pictures import Camera, Font, RenderedFrame
from flowsculpt.pipeline.plugins.legend.drawn_parts import FONT, LEAST, LegendType
from flowsculpt.pipeline.plugins.legend.legend_parts import draw_clock, draw_colours, draw_scale
from flowsculpt.pipeline.plugins.legend.numbers_in_words import (
    IN_FONT,
    date_text,
    marks,
    round_length,
    written,
)
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.request.shot_source import ShotSource
from flowsculpt.pipeline.shot import read_shot
from tests.needed_plugins import needs_plugins

SHOT = """
title: T
frames: 1-4
subject:
  path_lines: {line: [[0.2, 0, 0], [1, 0, 0]]}
  velocity: [{rotation: {axis: y, speed: 90}}]
  count: 3
  values: speed
look: {material: clay, measure: {values: {range: [0.4, 1.6]}}}
"""
TASKS = (draw_colours, draw_clock, draw_scale)


def frame_of(
    legend: str, corner: tuple[int, int] = (0, 0), size: tuple[int, int] = (320, 180)
) -> RenderedFrame:
    shot = read_shot(Path("a.yaml"), f"{SHOT}legend: {legend}\n")
    light = np.full((size[1], size[0], 3), 0.4, np.float32)
    facts = {"whole": (320, 180), "corner": corner, "camera": Camera((0, 0, 5), (0, 0, 0)), "shot": shot}
    return RenderedFrame({"beauty": light, "alpha": np.zeros(light.shape[:2], np.float32)}, facts)


def drawn(legend: str, *tasks: Any, **more: Any) -> RenderedFrame:
    frame = frame_of(legend, **more)
    for task in tasks:
        name = f"legend.{task.__name__.removeprefix('draw_')}"
        frame = task(frame, frame.facts["shot"].entries[name], 2)
    return frame


def changed(frame: RenderedFrame) -> tuple[slice, slice]:
    """Return the rows and columns that have anything drawn on them."""
    there = np.abs(frame["beauty"] - 0.4).max(axis=2) > 1e-6
    rows, columns = np.flatnonzero(there.any(axis=1)), np.flatnonzero(there.any(axis=0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


@settings(max_examples=200, deadline=None)
@given(st.floats(-1e4, 1e4), st.floats(1e-3, 1e5), st.booleans())
def test_a_scale_has_a_few_round_numbers_that_lie_where_they_belong(
    low: float, size: float, is_logarithmic: bool
) -> None:
    low = abs(low) + 1e-2 if is_logarithmic else low
    high = low * (1.5 + size) if is_logarithmic else low + size
    found = marks(low, high, is_logarithmic)
    assert 2 <= len(found) <= 9
    texts = [written(value, found) for value, _ in found]
    assert len(set(texts)) == len(texts)
    for value, place in found:
        at = math.log(value / low) / math.log(high / low) if is_logarithmic else (value - low) / (high - low)
        assert -1e-6 <= place <= 1.0 + 1e-6 and place == pytest.approx(at, abs=1e-6)


def test_numbers_are_written_as_readers_know_them() -> None:
    assert [written(v, marks(-1.0, 1.0, is_logarithmic=False)) for v in (-0.5, 0.0, 1.0)] == [
        "–0.5",
        "0",
        "1.0",
    ]
    assert written(20.0, marks(12.9, 23.3, is_logarithmic=False)) == "20"


@settings(max_examples=100, deadline=None)
@given(st.floats(1e-6, 1e9), st.one_of(st.none(), st.floats(1e-3, 1e7)))
def test_a_scale_is_a_round_length_that_fits(most: float, metres: float | None) -> None:
    length, text = round_length(most, metres, "units")
    assert 0.39 * most < length <= most * (1 + 1e-9)
    assert text.split()[-1] in ("unit", "units", "km", "m", "cm", "mm")


@pytest.mark.parametrize(
    ("most", "metres", "text"),
    [(6.0, 1e6, "5 000 km"), (1.2, None, "1 unit"), (3.0, None, "2 units"), (1.2, 10.0, "10 m")],
)
def test_a_length_is_written_in_letters_of_the_font(most: float, metres: float | None, text: str) -> None:
    assert round_length(most, metres, "units")[1] == text


@pytest.mark.parametrize(
    ("date", "later", "text"),
    [
        ("2003-08-02 06:00:00", "2003-08-02 06:30:00", "2 Aug 2003  06:00"),
        ("2003-08-02 06:00:00", "2003-08-02 08:00:00", "2 Aug 2003"),
        ("2003-08-16 00:00:00", "2003-09-16 00:00:00", "Aug 2003"),
        ("2003-02-30 12:00:00", "2003-03-01 12:00:00", "30 Feb 2003"),
        ("--08-16 00:00:00", "--08-19 00:00:00", "August"),
        ("-0044-03-15 00:00:00", "-0044-03-16 00:00:00", "15 Mar -44"),
    ],
)
def test_a_clock_shows_no_more_than_can_be_read(date: str, later: str, text: str) -> None:
    assert date_text(date, later) == text


@needs_plugins("streams")
@pytest.mark.parametrize("place", ["lower left", "lower right", "upper left", "upper right"])
def test_parts_of_one_corner_stand_above_one_another_within_the_margin(place: str) -> None:
    legend = ", ".join(f"{name}: {{place: {place}}}" for name in ("colours", "clock", "scale"))
    rows = []
    for task in TASKS:
        down, across = changed(drawn(f"{{{legend}}}", task))
        assert (across.start < 160) == place.endswith("left")
        assert across.start > 0 and across.stop < 320 and down.start > 0 and down.stop < 180
        rows.append(down)
    assert (rows[0].start < 90) == place.startswith("upper")
    ordered = rows if place.startswith("upper") else rows[::-1]
    assert all(one.start < other.start for one, other in pairwise(ordered))


@needs_plugins("streams")
def test_a_part_of_a_picture_has_the_part_of_its_legend() -> None:
    legend = "{colours: {}, clock: {}, scale: {}}"
    whole, part = drawn(legend, *TASKS), drawn(legend, *TASKS, corner=(10, 120), size=(100, 50))
    for name in ("beauty", "alpha"):
        assert np.array_equal(whole[name][120:170, 10:110], part[name])
    assert changed(part)


def test_every_letter_of_numbers_and_of_known_units_is_in_the_font() -> None:
    units = pytest.importorskip("flowsculpt.pipeline.plugins.fields.cf_numbers").SHOWN.values()
    numbers = [written(value, [(value, 0.0)]) for value in (-0.5, -1.5e-7, 2.5e9)]
    texts = [text.translate(IN_FONT) for text in (*units, *numbers, "m s⁻¹", "−2")]
    lacking = {each for text in texts for each in text if each != " " and not Font(FONT, 20).line(each).any()}
    assert not lacking and Font(FONT, 20).line("‰").sum() == 0.0, "IN_FONT is for what the font lacks"


def test_the_size_of_a_legend_counts_in_small_pictures_too() -> None:
    sizes = [LegendType.of(factor, 480, 270).size for factor in (1.0, 1.5, 2.5)]
    assert sizes == [LEAST, 1.5 * LEAST, 2.5 * LEAST]
    assert LegendType.of(2.0, 1920, 1080).size == 2 * LegendType.of(1.0, 1920, 1080).size


@needs_plugins("streams")
def test_ink_reads_on_the_stage_unless_a_shot_names_it() -> None:
    dark, light = (drawn(f"{{clock: {{ink: {ink}}}}}", draw_clock)["beauty"] for ink in ("dark", "light"))
    assert dark.min() < 0.1 and light.max() > 0.7
    assert np.array_equal(drawn("{clock: {}}", draw_clock)["beauty"], dark)  # the stage is light


@needs_plugins("streams")
def test_a_legend_makes_finished_pictures_again_and_nothing_else() -> None:
    def last(text: str) -> list[Any]:
        request = RenderRequest(ShotSource(text, Path("T010_tiny.yaml")), "draft", "none", (1,))
        assert not request.manifest.stages
        return request.keys.last_stages

    assert not last(SHOT)
    one, other = (last(f"{SHOT}legend: {{clock: {{size: {size}}}}}\n") for size in (1.0, 1.5))
    assert one and one != other


@needs_plugins("streams")
def test_a_legend_of_colours_without_a_measure_is_an_error_of_the_shot_file() -> None:
    plain = SHOT.replace("{material: clay, measure: {values: {range: [0.4, 1.6]}}}", "clay")
    read_shot(Path("a.yaml"), f"{plain}legend: {{clock: {{}}}}\n")
    with pytest.raises(
        ShotError, match=r"a\.yaml:10:10: colours needs a look with a measure.* leave colours"
    ):
        read_shot(Path("a.yaml"), f"{plain}legend: {{colours: {{}}}}\n")


@needs_plugins("streams")
def test_a_legend_of_colours_needs_a_look_with_a_measure() -> None:
    frame = frame_of("{colours: {}}")
    shot = frame.facts["shot"]
    plain = replace(shot, picture=replace(shot.picture, look=shot.picture.look.with_values(measure=None)))
    frame = replace(frame, facts={**frame.facts, "shot": plain})
    with pytest.raises(Exception, match=r"needs a look with a measure\. Add one, or leave colours out"):
        draw_colours(frame, shot.entries["legend.colours"], 2)
    with pytest.raises(ShotError, match="place"):
        frame_of("{colours: {place: middle}}")
