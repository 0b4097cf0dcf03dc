"""Files of notes: merged by one rule, read whole or told of in one message, and kept with a version."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.plugins.review.review_notes import (
    NotesDocument,
    NotesFolder,
    ReviewNote,
    as_text,
    merged,
    read_notes,
)
from tests.conftest import commanded
from tests.full_disk import disk_of
from tests.needed_plugins import needs_plugins
from tests.plugins.review.note_cases import IDS, NOTES, TIMES, document, note, revision, stroke

Given = list[dict[str, Any]]


def parsed(notes: Given) -> list[ReviewNote]:
    return merged(NotesDocument.model_validate_json(json.dumps(document(*notes))).notes)


def said(notes: list[ReviewNote]) -> set[tuple[str, str]]:
    """Everything that any revision of any note says."""
    return {(each.id, str(revision.order)) for each in notes for revision in each.revisions}


@pytest.mark.slow
@settings(max_examples=80, deadline=None)
@given(NOTES, NOTES, NOTES)
def test_merging_does_not_depend_on_order_and_loses_nothing(one: Given, two: Given, three: Given) -> None:
    a, b, c = map(parsed, (one, two, three))
    both = merged(a, b)
    assert both == merged(b, a)
    assert merged(both, c) == merged(a, merged(b, c))
    assert merged(both, b) == merged(both) == both
    assert said(both) == said(a) | said(b)
    for each in both:
        assert each.order == max(revision.order for revision in each.revisions), "the latest one is shown"


def test_the_later_of_two_edits_wins_and_the_earlier_one_is_kept() -> None:
    early = parsed([note(text="brighter", modified=TIMES[1])])
    late = parsed([note(text="darker", modified=TIMES[2])])
    (both,) = merged(late, early)
    assert (both.text, [each.text for each in both.history]) == ("darker", ["brighter"])


def test_a_deleted_note_stays_deleted_whatever_an_older_file_says() -> None:
    there = parsed([note()])
    gone = parsed([note(deleted=True, modified=TIMES[3], history=[revision()])])
    assert [each.deleted for each in merged(gone, there)] == [True]


def test_a_file_is_read_as_it_was_written(tmp_path: Path) -> None:
    notes = parsed([note(), note(id=IDS[1], text="Größe 𝛼\n\ttwo", history=[revision(text="before")])])
    (tmp_path / "n.json").write_text(as_text(notes), encoding="utf-8")
    assert read_notes(tmp_path / "n.json") == notes


WRONG: dict[str, tuple[str, str]] = {
    "cut short": (json.dumps(document(note()))[:-9], "not JSON, or cut short"),
    "empty": ("", "not JSON, or cut short"),
    "not text": ("\udcff", "not JSON"),
    "a list": ("[]", "not a file of notes"),
    "another schema": (json.dumps({"OTIO_SCHEMA": "Timeline.1"}), "not a file of notes"),
    "a later version": (json.dumps(document(version=2)), "version 2 of the format is newer than 1"),
    "a wrong status": (json.dumps(document(note(status="done"))), 'notes.0.status is "done"'),
    "a wrong type": (json.dumps(document(note(first="3"))), 'notes.0.first is "3"'),
    "a missing field": (json.dumps(document({"id": IDS[0]})), "notes.0.shot is missing"),
    "an unknown field": (json.dumps(document(note(mood="good"))), "notes.0.mood is unknown in version 1"),
    "frames backwards": (json.dumps(document(note(first=9))), "9 is after the last frame, 5"),
    "half a point": (
        json.dumps(document(note(drawings=[stroke(points=[1, 2, 3])]))),
        "3 numbers do not make a drawing of the kind pen",
    ),
    "a shot elsewhere": (json.dumps(document(note(shot="../../etc"))), "notes.0.shot is"),
    "an escape sequence": (json.dumps(document(note(text="\x1b[2J"))), "notes.0.text is"),
    "half a letter": (json.dumps(document(note(text="\ud800"))), "not JSON"),
    "deep": ("[" * 100_000, "not JSON"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_bad_file_is_told_of_in_one_line_and_nothing_is_taken_in(name: str, tmp_path: Path) -> None:
    content, fact = WRONG[name]
    bad, good = tmp_path / "bad.json", tmp_path / "good.json"
    bad.write_bytes(content.encode("utf-8", "surrogateescape"))
    good.write_text(json.dumps(document(note())))
    with pytest.raises(UsageError) as refused:
        NotesFolder(tmp_path).add([good, bad])
    assert str(refused.value).startswith(f"{bad}: ") and fact in str(refused.value)
    assert "\n" not in str(refused.value) and "\x1b" not in str(refused.value)
    assert not (tmp_path / "notes").exists()


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[int, str]]:
    """Runs commands in a folder with the shot T010_tiny."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "shots").mkdir()
    (tmp_path / "shots" / "T010_tiny.yaml").write_text("subject: {solid: box}\n")
    return lambda *words: commanded(tmp_path, *words)


def test_files_of_several_reviewers_are_listed_together(
    command: Callable[..., tuple[int, str]], tmp_path: Path
) -> None:
    drawings = [stroke(), stroke(kind="text", points=[1, 2], text="too dark")]
    ann = note(drawings=drawings), note(id=IDS[1], shot="Z900_other")
    (tmp_path / "ann.json").write_text(json.dumps(document(*ann)))
    ben = note(id=IDS[2], author="Ben", status="approved", text="[bold]good[/bold]", drawings=[], first=1)
    (tmp_path / "ben.json").write_text(json.dumps(document(ben)))
    words = ("notes", "T010_tiny", "--add", "ben.json", "--add", "ann.json")
    assert command("--dry-run", *words)[0] == 0 and not (tmp_path / "notes").exists()
    code, told = command(*words)
    assert code == 0 and "[bold]good[/bold]" in told
    assert "softer (2 strokes: “too dark”)" in " ".join(told.split())
    assert sorted(path.name for path in (tmp_path / "notes").iterdir()) == [
        "T010_tiny.json",
        "Z900_other.json",
    ]
    before = (tmp_path / "notes" / "T010_tiny.json").stat().st_mtime_ns
    facts = json.loads(command("--json", *words)[1])
    assert facts["added"] == {"T010_tiny": 0, "Z900_other": 0}
    assert (tmp_path / "notes" / "T010_tiny.json").stat().st_mtime_ns == before
    assert [each["author"] for each in facts["notes"]] == ["Ann", "Ben"]
    assert "Ann" not in command("notes", "T010_tiny", "--status", "approved")[1]


def test_commands_of_notes_say_what_is_wrong(command: Callable[..., tuple[int, str]], tmp_path: Path) -> None:
    assert command("notes", "T010_tiny")[1].startswith("T010_tiny has no notes; flowsculpt review T010_tiny")
    assert command("notes", "T010_tiny", "--add", "gone.json")[0] == 3
    assert command("notes", "T010_tiny", "--status", "done")[0] == 2
    assert command("notes", "T999_none")[0] == 3


def test_a_full_disk_is_told_once_and_leaves_the_notes_that_were_there(
    command: Callable[..., tuple[int, str]], tmp_path: Path
) -> None:
    kept = tmp_path / "notes" / "T010_tiny.json"
    for name, content in (("ann", note()), ("ben", note(id=IDS[1], text="x" * 20_000))):
        (tmp_path / f"{name}.json").write_text(json.dumps(document(content)))
    assert command("notes", "T010_tiny", "--add", "ann.json")[0] == 0
    before = kept.read_bytes()
    with disk_of(8192):
        code, told = command("notes", "T010_tiny", "--add", "ben.json")
    assert code == 4 and str(kept) in told and len(told.strip().splitlines()) == 1
    assert kept.read_bytes() == before and list(kept.parent.iterdir()) == [kept]


@needs_plugins("maintenance")
def test_clean_leaves_notes_alone(command: Callable[..., tuple[int, str]], tmp_path: Path) -> None:
    (tmp_path / "ann.json").write_text(json.dumps(document(note())))
    assert command("notes", "T010_tiny", "--add", "ann.json")[0] == 0
    code, told = command("clean")
    assert code == 0, told
    assert (tmp_path / "notes" / "T010_tiny.json").is_file()
