"""Edits with dissolves, cards and sound: what they are, and every mistake at its place."""

from __future__ import annotations

import wave
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from flowsculpt.pipeline.errors import MissingInputError, ShotError
from flowsculpt.pipeline.production.request.edit import Edit
from flowsculpt.pipeline.shot import read_film
from flowsculpt.pipeline.shot.shot import Film
from flowsculpt.render.base.serialise import from_plain, to_plain

SHOT = "title: {0}\nframes: 1-12\nsubject: {{solid: box}}\nresample: off\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("A", "B"):
        (tmp_path / f"{name}.yaml").write_text(SHOT.format(name))
    with wave.open(str(tmp_path / "music.wav"), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(8000)
        file.writeframes(bytes(1600))
    return tmp_path


def film(folder: Path, entries: str, more: str = "title_seconds: 0\n") -> Film:
    (folder / "film.yaml").write_text(f"title: F\nshots:\n{entries}\ncredits_seconds: 0\n{more}")
    return read_film(folder / "film.yaml")


def test_dissolves_overlap_and_shorten_the_film(folder: Path) -> None:
    edit = Edit.of(
        film(folder, "  - A\n  - {shot: B, frames: 3-10, dissolve: 4}\n  - {shot: A, dissolve: 2}"), "f"
    )
    assert [(piece.clip, piece.frames, piece.dissolve) for piece in edit.items] == [
        (0, 12, 0),
        (1, 8, 4),
        (2, 12, 2),
    ]
    assert edit.length == 12 + 8 + 12 - 4 - 2
    assert from_plain(Edit, to_plain(edit)) == edit


def test_cards_stand_between_shots(folder: Path) -> None:
    card = '{card: "Part two", subtitle: later, seconds: 0.5, dissolve: 6}'
    entries = f"  - A\n  - {card}\n  - {{shot: B, dissolve: 6}}"
    read = film(folder, entries, "title_seconds: 1\n")
    edit = Edit.of(read, "f")
    assert [piece.title for piece in edit.items] == ["F", "", "Part two", ""]
    assert edit.length == 24 + 12 + 12 + 12 - 12
    assert read.seconds == pytest.approx(edit.length / 24)


def test_the_first_shot_may_dissolve_from_the_title(folder: Path) -> None:
    edit = Edit.of(film(folder, "  - {shot: A, dissolve: 6}", "title_seconds: 0.5\n"), "f")
    assert edit.length == 12 + 12 - 6


@pytest.mark.parametrize(
    ("entries", "more", "says"),
    [
        ("  - {shot: A, dissolve: 6}", "title_seconds: 0\n", r"film\.yaml:3:15: there is nothing before"),
        (
            "  - {shot: A, dissolve: 9}",
            "title_seconds: 0.25\n",
            r"film\.yaml:3:15: .*as many of the title.* 6\.",
        ),
        (
            "  - A\n  - {shot: B, dissolve: 13}",
            "",
            r"film\.yaml:4:15: A shows 12 frames, and 13 are to dissolve",
        ),
        (
            "  - A\n  - {shot: B, frames: 1-8, dissolve: 5}\n  - {shot: A, dissolve: 5}",
            "",
            r"film\.yaml:4:28: B shows 8 frames, and 5 in and 5 out are to dissolve",
        ),
        (
            "  - A\n  - {shot: B, dissolv: 3}",
            "",
            r"film\.yaml:4:15: shots.1.dissolv: unknown name.*Did you mean 'dissolve'",
        ),
        (
            "  - A\n  - {shot: B, dissolve: -3}",
            "",
            r"film\.yaml:4:15: .*dissolve: -3 is out of range; it must be at least 0",
        ),
        ("  - A\n  - {shot: B, dissolve: 1.5}", "", r"film\.yaml:4:15: .* 1\.5 is not a count of frames"),
        (
            "  - A\n  - {card: Two, second: 3}",
            "",
            r"film\.yaml:4:17: shots.1.second: unknown name.*'seconds'",
        ),
        ("  - A\n  - {card: 2}", "", r"film\.yaml:4:6: .*card: YAML reads 2 as a number"),
        (
            "  - A\n  - {card: Two, seconds: 0.01}",
            "",
            r"film\.yaml:4:17: the card is shorter than a frame",
        ),
        (
            "  - A",
            "sound: {file: music.wav, gian: 3}\n",
            r"film\.yaml:4:26: sound.gian: unknown name.*Did you mean 'gain'",
        ),
        ("  - A", "sound: {file: A.yaml}\n", r"film\.yaml:4:9: .*A\.yaml: cannot be read as sound"),
        ("  - A", "sound: music.wav\n", r"film\.yaml:4:1: sound: 'music\.wav' is not a mapping"),
    ],
)
def test_what_cannot_be_is_told_with_its_place(folder: Path, entries: str, more: str, says: str) -> None:
    (folder / "film.yaml").write_text(f"title: F\nshots:\n{entries}\n{more}")
    with pytest.raises(ShotError, match=says):
        read_film(folder / "film.yaml")


def test_sound_that_is_not_there_is_a_missing_input(folder: Path) -> None:
    with pytest.raises(
        MissingInputError, match=r"film\.yaml:5:9: sound not found: .*Did you mean 'music\.wav'"
    ):
        film(folder, "  - A", "sound: {file: musik.wav}\n")


REQUEST: Any = SimpleNamespace(requested=(), manifest=SimpleNamespace(shown_as="a"), quality_name="draft")
"""The part of a request, one of no frames, that a film's key reads."""


def test_the_sound_itself_is_in_the_key_of_a_film_and_its_place_is_not(folder: Path) -> None:
    def key(more: str) -> str:
        return Edit.of(film(folder, "  - A", more), "f").key([REQUEST], [{}])

    silent, audio = key(""), key("sound: {file: music.wav}\n")
    assert silent != audio
    assert key("sound: {file: music.wav, gain: -3}\n") != audio
    (folder / "same.wav").write_bytes((folder / "music.wav").read_bytes())
    assert key("sound: {file: same.wav}\n") == audio
    content = bytearray((folder / "music.wav").read_bytes())
    content[-1] = 9
    (folder / "music.wav").write_bytes(bytes(content))
    assert key("sound: {file: music.wav}\n") != audio


def test_dissolves_and_cards_are_in_the_key_of_a_film(folder: Path) -> None:
    edits = [
        "  - A\n  - B",
        "  - A\n  - {shot: B, dissolve: 1}",
        "  - A\n  - {card: x}\n  - B",
        "  - A\n  - {card: y}\n  - B",
        "  - A\n  - B\n  - {card: x}",
    ]
    keys = {Edit.of(film(folder, entries), "f").key([REQUEST], [{}]) for entries in edits}
    assert len(keys) == len(edits)
