"""Verify the store, by decoding every file to its end, and published versions, by their digests.

Meshes carry checksums (CRC-32), and pictures those of their compression (Adler-32): a flipped bit is found.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any

from pipeline.errors import MissingInputError
from pipeline.frames import FrameRange
from pipeline.production.execution.project import Project
from pipeline.production.planning.plan import Plan
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store import readers
from pipeline.production.store.paths import PUBLISHED, repeated
from pipeline.production.store.store import CorruptFileError, Key, Store
from pipeline.production.versions.provenance import FILE, Provenance, records
from pipeline.shot.yaml.lookup import is_there
from render.base.errors import RenderError
from render.base.input_files import digest_of_file
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


# Published versions


@dataclass(frozen=True)
class PublishedFile:
    """A file of a version, at `path`.

    record  what the version was made from; None for a provenance that cannot be read
    number  its frame number; None if it is no frame
    digest  SHA-256 that it had when it was published
    fault   what is wrong with it, if anything
    """

    path: Path
    record: Provenance | None
    number: int | None = None
    digest: str = ""
    fault: str | None = None

    @property
    def version(self) -> Path:
        """The folder of its version."""
        return self.path.parents[0 if self.number is None else 1]


def published_files(root: Path) -> Iterator[PublishedFile]:
    """Yield the files of all versions under a root, unchecked, and each provenance that cannot be read."""
    for home in sorted((root / PUBLISHED).glob("*")):
        for place, record in records(home):
            if isinstance(record, Provenance):
                for number, frame in record.frames.items():
                    yield PublishedFile(place / frame.file, record, number, frame.sha256)
                yield PublishedFile(place / record.movie["file"], record, None, record.movie["sha256"])
            else:
                yield PublishedFile(place / FILE, None, fault=str(record).removeprefix(f"{place / FILE}: "))


def checked(files: Iterable[PublishedFile], threads: int) -> Iterator[PublishedFile]:
    """Yield the files with their faults. Nothing is repaired: people say what replaces a published file."""
    with ThreadPoolExecutor(threads) as pool:
        yield from pool.map(lambda file: replace(file, fault=file.fault or _fault(file)), files)


def remedies(faulty: Iterable[PublishedFile], root: Path) -> Iterator[str]:
    """Yield a line for each version among faulty files that says how to make its files again."""
    for version, files in groupby(faulty, key=lambda file: file.version):
        damaged = list(files)
        record, numbers = damaged[0].record, [file.number for file in damaged if file.number is not None]
        if record is None:
            yield f"{version}: nothing but its {FILE} tells what it was made from; restore that from a backup"
            continue
        only_frames = f" -f {FrameRange.of(numbers)}" if len(numbers) == len(damaged) else ""
        yield (
            f"{version}: flowsculpt render --from {version / FILE}{only_frames} makes it again, in "
            f"{root / repeated(record.shot, record.version)}; published files are never written to"
        )


def _fault(file: PublishedFile) -> str | None:
    if not is_there(file.path):
        return "is gone, and was published"
    try:
        digest = digest_of_file(file.path)
    except MissingInputError as error:
        return str(error).removeprefix(f"{file.path}: ")
    return None if digest == file.digest else "is not what was published: damaged, or altered since"
