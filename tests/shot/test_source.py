"""YAML with places."""

from __future__ import annotations

from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import MissingInputError, ShotError
from flowsculpt.pipeline.shot.yaml.named_files import is_edit
from flowsculpt.pipeline.shot.yaml.yaml_source import YamlSource


def source(folder: Path, text: str) -> YamlSource:
    file = folder / "shot.yaml"
    file.write_text(text, encoding="utf-8")
    return YamlSource.read(file)


def test_every_key_and_item_knows_its_line_and_column(tmp_path: Path) -> None:
    read = source(tmp_path, "a: 1\nb:\n  - {c: 2, d: 3}\n  - e\n")
    assert read.data == {"a": 1, "b": [{"c": 2, "d": 3}, "e"]}
    assert read.places[("b",)][1:3] == (2, 1)
    assert read.places[("b", 0, "d")][1:3] == (3, 12)
    assert read.places[("b", 1)][1:3] == (4, 5)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-be", "utf-32"])
@pytest.mark.parametrize("line_end", ["\n", "\r\n", "\r"])
def test_files_of_other_systems_have_the_same_places(tmp_path: Path, encoding: str, line_end: str) -> None:
    file = tmp_path / "film.yaml"
    file.write_bytes("shots: [a]\ntitle: Zoë\n".replace("\n", line_end).encode(encoding))
    read = YamlSource.read(file)
    assert read.data == {"shots": ["a"], "title": "Zoë"}
    assert read.places[("title",)][1:3] == (2, 1)
    assert is_edit(file)


def test_a_file_cut_within_a_letter_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_bytes("title: a\n".encode("utf-16")[:-1])
    with pytest.raises(ShotError, match=r"a\.yaml:1:1: it begins as UTF-16 text, and byte 18 is not: trunc"):
        YamlSource.read(tmp_path / "a.yaml")


def test_values_are_those_of_yaml_1_2(tmp_path: Path) -> None:
    read = source(tmp_path, "[on, off, 12:30, 010, 0x1F, 1e3, -2.5, true, null, '7', 1-96]")
    assert read.data == ["on", "off", "12:30", 10, 31, 1000.0, -2.5, True, None, "7", "1-96"]


def test_an_alias_repeats_a_value(tmp_path: Path) -> None:
    assert source(tmp_path, "a: &x [1, 2]\nb: *x\n").data == {"a": [1, 2], "b": [1, 2]}


def test_all_duplicates_are_found(tmp_path: Path) -> None:
    read = source(tmp_path, "a: 1\na: 2\nb: {c: 1,\n  c: 2}\n")
    places = [read.place(where) for where, _ in read.problems]
    assert [place.removeprefix(str(tmp_path)) for place in places] == ["/shot.yaml:2:1", "/shot.yaml:4:3"]


def test_an_alias_within_itself_is_told_not_followed(tmp_path: Path) -> None:
    assert "this alias contains itself" in source(tmp_path, "a: &x [1, *x]\n").problems[0][1]


def test_a_missing_file_is_a_missing_input(tmp_path: Path) -> None:
    with pytest.raises(MissingInputError, match=r"nowhere\.yaml: file not found"):
        YamlSource.read(tmp_path / "nowhere.yaml")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a: [1, 2\nb: 3\n", r"shot\.yaml:1:4: this \[ is never closed; add \]"),
        ("", r"shot\.yaml:1:1: the file is empty"),
        ("a:\n\t- 1\n", r"shot\.yaml:2:1: a tab indents this line"),
        ("a: 1\nb: x\x07y\n", r"shot\.yaml:2:5: the character U\+0007 is not printable"),
        ("a: " + "[" * 5000, r"shot\.yaml:1:1: .* nested too deep"),
        ("{a: " * 2000 + "1" + "}" * 2000, r"shot\.yaml:1:1: .* nested too deep"),
    ],
)
def test_what_is_no_yaml_is_told_with_its_place(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(ShotError, match=told):
        source(tmp_path, text)


def test_bytes_that_are_no_text_are_told(tmp_path: Path) -> None:
    (tmp_path / "shot.yaml").write_bytes(b"title: \xff\xfe")
    with pytest.raises(ShotError, match="byte 7 is not UTF-8"):
        YamlSource.read(tmp_path / "shot.yaml")
