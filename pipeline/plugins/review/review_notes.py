"""Notes of reviews: what a file of them holds, how files are merged, and where a project has them.

A file is JSON: ``{"format": "flowsculpt notes", "version": 1, "notes": [...]}``. A note has an id, which is a
UUID, and revisions: the latest stands in the note itself, earlier ones under `history`. A deleted note stays,
and its latest revision says so. The page of `review` follows the same rule (page/note_merging.js).

The notes of a shot are `notes/<shot>.json` next to `shots/`, production data that `clean` leaves alone.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError, model_validator

from flowsculpt import MachineError, MissingInputError, UsageError
from flowsculpt.api import shorten
from flowsculpt.api.files import ChangedFileError, InputFile, atomic_write
from flowsculpt.api.frames import Folders, Locks
from flowsculpt.api.shots import NAME_PATTERN

FORMAT = "flowsculpt notes"
VERSION = 1

STATUSES = ("open", "change", "approved")

UNITS = 10_000  # units of a drawing to the width of its picture; heights are measured in the same unit

_PRINTED = r"^[^\x00-\x08\x0b-\x1f\x7f-\x9f]*$"
"""Text without control characters, which could command a terminal; tabs and line ends are allowed."""

FrameNumber = Annotated[int, Field(ge=-1_000_000, le=1_000_000)]
Coordinate = Annotated[int, Field(ge=-100_000, le=100_000)]
Line = Annotated[str, StringConstraints(max_length=400, pattern=r"^[^\x00-\x1f\x7f-\x9f]*$")]
Text = Annotated[str, StringConstraints(max_length=20_000, pattern=_PRINTED)]
Time = Annotated[
    str,
    StringConstraints(
        pattern=r"^20[0-9]{2}-(0[1-9]|1[0-2])-(0[1-9]|[12][0-9]|3[01])"
        r"T([01][0-9]|2[0-3]):[0-5][0-9]:[0-5][0-9]\.[0-9]{3}Z$"
    ),
]


class _Document(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


class NoteStroke(_Document):
    """One stroke of a drawing over the picture of a frame."""

    frame: FrameNumber
    kind: Literal["pen", "arrow", "rectangle", "text"]
    ink: Annotated[str, Field(pattern=r"^#[0-9a-f]{6}$", description="The colour, as #ffb000.")]
    width: Annotated[int, Field(ge=1, le=1000, description="Width of the line; text is six times as high.")]
    points: Annotated[
        tuple[Coordinate, ...],
        Field(
            min_length=2,
            max_length=20_000,
            description="x0, y0, x1, y1, … from the upper left corner of the picture, in ten-thousandths of "
            "its width. An arrow ends at its second point; a rectangle has two opposite corners; text begins "
            "at its one point.",
        ),
    ]
    text: Annotated[Text, Field(description="The text of the kind `text`; otherwise empty.")]

    @model_validator(mode="after")
    def _check_points(self) -> NoteStroke:
        count = len(self.points)
        if count % 2 or (self.kind != "pen" and count != {"text": 2}.get(self.kind, 4)):
            raise ValueError(f"points: {count} numbers do not make a drawing of the kind {self.kind}")
        return self


class NoteRevision(_Document):
    """One revision of a note: what it says from one moment on."""

    shot: Annotated[str, Field(pattern=f"^{NAME_PATTERN}$")]
    sequence: Annotated[Line, Field(description="The sequence's name on the page, as `v001 daily`.")]
    picture: Annotated[
        str,
        Field(
            pattern="^[0-9a-f]{0,64}$",
            description="The key of the first frame's picture when the note was written; empty if unknown.",
        ),
    ]
    first: Annotated[FrameNumber, Field(description="The first frame that the note is about.")]
    last: Annotated[FrameNumber, Field(description="The last frame, inclusive.")]
    status: Literal["open", "change", "approved"]
    text: Text
    drawings: Annotated[tuple[NoteStroke, ...], Field(max_length=2000)]
    author: Annotated[Line, Field(description="The writer of this revision.")]
    created: Annotated[Time, Field(description="UTC, the same in all revisions of a note.")]
    modified: Annotated[Time, Field(description="UTC, when this revision was written.")]
    deleted: Annotated[bool, Field(description="The note is deleted; merging still recognises it.")]

    @model_validator(mode="after")
    def _check_frames(self) -> NoteRevision:
        if self.first > self.last:
            raise ValueError(f"first: {self.first} is after the last frame, {self.last}")
        return self

    @property
    def order(self) -> tuple[str, str]:
        """Revisions are sorted by their time; by all that they say where times are equal."""
        fields = {name: getattr(self, name) for name in NoteRevision.model_fields}
        return self.modified, json.dumps(fields, sort_keys=True, default=_plain, separators=(",", ":"))


def _plain(stroke: NoteStroke) -> dict[str, Any]:
    return stroke.model_dump(mode="json")


class ReviewNote(NoteRevision):
    """A note: its latest revision, and the earlier ones, the oldest first."""

    id: Annotated[
        str,
        Field(pattern="^[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{12}$", description="UUID."),
    ]
    history: Annotated[tuple[NoteRevision, ...], Field(max_length=10_000)]

    @property
    def revisions(self) -> list[NoteRevision]:
        """All revisions, in no order."""
        latest = NoteRevision.model_construct(**{n: getattr(self, n) for n in NoteRevision.model_fields})
        return [*self.history, latest]


class NotesDocument(_Document):
    """A file of notes."""

    format: Literal["flowsculpt notes"]
    version: Literal[1]
    notes: tuple[ReviewNote, ...]


def merged(*collections: Iterable[ReviewNote]) -> list[ReviewNote]:
    """Return all notes of all collections, with all their revisions; the latest one of a note is shown.

    The order of the collections does not matter, nor how often one is given.
    """
    revisions: dict[str, dict[tuple[str, str], NoteRevision]] = {}
    for note in (note for notes in collections for note in notes):
        revisions.setdefault(note.id, {}).update({each.order: each for each in note.revisions})
    notes = []
    for name, found in revisions.items():
        *history, latest = (found[order] for order in sorted(found))
        fields = {field: getattr(latest, field) for field in NoteRevision.model_fields}
        notes.append(ReviewNote.model_construct(**fields, id=name, history=tuple(history)))
    return sorted(notes, key=lambda note: (note.created, note.id))


def as_data(notes: Iterable[ReviewNote]) -> dict[str, Any]:
    """Return notes as a file holds them."""
    dumped = [note.model_dump(mode="json") for note in notes]
    return {
        "format": FORMAT,
        "version": VERSION,
        "notes": [{"id": note.pop("id"), **note} for note in dumped],
    }


def as_text(notes: Iterable[ReviewNote]) -> str:
    """Return the text of a file of notes."""
    return json.dumps(as_data(notes), indent=1, ensure_ascii=False) + "\n"


def read_notes(path: Path) -> list[ReviewNote]:
    """Return the notes of a file. Raises MissingInputError, UsageError, or MachineError if it is refused."""
    if not InputFile(path).is_there():
        raise MissingInputError(f"{path}: no such file of notes; the page of flowsculpt review downloads one")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise MachineError.of_path(path, error, "read") from None
    try:
        return merged(NotesDocument.model_validate_json(content).notes)
    except ValidationError as error:
        raise UsageError(f"{path}: {_fault(error)}") from None


_HEAD = ("", "format", "version", "notes")
"""What every file of notes begins with; pydantic does not promise in which order it finds faults."""


def _fault(error: ValidationError) -> str:
    """Return the first fault of a file in words; one of its head comes before all others."""
    faults = {".".join(map(str, fault["loc"])): fault for fault in reversed(error.errors(include_url=False))}
    place = next((name for name in _HEAD if name in faults), [*faults][-1])
    first, given = faults[place], faults[place].get("input")
    if first["type"] == "json_invalid":
        return f"not JSON, or cut short ({first['ctx']['error']}); download the notes again"
    if place == "version" and isinstance(given, int) and given > VERSION:
        return (
            f"version {given} of the format is newer than {VERSION}, the newest that is read; upgrade "
            "flowsculpt"
        )
    if place in _HEAD:
        return (
            f'not a file of notes; it must begin with "format": "{FORMAT}", "version": {VERSION}, '
            '"notes"; take one that the review page downloaded'
        )
    if first["type"] == "missing":
        return f"{place} is missing; take the file as the review page downloaded it"
    if first["type"] == "extra_forbidden":
        return f"{place} is unknown in version {VERSION} of the format; remove it"
    rule = first["msg"].removeprefix("Value error, ")
    if first["type"] == "string_pattern_mismatch":
        rule = "the format does not allow this text here"
    value = "" if first["type"] == "value_error" else f" is {shorten(json.dumps(given, default=str))}"
    return f"{place}{value}: {rule[0].lower()}{rule[1:]}; take the file as the review page downloaded it"


@dataclass(frozen=True)
class NotesFolder:
    """The notes below a root."""

    root: Path

    def path(self, shot: str) -> Path:
        return Folders.of_root(self.root).notes / f"{shot}.json"

    def notes(self, shot: str) -> list[ReviewNote]:
        """Return the notes of a shot. Raises what `read_notes` raises."""
        return _notes_in(self.path(shot))

    def add(self, files: Sequence[Path], dry: bool = False) -> dict[str, int]:
        """Merge files into those of their shots, and return the number of new and changed notes by shot.

        All files are read first: one that is damaged leaves everything as it is. Raises what `read_notes`
        raises, and MachineError where the disk refuses.
        """
        given = merged(*map(read_notes, files))
        changes = {}
        for shot in sorted({note.shot for note in given}):
            theirs = [note for note in given if note.shot == shot]
            changes[shot] = _count(theirs, self.notes(shot)) if dry else self._add(theirs, shot)
        return changes

    def _add(self, notes: list[ReviewNote], shot: str) -> int:
        """Merge notes into the file of a shot, which is written whole or not at all.

        Where another program replaces it meanwhile, they are merged into what that has written.
        """
        path, lock = self.path(shot), {f"notes.{shot}": f"the notes of {shot}"}

        def is_same(path: Path) -> bool:
            return _notes_in(path) == before

        with Locks(self.root).hold_with_writers(), Locks(self.root).hold(lock, wait=True):
            while True:
                before = self.notes(shot)
                count = _count(notes, before)
                if not count:
                    return 0
                try:
                    with atomic_write(path, is_same=is_same) as draft:
                        draft.write_text(as_text(merged(before, notes)), encoding="utf-8")
                    return count
                except ChangedFileError:
                    continue


def notes_file(root: Path, shot: str) -> bytes:
    """Return the file of a shot's notes; empty if it has none. Raises what `read_notes` raises."""
    notes = NotesFolder(root).notes(shot)
    return as_text(notes).encode() if notes else b""


def _notes_in(path: Path) -> list[ReviewNote]:
    return read_notes(path) if InputFile(path).is_there() else []


def _count(notes: Iterable[ReviewNote], before: Iterable[ReviewNote]) -> int:
    """Return how many of the notes merging them into those of `before` adds or changes."""
    there = {note.id: note for note in before}
    return sum(
        merged([note], [there[note.id]]) != [there[note.id]] if note.id in there else 1 for note in notes
    )
