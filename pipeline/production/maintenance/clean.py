"""What of the store nobody needs: neither today's shots, nor what renders/ shows, nor the last runs."""

from __future__ import annotations

import contextlib
import json
import shutil
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import FlowsculptError
from pipeline.production.keys.digest import Key
from pipeline.production.planning.history import RUNS
from pipeline.production.request.render_request import FORMS, RenderRequest
from pipeline.production.store.paths import DONE, EVENTS, LOGS, PLANS
from pipeline.production.store.store import Store

Named = tuple[str, Key]
"""A file of the store: its kind and its key."""


@dataclass(frozen=True)
class Sweep:
    """What goes and what stays: files of the store, and bytes."""

    gone: tuple[Path, ...]
    kept: int
    freed: int


def sweep(store: Store, requests: Iterable[RenderRequest], keep: int, only_tell: bool) -> Sweep:
    """Remove from the store what is needed neither by `takes`, nor by the last `keep` runs of each shot; what
    is shown in renders/ stays. Only whoever holds the root's lock may call this, but to be told."""
    needed = {
        name for request in (*requests, *_of_last_runs(store.root, keep)) for name in _needs(request, store)
    }
    shown = set(_inodes(store.root / "renders"))
    gone: list[Path] = []
    kept, freed = 0, 0
    for kind, key, path in store.entries():
        facts = path.stat()
        if (kind, key) in needed or (facts.st_dev, facts.st_ino) in shown:
            kept += 1
            continue
        gone.append(path)
        freed += facts.st_size
        if not only_tell:
            store.discard(kind, key)
    if not only_tell:
        _forget_runs(store.root, max(keep, RUNS))
        for folder in (DONE, LOGS / "jobs"):  # Snakemake finds out anew what is done
            for path in (store.root / folder).glob("*"):
                if path.name != "renders":  # by which keys Snakemake knows movies
                    shutil.rmtree(path, ignore_errors=True)
    return Sweep(tuple(gone), kept, freed)


def _needs(request: RenderRequest, store: Store) -> Iterator[Named]:
    """Every file on the way to the pictures of a take."""
    with contextlib.suppress(FlowsculptError):  # a shot that cannot be read any more needs nothing
        for angle in request.angles.values():
            yield "mesh", request.mesh_key(angle.mesh)
            yield "normals", request.normals_key(angle.mesh)
        yield "cameras", request.cameras_key
        keys = request.picture_keys(store)
        if keys is None:
            return
        for number in request.angles:
            yield "raw", keys[number].raw
            yield "frame", keys[number].frame
            yield from ((form, request.still_key(form, keys[number].frame)) for form in FORMS)
        for numbers in (request.requested, tuple(request.angles)):
            yield "movie", request.movie_key([keys[n].frame for n in sorted(numbers)])


def _of_last_runs(root: Path, count: int) -> Iterator[RenderRequest]:
    """The takes of the last so many runs of each shot at each quality, by their plans."""
    seen: Counter[tuple[Any, ...]] = Counter()
    for path in sorted((root / PLANS).glob("*.json"), reverse=True):
        with contextlib.suppress(OSError, ValueError, KeyError):
            for data in json.loads(path.read_text())["requests"]:
                about = data["source"]["path"], data["quality_name"], str(data["turntable"])
                seen[about] += 1
                if seen[about] <= count:
                    yield RenderRequest.from_data(data)


def _inodes(folder: Path) -> Iterator[tuple[int, int]]:
    for path in folder.rglob("*"):
        with contextlib.suppress(OSError):
            facts = path.stat()
            yield facts.st_dev, facts.st_ino


def _forget_runs(root: Path, keep: int) -> None:
    """The plans, event logs and messages of all but the last runs."""
    for folder in (PLANS, EVENTS, LOGS):
        for path in sorted((root / folder).glob("2*"))[:-keep]:
            with contextlib.suppress(OSError):
                for inner in path.glob("*") if path.is_dir() else ():
                    inner.unlink()
                path.rmdir() if path.is_dir() else path.unlink()
