"""Edits of a shot file change what they name, and no comment, order or blank line beside it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.plugins.preview.text_edits import ValueEdit, edited
from flowsculpt.pipeline.shot.yaml.yaml_source import YamlSource, to_yaml

FILE = Path("A010_a.yaml")

TEXT = """\
# A shot
title: 'A box'   # in quotes

flows:   # two
  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 24: 60, 2s: 90}}}  # wrung
  - vortex:
      # where it turns
      centre: [0, 1, 0]
      strength:
        keys:
          1: 0    # calm
          12.5: 4 # wild
  - lorenz:
look: &look clay
camera: {
  azimuth: -30, # from the left
  elevation: 14 # a little above
}
other: *look
"""


def seconds(key: Any) -> float | None:
    return float(key[:-1]) * 24 if isinstance(key, str) else float(key)


def after(*edits: ValueEdit, text: str = TEXT) -> str:
    return edited(FILE, text, edits, seconds)


def changed_lines(text: str) -> dict[str, str]:
    """Lines that an edit changed, before and after; the number of lines stays."""
    pairs = zip(TEXT.splitlines(), text.splitlines(), strict=True)
    return {old.strip(): new.strip() for old, new in pairs if old != new}


CASES = {
    "a number": (
        ValueEdit("set", ("camera", "azimuth"), 12.5),
        {"azimuth: -30, # from the left": "azimuth: 12.5, # from the left"},
    ),
    "a number of a list": (
        ValueEdit("set", ("flows", 1, "vortex", "centre"), [0, 1.25, 0]),
        {"centre: [0, 1, 0]": "centre: [0, 1.25, 0]"},
    ),
    "a text in its quotes": (
        ValueEdit("set", ("title",), "A ball"),
        {"title: 'A box'   # in quotes": "title: 'A ball'   # in quotes"},
    ),
    "a key in a block": (
        ValueEdit("set", ("flows", 1, "vortex", "strength", "keys", 12.5), 5),
        {"12.5: 4 # wild": "12.5: 5 # wild"},
    ),
    "a key's time": (
        ValueEdit("rename", ("flows", 1, "vortex", "strength", "keys", 12.5), 14),
        {"12.5: 4 # wild": "14: 4 # wild"},
    ),
    "a value of nothing": (
        ValueEdit("set", ("flows", 2, "lorenz", "scale"), 2),
        {"- lorenz:": "- lorenz: {scale: 2}"},
    ),
    "a new name in brackets": (
        ValueEdit("set", ("camera", "margin"), 0.2),
        {"elevation: 14 # a little above": "elevation: 14, margin: 0.2 # a little above"},
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_only_the_edited_value_changes(case: str) -> None:
    edit, lines = CASES[case]
    assert changed_lines(after(edit)) == lines


def test_a_new_key_is_sorted_in_between_the_others_also_among_seconds() -> None:
    keys = ("flows", 0, "twist", "amount", "keys")
    assert "keys: {1: 0, 24: 60, 30: 7, 2s: 90}" in after(ValueEdit("set", (*keys, 30), 7))
    assert "keys: {0: 7, 1: 0" in after(ValueEdit("set", (*keys, 0), 7))
    block = after(ValueEdit("set", ("flows", 1, "vortex", "strength", "keys", 6), 2))
    assert "          1: 0    # calm\n          6: 2\n          12.5: 4 # wild\n" in block


def test_a_key_that_passes_another_takes_its_value_along() -> None:
    text = after(ValueEdit("rename", ("flows", 0, "twist", "amount", "keys", 1), 30))
    assert "keys: {24: 60, 30: 0, 2s: 90}" in text
    with pytest.raises(ShotError, match="is there already"):
        after(ValueEdit("rename", ("flows", 0, "twist", "amount", "keys", 1), 24))


def test_a_removed_key_leaves_its_comment() -> None:
    text = after(ValueEdit("remove", ("flows", 1, "vortex", "strength", "keys", 1)))
    assert "        keys:\n          # calm\n          12.5: 4 # wild\n" in text
    assert "keys: {1: 0, 24: 60}" in after(ValueEdit("remove", ("flows", 0, "twist", "amount", "keys", "2s")))
    assert "keys: {24: 60, 2s: 90}" in after(ValueEdit("remove", ("flows", 0, "twist", "amount", "keys", 1)))


def test_a_constant_becomes_keys_and_keys_a_constant() -> None:
    text = after(ValueEdit("set", ("camera", "elevation"), {"keys": {1: 14}}))
    assert "elevation: {keys: {1: 14}} # a little above" in text
    again = edited(FILE, text, [ValueEdit("set", ("camera", "elevation"), 14)], seconds)
    assert again == TEXT


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (ValueEdit("set", ("look",), "glaze"), "several places (an alias)"),
        (ValueEdit("set", ("flows", 7, "twist", "amount"), 1), "flows has no 7"),
        (ValueEdit("set", ("title", "x"), 1), "title has no x"),
        (ValueEdit("remove", ("flows", 0)), "flows has no 0"),
        (ValueEdit("remove", ("camera", "roll")), "camera has no roll"),
        (ValueEdit("set", ("flows", 1, "vortex", "strength"), 3), "written over several lines"),
    ],
)
def test_what_cannot_be_edited_in_place_is_refused_with_its_line(edit: ValueEdit, words: str) -> None:
    with pytest.raises(ShotError, match=rf"^{FILE}:\d+:\d+: .*{re.escape(words)}"):
        after(edit)


TEXTS = ("clay", "3s", "true", "1.5", "it's: {odd}", "#ffd0a0", "", "ünï\n")
PLAIN = (0, -1.5, 1e-7, 4.0, 1e300, True, None, [1, "a, b"], {"keys": {1: 0, 12.5: [1, 2]}})


@pytest.mark.parametrize("value", [*TEXTS, *PLAIN])
def test_values_written_in_one_line_read_back_as_the_same(value: Any) -> None:
    assert YamlSource.read(FILE, f"a: {to_yaml(value)}\n").data == {"a": value}
