"""Someone who follows a small shot on the live page while it is worked on."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

from flowsculpt.pipeline.plugins.preview.live_session import LiveFeed, LiveSession
from flowsculpt.pipeline.plugins.preview.sketch import Sketch
from flowsculpt.pipeline.plugins.preview.surface_stream import SurfaceStream
from flowsculpt.pipeline.production.execution.project import Project

NAME = "T010_tiny"
PATIENCE = 120.0


def save_whole(path: Path, text: str) -> None:
    """Save a text as editors do: in a file of its own, which then replaces the old one."""
    draft = path.with_suffix(".draft")
    draft.write_text(text)
    draft.replace(path)


class Follower:
    """A session that shows a shot, and all that it says."""

    def __init__(self, root: Path, text: str) -> None:
        self.root, self.shot = root, root / "shots" / f"{NAME}.yaml"
        self.shot.parent.mkdir(exist_ok=True)
        self.shot.write_text(text)
        self.feed, self.stream = LiveFeed(), SurfaceStream(Project(root, 2).store)
        self.movies = 0
        self.session = session = LiveSession(self._sketch, self.feed, self.stream, self._done, {self.shot})
        self.heard = self.feed.subscribe()
        threading.Thread(target=session.follow, daemon=True).start()

    def save(self, text: str) -> None:
        """Save the shot in one step: nobody reads half of it, however long this process stalls."""
        save_whole(self.shot, text)

    def until(self, words: str) -> list[dict[str, Any]]:
        """All that is heard until something is said that begins with these words."""
        messages = []
        while not (messages and messages[-1].get("words", "").startswith(words)):
            messages.append(self.heard.get(timeout=PATIENCE))
        return messages

    def _sketch(self) -> Sketch:
        return Sketch(Project(self.root, 2).request(self.shot, "draft", None, variant="none"))

    def _done(self, ready: object) -> None:
        self.movies += 1
