"""Files of notes on the page: downloaded, merged as Python does, and refused where Python refuses them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import opentimelineio
from hypothesis import given, settings
from pydantic import ValidationError

from flowsculpt.pipeline.plugins.review.review_notes import NotesDocument, as_data, merged, read_notes
from tests.plugins.review.looker import Opened, downloaded
from tests.plugins.review.note_cases import ATTACK, IDS, NOTES, TIMES, document, note, revision, stroke
from tests.plugins.review.test_review_notes import WRONG


def test_downloads_are_read_by_python_and_by_opentimelineio(
    opened: Opened, page: Callable[..., Path]
) -> None:
    gone = note(id=IDS[2], deleted=True)
    look = opened(
        page(note(text="Größe 𝛼\nline two"), note(id=IDS[1], status="change", first=4, last=4), gone)
    )
    assert read_notes(downloaded(look, "Shift+J")) == merged(
        NotesDocument.model_validate_json(
            json.dumps(document(*look.ask("[...review.notes.notes.values()]")))
        ).notes
    )
    text = downloaded(look, "Shift+T").read_text()
    assert "3–5  open  Ann  2026-11-21 09:00 UTC\n    Größe 𝛼\n    line two\n    [1 stroke]\n" in text
    timeline = opentimelineio.adapters.read_from_file(str(downloaded(look, "Shift+O")))
    (clip,) = timeline.tracks[0]
    marks = [(m.marked_range.start_time.value, m.marked_range.duration.value, m.color) for m in clip.markers]
    assert clip.name == "T010_tiny · draft" and marks == [(3, 3, "BLUE"), (4, 1, "ORANGE")]
    assert clip.markers[0].comment == "Größe 𝛼\nline two"


def test_files_of_others_are_merged_and_bad_ones_told_of(
    opened: Opened, page: Callable[..., Path], tmp_path: Path
) -> None:
    look = opened(page(note()))
    (tmp_path / "ben.json").write_text(
        json.dumps(document(note(text="later", modified=TIMES[3]), note(id=IDS[1], text=ATTACK)))
    )
    look.tab.set_input_files("#notes-file", tmp_path / "ben.json")
    look.wait("review.notes.all.length === 2")
    assert "2 notes new or changed" in look.tab.inner_text("#message")
    assert [each["text"] for each in look.ask(f"review.notes.get('{IDS[0]}').history")] == ["softer"]
    refused = look.ask(
        "(texts) => texts.filter((text) => "
        "{ try { notesIn(text); return false; } catch { return true; } }).length",
        [content for content, _ in WRONG.values() if "\udcff" not in content],
    )
    assert refused == len(WRONG) - 1
    (tmp_path / "bad.json").write_text(json.dumps(document(note(status="done"))))
    look.tab.set_input_files("#notes-file", tmp_path / "bad.json")
    look.wait("document.getElementById('message').textContent.includes('bad.json is left out')")
    assert 'notes.0.status is "done"' in look.tab.inner_text("#message")


def test_the_page_merges_as_python_does(opened: Opened, page: Callable[..., Path]) -> None:
    cases: list[tuple[list[dict[str, Any]], list[dict[str, Any]]]] = []

    @settings(max_examples=60, deadline=None, derandomize=True, database=None)
    @given(NOTES, NOTES)
    def collect(one: list[dict[str, Any]], two: list[dict[str, Any]]) -> None:
        cases.append((one, two))

    collect()
    found = opened(page()).ask("(cases) => cases.map(([a, b]) => mergedNotes(a, b))", cases)
    for (one, two), theirs in zip(cases, found, strict=True):
        both = (NotesDocument.model_validate_json(json.dumps(document(*part))).notes for part in (one, two))
        assert theirs == as_data(merged(*both))["notes"]


ODD = [
    None,
    True,
    -1,
    0,
    10**7,
    "",
    "x" * 20_001,
    "#FFB000",
    "3",
    "a\nb",
    "\x7f",
    "𝛼" * 400,
    [],
    [1],
    {},
    TIMES[0],
]


def test_the_page_takes_the_files_that_python_takes_and_no_others(
    opened: Opened, page: Callable[..., Path]
) -> None:
    cases = [note(**{name: odd}) for name in note() for odd in ODD]
    cases += [note(drawings=[stroke(**{name: odd})]) for name in stroke() for odd in ODD]
    cases += [note(history=[revision(**{name: odd})]) for name in revision() for odd in ODD]
    texts = [json.dumps(document(case)) for case in cases]
    ours = []
    for text in texts:
        try:
            ours.append(len(NotesDocument.model_validate_json(text).notes) == 1)
        except ValidationError:
            ours.append(False)
    theirs = opened(page()).ask(
        "(texts) => texts.map((text) => "
        "{ try { return notesIn(text).length === 1; } catch { return false; } })",
        texts,
    )
    assert [case for case, one, other in zip(cases, ours, theirs, strict=True) if one != other] == []
    assert 20 < sum(ours) < len(ours) - 200
