"""States of frames: done, stale, missing, failed or running, by the keys of today's shot file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import UsageError, suggestion
from pipeline.frames import FrameRange
from pipeline.production.planning.history import History
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store.store import Key, Store

Stored = tuple[str, Key | None, Path]
"""A file that a frame should have: its kind, its key, and its path under the root."""

PICTURE_STAGES = ("render", "finish")
MESH_STAGES = ("simulate",)


@dataclass(frozen=True)
class FrameStates:
    """Frames of one shot and one kind of file.

    done          present, with the key that the shot file asks for
    stale         present, with another key
    missing       not present
    failed        stale or missing frames that failed at the last try
    running       stale or missing frames that are being made
    seconds_left  until no frame is stale or missing, at the pace of the last run; None if not known
    """

    shot: str
    what: str
    done: FrameRange
    stale: FrameRange
    missing: FrameRange
    failed: FrameRange
    running: FrameRange
    seconds_left: float | None

    def as_data(self) -> dict[str, Any]:
        names = ("done", "stale", "missing", "failed", "running")
        left = None if self.seconds_left is None else round(self.seconds_left, 1)
        lists = {n: list(getattr(self, n)) for n in names}
        return {"shot": self.shot, "what": self.what, **lists, "seconds_left": left}


def states(requests: list[RenderRequest], store: Store, history: History) -> list[FrameStates]:
    """Return the states of a shot's meshes, and of its pictures at every quality that was begun.

    requests  of one shot, one a quality
    """
    return [
        mesh_states(requests[0], store, history),
        *(picture_states(request, store, history) for request in requests if is_begun(request, store)),
    ]


def is_begun(request: RenderRequest, store: Store) -> bool:
    """Tell whether pictures of a request were ever asked for at its quality."""
    return (store.root / request.folders.home / request.quality_name).exists()


def mesh_states(request: RenderRequest, store: Store, history: History) -> FrameStates:
    """Return the states of the meshes of a request."""

    def mesh(number: int) -> Stored:
        return "mesh", request.mesh_key(number), request.place("mesh", number)

    return _states(request, "meshes", store, mesh, _FileHistory(history, request.name, MESH_STAGES, None))


def picture_states(request: RenderRequest, store: Store, history: History) -> FrameStates:
    """Return the states of the finished pictures of a request."""
    keys = request.picture_keys(store)

    def picture(number: int) -> Stored:
        return (
            "frame",
            keys[number].frame if keys else None,
            request.place("frame", number),
        )

    history_of_file = _FileHistory(history, request.folders.name, PICTURE_STAGES, request.quality_name)
    return _states(request, request.quality_name, store, picture, history_of_file)


@dataclass(frozen=True)
class _FileHistory:
    """The history of one kind of file of one shot."""

    history: History
    shot: str
    stages: tuple[str, ...]
    quality: str | None

    def among(self, undone: set[int]) -> Iterator[FrameRange]:
        """Yield the failed and the running frames among those that are not done."""
        about = self.shot, self.stages, self.quality
        for found in (set(self.history.failed(*about)), self.history.running(*about)):
            yield FrameRange.of(sorted(found & undone))

    def left(self, undone: Iterable[int]) -> float | None:
        count, pace = len(set(undone)), self.history.pace(self.shot, self.stages, self.quality)
        return None if pace is None else count * pace


def _states(
    request: RenderRequest,
    what: str,
    store: Store,
    file_of: Callable[[int], Stored],
    history_of_file: _FileHistory,
) -> FrameStates:
    by_state: dict[str, list[int]] = {"done": [], "stale": [], "missing": []}
    for number in request.requested:
        kind, key, path = file_of(number)
        if store.shows(kind, key, path):
            by_state["done"].append(number)
        else:
            by_state["stale" if (store.root / path).exists() else "missing"].append(number)
    done, stale, missing = (FrameRange.of(numbers) for numbers in by_state.values())
    undone = {*stale, *missing}
    failed, running = history_of_file.among(undone)
    return FrameStates(
        request.name,
        what,
        done,
        stale,
        missing,
        failed,
        running,
        history_of_file.left(undone) if undone else None,
    )


WORDS = ("all", "missing", "stale", "failed")


def is_in_words(text: str) -> bool:
    """Tell whether a frame option holds words, such as `failed` or `missing,stale`, instead of numbers."""
    return any(part.strip().isalpha() for part in text.split(","))


def selected(text: str, whole: FrameRange, states: Callable[[], FrameStates]) -> FrameRange:
    """Return the frames that words select, in the order of the shot.

    Raises UsageError for a word that is none, and for words beside numbers.
    """
    words = [part.strip() for part in text.split(",")]
    for word in words:
        if word not in WORDS:
            if not word.isalpha():
                raise UsageError(
                    f"{text!r} is not a frame range; write one as 1-48x2, or words alone: failed,stale"
                )
            raise UsageError(f"{word!r} is not a frame range or a word. {suggestion(word, WORDS)}")
    if "all" in words:
        return whole
    known = states()
    wanted = {number for word in words for number in getattr(known, word)}
    return FrameRange.of(n for n in whole if n in wanted)
