"""Is what the store holds what its names say? Every file is decoded to its end and its key compared.

Meshes carry checksums (CRC-32) and pictures those of their compression (Adler-32), so that a flipped bit is
found; a movie is decoded whole.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.production.keys.digest import Key
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store import readers
from pipeline.production.store.store import CorruptFileError, Store
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
"""By kind, what reads a file of a key whole."""


@dataclass(frozen=True)
class Checked:
    """A file of the store; `fault` is what is wrong with it, if anything."""

    kind: str
    key: Key
    path: Path
    fault: str | None


@dataclass(frozen=True)
class Damage:
    """What of a take's files is faulty: its meshes and its pictures, by number, and its movie."""

    request: RenderRequest
    meshes: tuple[int, ...]
    pictures: tuple[int, ...]
    movie: bool


def damages(
    requests: Iterable[RenderRequest], store: Store, faulty: Collection[tuple[str, Key]]
) -> Iterator[Damage]:
    """What of takes is among faulty files, by kind and key; found before these are forgotten."""
    for request in requests:
        meshes = [
            n for n, angle in request.angles.items() if ("mesh", request.mesh_key(angle.mesh)) in faulty
        ]
        keys = request.picture_keys(store)
        if keys is None:
            yield Damage(request, tuple(meshes), (), False)
            continue
        shown = [n for n in request.angles if {("raw", keys[n].raw), ("frame", keys[n].frame)} & set(faulty)]
        movie = ("movie", request.movie_key([keys[n].frame for n in sorted(request.angles)])) in faulty
        yield Damage(request, tuple(meshes), tuple(shown), movie)


def verified(store: Store, threads: int) -> Iterator[Checked]:
    """Every file of the store, looked at; changes nothing."""
    with ThreadPoolExecutor(threads) as pool:
        yield from pool.map(lambda entry: _checked(*entry), store.entries())


def _checked(kind: str, key: Key, path: Path) -> Checked:
    try:
        READERS[kind](key)(path)
    except (CorruptFileError, RenderError, OSError) as error:
        return Checked(kind, key, path, str(error).removeprefix(f"{path}: "))
    return Checked(kind, key, path, None)
