"""States of frames: done, in the remote store, stale, unframed, rendered, missing, failed or running.

They go by the keys of today's shot file.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from flowsculpt.pipeline.frames import FrameRange, FrameWords
from flowsculpt.pipeline.production.request.cameras import ShownCameras
from flowsculpt.pipeline.production.request.keys import PictureKeys, picture_keys
from flowsculpt.pipeline.production.request.render_request import FORMS, RenderRequest
from flowsculpt.pipeline.production.stages import PLUGIN_STAGES
from flowsculpt.pipeline.production.store.history import SHARED, History
from flowsculpt.pipeline.production.store.store import Key, Store

PICTURE_STAGES = ("render", *(stage.name for stage in PLUGIN_STAGES), "finish")
MESH_STAGES = ("simulate",)


@dataclass(frozen=True)
class FrameStates:
    """Frames of one shot and one kind of file.

    done          present, with the key that the shot file asks for
    remote        in the remote store with that key; the next run fetches them
    stale         present, with another key
    unframed      present and as asked for, if the camera stays, which is framed again
    rendered      not present, but rendered as asked for, and not denoised yet
    missing       not present
    failed        frames that are not done and failed at the last try
    running       frames that are not done and are being made
    seconds_left  until all frames are done, at the pace of the last run; None if not known
    """

    shot: str
    what: str
    done: FrameRange
    remote: FrameRange
    stale: FrameRange
    unframed: FrameRange
    rendered: FrameRange
    missing: FrameRange
    failed: FrameRange
    running: FrameRange
    seconds_left: float | None

    @classmethod
    def of_meshes(cls, request: RenderRequest, store: Store, history: History) -> FrameStates:
        """Return the states of the meshes of a request."""

        numbers = request.requested

        def states_of(part: RenderRequest) -> Iterator[str]:
            places = part.places("mesh", numbers)
            shown = _names_in(f"{store.root}/{places[0].rpartition('/')[0]}")
            for number, place in zip(numbers, places, strict=True):
                if store.url is None and place.rpartition("/")[2] not in shown:
                    yield "missing"  # whatever its key is, which takes the flow of all frames before
                    continue
                key = part.keys.mesh(number)
                if store.shows("mesh", key, place):
                    yield "done"
                else:
                    yield "remote" if store.is_remote("mesh", key) else _undone(store, place)

        def of_all(*found: str) -> str:
            return next(state for state in ("stale", "missing", "remote", "done") if state in found)

        names = [request.name if part is request else part.folders.title for part in request.parts]
        found = map(of_all, *map(states_of, request.parts))
        return _states(request, "meshes", found, history, [(name, MESH_STAGES, SHARED) for name in names])

    @classmethod
    def of_pictures(cls, request: RenderRequest, store: Store, history: History) -> FrameStates:
        """Return the states of the finished pictures of a request."""
        quality = request.quality_name
        found = map(KnownPictures(request, store).state, request.requested)
        return _states(request, quality, found, history, [(request.folders.name, PICTURE_STAGES, quality)])

    def as_data(self) -> dict[str, Any]:
        names = ("done", "remote", "stale", "unframed", "rendered", "missing", "failed", "running")
        left = None if self.seconds_left is None else round(self.seconds_left, 1)
        lists = {n: list(getattr(self, n)) for n in names}
        return {"shot": self.shot, "what": self.what, **lists, "seconds_left": left}


class KnownPictures:
    """The pictures of a request, by all that is known before anything is made.

    Until new cameras are framed, pictures are compared by the cameras that were framed last.
    """

    def __init__(self, request: RenderRequest, store: Store, rendered: Collection[int] = ()) -> None:
        """Compare pictures with the store; a run that renders the frames `rendered` averages them too."""
        self._request, self._store, self._rendered = request, store, rendered
        self.keys: PictureKeys | None = picture_keys(request, store, rendered)
        self.is_framed = self.keys is not None
        self._shown = None if self.is_framed else ShownCameras.of(request, store)
        if self._shown is not None:
            self.keys = PictureKeys(request, store, self._shown.cameras, rendered)
        self._names: dict[str, frozenset[str]] = {}

    def state(self, number: int) -> str:
        """Return the state of a finished frame: done, remote, stale, unframed, rendered or missing."""
        place = self._place("frame", number)
        if self.is_framed and self._store.shows("frame", self._key("frame", number), place):
            return "done"  # shown, so the store holds it: most frames need no further look
        is_held = self.holds("frame", number)
        is_shown = self.keys is None or (
            is_held is not False and self._store.shows("frame", self.keys[number].frame, place)
        )
        if is_held is not False and is_shown:
            return "done" if is_held else "unframed"
        if is_held and self._store.is_remote("frame", self._key("frame", number)):
            return "remote"
        state = _undone(self._store, place)
        is_rendered = state == "missing" and is_held is False and self.holds("raw", number)
        return "rendered" if is_rendered else state

    def holds(self, kind: str, number: int) -> bool | None:
        """Tell whether the store holds a `raw` picture, a `frame` or a still.

        Return None if it does so long as the camera stays, which is framed again.
        """
        if self.keys is None:
            return None if self._is_there("frame" if kind in FORMS else kind, number) else False
        if self.is_framed:
            return self._store.holds(kind, self._key(kind, number))
        assert self._shown is not None, "keys come from cameras"
        around = (number,) if kind == "raw" else self._around(number)
        if any(n not in self._shown.cameras or n in self._shown.moved for n in around):
            return False
        if not self._store.holds(kind, self._key(kind, number)):
            return False
        return True if self._shown.settled.issuperset(around) else None

    def _is_there(self, kind: str, number: int) -> bool:
        """Tell whether any file of a kind is shown; its folder is listed once."""
        folder, _, name = self._place(kind, number).rpartition("/")
        if kind not in self._names:
            self._names[kind] = _names_in(f"{self._store.root}/{folder}")
        return name in self._names[kind]

    def _place(self, kind: str, number: int) -> str:
        return self._request.places(kind, (number,))[0]

    def _key(self, kind: str, number: int) -> Key:
        assert self.keys is not None, "the caller checks"
        keys = self.keys[number]
        if kind in FORMS:
            return self._request.keys.still(kind, keys.frame)
        return keys.raw if kind == "raw" else keys.frame

    def _around(self, number: int) -> tuple[int, ...]:
        """Return the frames that a finished frame is averaged with."""
        assert self.keys is not None, "the caller checks"
        was_rendered = self.keys.is_available
        return self._request.pictures.window(number, lambda n: n in self._rendered or was_rendered(n))


def _names_in(folder: str) -> frozenset[str]:
    """Return the names of the files in a folder; none where there is no such folder."""
    with suppress(FileNotFoundError, NotADirectoryError):
        return frozenset(os.listdir(folder))  # noqa: PTH208  # Paths are slow
    return frozenset()


def _undone(store: Store, place: str) -> str:
    return "stale" if os.path.exists(f"{store.root}/{place}") else "missing"  # noqa: PTH110  # Paths are slow


def _states(
    request: RenderRequest,
    what: str,
    found: Iterable[str],
    history: History,
    about: Sequence[tuple[str, Sequence[str], str]],
) -> FrameStates:
    """Return the states of the files of a kind.

    found  the state of each frame of the request
    about  the shot, the stages and the quality of its events in the history; those of several subjects
    """
    names = ("done", "remote", "stale", "unframed", "rendered", "missing")
    by_state: dict[str, list[int]] = {name: [] for name in names}
    for number, state in zip(request.requested, found, strict=True):
        by_state[state].append(number)
    undone = set(request.requested) - set(by_state["done"]) - set(by_state["remote"])
    paces = [history.pace(*each) for each in about] if undone else []
    pace = max(filter(None, paces), default=None)
    return FrameStates(
        request.name,
        what,
        **{state: FrameRange.of(numbers) for state, numbers in by_state.items()},
        failed=FrameRange.of(sorted(undone & {n for each in about for n in history.failed(*each)})),
        running=FrameRange.of(sorted(undone & {n for each in about for n in history.running(*each)})),
        seconds_left=None if pace is None else len(undone) * pace,
    )


def select_frames(words: FrameWords, whole: FrameRange, states: Callable[[], FrameStates]) -> FrameRange:
    """Return the frames that words select, in the order of the shot.

    Stale frames include unframed ones, missing ones those that the remote store has and those that are
    rendered and not denoised.
    """
    if "all" in words.words:
        return whole
    known, more = states(), {"stale": ("unframed",), "missing": ("remote", "rendered")}
    names = [name for word in words.words for name in (word, *more.get(word, ()))]
    wanted = {number for name in names for number in getattr(known, name)}
    return FrameRange(number for number in whole if number in wanted)
