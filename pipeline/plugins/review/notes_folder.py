"""The notes of a project: `notes/<shot>.json` next to `shots/`, production data that `clean` leaves alone."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.plugins.review.review_notes import ReviewNote, as_text, merged, read_notes
from pipeline.production.store.locks import making, writing
from pipeline.production.store.paths import NOTES
from pipeline.shot.yaml.named_files import is_there
from render.base.atomic_write import ChangedFileError, atomic_write


@dataclass(frozen=True)
class NotesFolder:
    """The notes below a root."""

    root: Path

    def path(self, shot: str) -> Path:
        return self.root / NOTES / f"{shot}.json"

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

        with writing(self.root), making(self.root, lock, wait=True):
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
    return read_notes(path) if is_there(path) else []


def _count(notes: Iterable[ReviewNote], before: Iterable[ReviewNote]) -> int:
    """Return how many of the notes merging them into those of `before` adds or changes."""
    there = {note.id: note for note in before}
    return sum(
        merged([note], [there[note.id]]) != [there[note.id]] if note.id in there else 1 for note in notes
    )
