"""Values whose text YAML reads as something else: the message says what the user wrote."""

from __future__ import annotations

from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import FlowsculptError
from flowsculpt.pipeline.shot import read_shot

SHOT = "title: t\nframes: 1-2\nsubject: {solid: box}\nresample: {max_edge_length: 0.3}\nflows: []\n"


def refusal(tmp_path: Path, text: str) -> str:
    (tmp_path / "A.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(FlowsculptError) as refused:
        read_shot(tmp_path / "A.yaml")
    return str(refused.value).replace(str(tmp_path), "")


@pytest.mark.parametrize("written", ["010", "0x10", "1e5", "1_000", ".5", "~", "null", "True", "+7"])
def test_text_that_yaml_reads_as_something_else_is_shown_as_written(tmp_path: Path, written: str) -> None:
    told = refusal(tmp_path, SHOT.replace("title: t", f"title: {written}"))
    assert told.startswith(f"/A.yaml:1:1: title: YAML reads {written} as ") and f"'{written}', in qu" in told


def test_a_setting_is_shown_as_written(tmp_path: Path) -> None:
    (tmp_path / "A.yaml").write_text(SHOT)
    with pytest.raises(FlowsculptError, match="--set title=007: title: YAML reads 007 as a number"):
        read_shot(tmp_path / "A.yaml", settings=("title=007",))


@pytest.mark.parametrize(
    ("look", "place"),
    [
        ("look: {material: clay, colour: #ff0000}\n", "6:32"),
        ("look: {colour: #ff0000, material: clay}\nstage: void\n", "6:16"),
        ("look: {material: clay,\n  colour: #ff0000\n}\n", "7:3"),
        ("look:\n  material: clay\n  colour: #ff0000\n", "8:3"),
        ("look: {pigment: {layers: {colours: [#ff0000, #00ff00]}}}\n", "6:37"),
        (
            "look:\n  material: clay\n  pigment:\n    layers: {colours:\n      [#ff0000, '#00ff00']}\n",
            "10:8",
        ),
    ],
)
def test_a_colour_that_is_a_comment_is_to_be_put_in_quotes(tmp_path: Path, look: str, place: str) -> None:
    told = refusal(tmp_path, SHOT + look)
    assert told.startswith(f"/A.yaml:{place}: ") and told.count("\n") == 0
    assert "# begins a comment in YAML" in told and "the colour in quotes: '#ff0000'" in told


@pytest.mark.parametrize(
    ("look", "place", "character"),
    [
        ("look:\u00a0clay\n", "6:6", "no-break space (U+00A0)"),
        ("look:\n\u00a0\u00a0material: clay\n", "7:1", "no-break space (U+00A0)"),
        ("look: {material:\u3000clay}\n", "6:8", "ideographic space (U+3000)"),
        ("\u200blook: clay\n", "6:1", "zero width space (U+200B)"),
        ("stage: void\n\ufefflook: clay\n", "7:1", "zero width no-break space (U+FEFF)"),
    ],
)
def test_a_space_that_yaml_takes_for_a_letter_is_named(
    tmp_path: Path, look: str, place: str, character: str
) -> None:
    told = refusal(tmp_path, SHOT + look)
    assert told.startswith(f"/A.yaml:{place}: ") and character in told and told.count("\n") == 0


def test_no_break_spaces_within_text_stay(tmp_path: Path) -> None:
    (tmp_path / "A.yaml").write_text(SHOT.replace("title: t", "title: 12\u00a0km"), encoding="utf-8")
    assert read_shot(tmp_path / "A.yaml").title == "12\u00a0km"


def test_a_file_whose_accents_are_other_characters_is_not_called_missing_alone(tmp_path: Path) -> None:
    (tmp_path / "e\u0301.obj").touch()
    told = refusal(tmp_path, SHOT.replace("{solid: box}", "{model: \u00e9.obj}"))
    assert "is not there" in told and "other Unicode characters" in told
