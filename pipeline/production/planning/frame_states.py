"""States of frames: done, stale, missing, failed or running, by the keys of today's shot file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from pipeline.errors import UsageError, suggestion
from pipeline.frames import FrameRange
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store.event_log import History
from pipeline.production.store.store import Key, Store

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
    about = request.name, MESH_STAGES, None
    return _states(request, "meshes", "mesh", request.mesh_key, store, history, about)


def picture_states(request: RenderRequest, store: Store, history: History) -> FrameStates:
    """Return the states of the finished pictures of a request."""
    keys, quality = request.picture_keys(store), request.quality_name

    def key(number: int) -> Key | None:
        return keys[number].frame if keys else None

    about = request.folders.name, PICTURE_STAGES, quality
    return _states(request, quality, "frame", key, store, history, about)


def _states(
    request: RenderRequest,
    what: str,
    kind: str,
    key: Callable[[int], Key | None],
    store: Store,
    history: History,
    about: tuple[str, Sequence[str], str | None],
) -> FrameStates:
    """Return the states of the files of a kind.

    key    returns the key that a frame's file should have
    about  the shot, the stages and the quality of its events in the history
    """
    by_state: dict[str, list[int]] = {"done": [], "stale": [], "missing": []}
    for number in request.requested:
        path = request.place(kind, number)
        if store.shows(kind, key(number), path):
            by_state["done"].append(number)
        else:
            by_state["stale" if (store.root / path).exists() else "missing"].append(number)
    undone = {*by_state["stale"], *by_state["missing"]}
    pace = history.pace(*about) if undone else None
    return FrameStates(
        request.name,
        what,
        **{state: FrameRange.of(numbers) for state, numbers in by_state.items()},
        failed=FrameRange.of(sorted(undone & history.failed(*about).keys())),
        running=FrameRange.of(sorted(undone & history.running(*about))),
        seconds_left=None if pace is None else len(undone) * pace,
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
