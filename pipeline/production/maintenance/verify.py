"""Verify the store: decode every file to its end, and compare its key with its name.

Meshes carry checksums (CRC-32), and pictures those of their compression (Adler-32): a flipped bit is found.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pipeline.production.execution.project import Project
from pipeline.production.planning.plan import Plan
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store import readers
from pipeline.production.store.store import CorruptFileError, Key, Store
from render.base.errors import RenderError
from render.movie.probe import probe_movie
from render.post.image import read_png


def _json(path: Path) -> object:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise CorruptFileError(f"{path}: {error}") from error


READERS: dict[str, Callable[[Key], Callable[[Path], Any]]] = {
    "mesh": readers.mesh_frame,
    "normals": readers.arrays,
    "cameras": lambda key: _json,
    "raw": readers.picture,
    "frame": readers.picture,
    **dict.fromkeys(("movie", "mov", "mkv", "webp"), lambda key: probe_movie),
    "png": lambda key: read_png,
    "png16": lambda key: read_png,
    "jpeg": lambda key: read_png,
    "measures": lambda key: _json,
}
"""Readers that read a whole file of a key, by kind."""


@dataclass(frozen=True)
class StoredFile:
    """A file of the store; `fault` says what is wrong with it, if anything."""

    kind: str
    key: Key
    path: Path
    fault: str | None


@dataclass(frozen=True)
class Damage:
    """The damaged files of a request: the numbers of its meshes and pictures, and its movie."""

    request: RenderRequest
    meshes: tuple[int, ...]
    pictures: tuple[int, ...]
    movie: bool


def verify(store: Store, threads: int) -> Iterator[StoredFile]:
    """Read every file of the store and yield it with its fault; change nothing."""
    with ThreadPoolExecutor(threads) as pool:
        yield from pool.map(lambda entry: _verified(*entry), store.entries())


def _verified(kind: str, key: Key, path: Path) -> StoredFile:
    try:
        READERS[kind](key)(path)
    except (CorruptFileError, RenderError, OSError) as error:
        return StoredFile(kind, key, path, str(error).removeprefix(f"{path}: "))
    return StoredFile(kind, key, path, None)


def damages(
    requests: Iterable[RenderRequest], store: Store, faulty: Collection[tuple[str, Key]]
) -> Iterator[Damage]:
    """Yield what requests lose by faulty files, given by kind and key. Call it before these are evicted."""
    for request in requests:
        angles, keys = request.angles, request.picture_keys(store)
        meshes = tuple(n for n, angle in angles.items() if ("mesh", request.mesh_key(angle.mesh)) in faulty)
        if keys is None:
            yield Damage(request, meshes, (), False)
            continue
        pictures = (n for n in angles if {("raw", keys[n].raw), ("frame", keys[n].frame)} & set(faulty))
        movie = ("movie", request.movie_key([keys[n].frame for n in sorted(angles)])) in faulty
        yield Damage(request, meshes, tuple(pictures), movie)


def repairs(project: Project, damages: Iterable[Damage]) -> Plan:
    """Return the plan that makes damaged files again."""
    planner = project.planner()
    for damage in damages:
        if damage.meshes:
            planner.simulate(replace(damage.request, requested=damage.meshes))
        if damage.pictures:
            planner.pictures(replace(damage.request, requested=damage.pictures))
        if damage.movie:
            planner.pictures(damage.request.whole())
            planner.movie(damage.request.whole())
    return planner.plan()
