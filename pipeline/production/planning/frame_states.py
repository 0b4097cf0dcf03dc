"""What is done, stale, missing, failed and under way, frame by frame, by the keys of today's shot file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.frames import FrameRange
from pipeline.production.keys.digest import Key
from pipeline.production.planning.history import History
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store.store import Store

Stored = tuple[str, Key | None, Path]
"""A file that a frame should have: of which kind, of which key, and where it is shown."""

PICTURE_STAGES = ("render", "finish")
MESH_STAGES = ("simulate",)


@dataclass(frozen=True)
class FrameStates:
    """Frames of one shot and one kind of file.

    done          there, and what the shot file asks for
    stale         there, but made from something else
    missing       not there
    failed        of those stale or missing, the ones that failed when they were last tried
    running       of those stale or missing, the ones that are being made
    seconds_left  until none is stale or missing, if they come as fast as the last did; None: not known
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
    """The states of a shot's meshes, and of its pictures at every quality that was begun.

    `takes` are of one shot, one a quality.
    """
    return [
        mesh_states(requests[0], store, history),
        *(picture_states(request, store, history) for request in requests if is_begun(request, store)),
    ]


def is_begun(request: RenderRequest, store: Store) -> bool:
    """Whether pictures of a take were asked for at its quality."""
    return (store.root / request.folders.home / request.quality_name).exists()


def mesh_states(request: RenderRequest, store: Store, history: History) -> FrameStates:
    """The states of the meshes that a take asks for."""

    def mesh(number: int) -> Stored:
        return "mesh", request.mesh_key(number), request.motion_folders.mesh(number)

    return _states(request, "meshes", store, mesh, _Told(history, request.name, MESH_STAGES, None))


def picture_states(request: RenderRequest, store: Store, history: History) -> FrameStates:
    """The states of the finished pictures that a take asks for."""
    keys = request.picture_keys(store)

    def picture(number: int) -> Stored:
        return (
            "frame",
            keys[number].frame if keys else None,
            request.folders.frame(request.quality_name, number),
        )

    told = _Told(history, request.folders.name, PICTURE_STAGES, request.quality_name)
    return _states(request, request.quality_name, store, picture, told)


@dataclass(frozen=True)
class _Told:
    """What the last runs told of one kind of file."""

    history: History
    shot: str
    stages: tuple[str, ...]
    quality: str | None

    def among(self, undone: set[int]) -> Iterator[FrameRange]:
        """The failed and the running."""
        about = self.shot, self.stages, self.quality
        for found in (set(self.history.failed(*about)), self.history.running(*about)):
            yield FrameRange.of(sorted(found & undone))

    def left(self, undone: Iterable[int]) -> float | None:
        count, pace = len(set(undone)), self.history.pace(self.shot, self.stages, self.quality)
        return None if pace is None else count * pace


def _states(
    request: RenderRequest, what: str, store: Store, file_of: Callable[[int], Stored], told: _Told
) -> FrameStates:
    sorted_out: dict[str, list[int]] = {"done": [], "stale": [], "missing": []}
    for number in request.requested:
        kind, key, path = file_of(number)
        if store.shows(kind, key, path):
            sorted_out["done"].append(number)
        else:
            sorted_out["stale" if (store.root / path).exists() else "missing"].append(number)
    done, stale, missing = (FrameRange.of(numbers) for numbers in sorted_out.values())
    undone = {*stale, *missing}
    failed, running = told.among(undone)
    return FrameStates(
        request.name, what, done, stale, missing, failed, running, told.left(undone) if undone else None
    )
