"""The notes of a project: `notes/<shot>.json` beside `shots/`, production data that `clean` leaves alone."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.production.store.locks import making, writing
from pipeline.production.versions.review_notes import ReviewNote, as_text, merged, read_notes
from pipeline.shot.yaml.lookup import is_there
from render.base.atomic_write import atomic_write

NOTES = Path("notes")


@dataclass(frozen=True)
class NotesFolder:
    """The notes below a root."""

    root: Path

    def path(self, shot: str) -> Path:
        return self.root / NOTES / f"{shot}.json"

    def notes(self, shot: str) -> list[ReviewNote]:
        """Return the notes of a shot. Raises what `read_notes` raises."""
        path = self.path(shot)
        return read_notes(path) if is_there(path) else []

    def add(self, files: Sequence[Path], dry: bool = False) -> dict[str, int]:
        """Merge files into those of their shots, and return the number of new and changed notes by shot.

        All files are read first: one that is damaged leaves everything as it is. Raises what `read_notes`
        raises, and MachineError where the disk refuses.
        """
        given = merged(*map(read_notes, files))
        changes = {}
        for shot in sorted({note.shot for note in given}):
            theirs = [note for note in given if note.shot == shot]
            changes[shot] = self._count(theirs, shot) if dry else self._add(theirs, shot)
        return changes

    def _count(self, notes: Iterable[ReviewNote], shot: str) -> int:
        there = {note.id: note for note in self.notes(shot)}
        return sum(
            merged([note], [there[note.id]]) != [there[note.id]] if note.id in there else 1 for note in notes
        )

    def _add(self, notes: list[ReviewNote], shot: str) -> int:
        """Merge notes into the file of a shot, which is written whole or not at all."""
        path, lock = self.path(shot), {f"notes.{shot}": f"the notes of {shot}"}
        with writing(self.root), making(self.root, lock, wait=True):
            count = self._count(notes, shot)
            if count:
                text = as_text(merged(self.notes(shot), notes))
                with atomic_write(path) as draft:
                    draft.write_text(text, encoding="utf-8")
        return count
