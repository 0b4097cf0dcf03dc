"""Gives `publish` the notes of a shot, and `schema` the model of their files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from flowsculpt.api import ShotExtras

if TYPE_CHECKING:
    from pydantic import BaseModel


class ReviewExtras(ShotExtras):
    """The notes of reviewers on a shot."""

    def notes(self, root: Path, shot: str) -> bytes:
        from flowsculpt.pipeline.plugins.review.review_notes import notes_file

        return notes_file(root, shot)

    def schemas(self) -> dict[str, type[BaseModel]]:
        from flowsculpt.pipeline.plugins.review.review_notes import NotesDocument

        return {"notes": NotesDocument}
