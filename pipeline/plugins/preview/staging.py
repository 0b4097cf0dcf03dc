"""Answers to the live page: the state of the shot file, edits, undo, redo and pictures of a drag.

Every request and every answer is a JSON object.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from pipeline.errors import UsageError
from pipeline.plugins.preview.live_server import Action
from pipeline.plugins.preview.live_session import LiveSession
from pipeline.plugins.preview.shot_editor import ShotEditor, edits_in, where_in
from pipeline.plugins.preview.trial_pictures import TrialPictures


def actions_of(editor: ShotEditor, session: LiveSession) -> dict[str, Action]:
    """Return the page's requests by name. Each may name the `frame` that the page shows."""

    pictures = TrialPictures(editor, session)

    def state(asked: Mapping[str, Any]) -> dict[str, Any]:
        _note_frame(session, asked)
        return editor.state()

    def edited(asked: Mapping[str, Any], write: Callable[[str], dict[str, Any]]) -> dict[str, Any]:
        """Write an edit of the text that the page shows, and end the rest of a drag."""
        _note_frame(session, asked)
        try:
            return write(_text(asked, "digest"))
        finally:
            session.resume()

    def edit(asked: Mapping[str, Any]) -> dict[str, Any]:
        return edited(
            asked,
            lambda digest: editor.edit(digest, edits_in(asked.get("edits")), _text(asked, "gesture", "")),
        )

    def undo(asked: Mapping[str, Any]) -> dict[str, Any]:
        return edited(asked, editor.undo)

    def redo(asked: Mapping[str, Any]) -> dict[str, Any]:
        return edited(asked, editor.redo)

    def prepare(asked: Mapping[str, Any]) -> dict[str, Any]:
        pictures.prepare(where_in(asked.get("where")), _frame(asked))
        return {}

    def follow(asked: Mapping[str, Any]) -> dict[str, Any]:
        return pictures.picture(_text(asked, "digest"), edits_in(asked.get("edits")), _frame(asked))

    return {action.__name__: action for action in (state, edit, undo, redo, prepare, follow)}


def _frame(asked: Mapping[str, Any]) -> int:
    frame = asked.get("frame")
    if not isinstance(frame, int):
        raise UsageError("frame must be a number")
    return frame


def _note_frame(session: LiveSession, asked: Mapping[str, Any]) -> None:
    frame = asked.get("frame")
    if isinstance(frame, int):
        session.focus = frame


def _text(asked: Mapping[str, Any], name: str, default: str | None = None) -> str:
    value = asked.get(name, default)
    if not isinstance(value, str) or len(value) > 100:
        raise UsageError(f"{name} must be text of at most 100 characters")
    return value
