"""What is done, stale and missing, frame by frame, by the keys of today's shot file."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.frames import FrameRange
from pipeline.production.keys import Key
from pipeline.production.store import Store
from pipeline.production.take import Take


@dataclass(frozen=True)
class FrameStates:
    """Frames of one shot and one kind of file.

    done     there, and what the shot file asks for
    stale    there, but made from something else
    missing  not there
    """

    shot: str
    what: str
    done: FrameRange
    stale: FrameRange
    missing: FrameRange

    def as_data(self) -> dict[str, Any]:
        names = ("done", "stale", "missing")
        return {"shot": self.shot, "what": self.what, **{n: list(getattr(self, n)) for n in names}}


def states(takes: list[Take], store: Store) -> list[FrameStates]:
    """The states of a shot's meshes, and of its pictures at every quality that was begun.

    `takes` are of one shot, one a quality.
    """
    shot, folders = takes[0], takes[0].motion_folders
    rows = [
        _states(shot, "meshes", store, lambda n: ("mesh", shot.mesh_key(n), folders.mesh(n)), shot.requested)
    ]
    for take in takes:
        if (store.root / take.folders.home / take.quality_name).exists():
            rows.append(_states(take, take.quality_name, store, _pictures(take, store), take.requested))
    return rows


def _pictures(take: Take, store: Store) -> Callable[[int], tuple[str, Key | None, Path]]:
    keys = take.picture_keys(store)

    def picture(number: int) -> tuple[str, Key | None, Path]:
        return "frame", keys[number].frame if keys else None, take.folders.frame(take.quality_name, number)

    return picture


def _states(
    take: Take,
    what: str,
    store: Store,
    file_of: Callable[[int], tuple[str, Key | None, Path]],
    numbers: Iterable[int],
) -> FrameStates:
    sorted_out: dict[str, list[int]] = {"done": [], "stale": [], "missing": []}
    for number in numbers:
        kind, key, path = file_of(number)
        if store.shows(kind, key, path):
            sorted_out["done"].append(number)
        else:
            sorted_out["stale" if (store.root / path).exists() else "missing"].append(number)
    return FrameStates(take.shot.name, what, **{k: FrameRange.of(v) for k, v in sorted_out.items()})
