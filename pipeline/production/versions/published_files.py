"""The files of published versions: frozen all at once, read-only, and checked against their digests."""

from __future__ import annotations

import json
import os
import shutil
import uuid
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

from pipeline.errors import MissingInputError
from pipeline.frames import FrameRange
from pipeline.production.store.paths import PUBLISHED, repeated
from pipeline.production.store.store import Store
from pipeline.production.versions.provenance import FILE, Provenance, records
from pipeline.shot.yaml.lookup import digest_of_file, is_there
from render.base.atomic_write import disk_errors

_DRAFT = ".draft."


def freeze(store: Store, record: Provenance, final: Path, copy: bool = False) -> None:
    """Lay the frames and the movie of a version at `final`, and its provenance beside them.

    Frames are links to the files of the store, which take no space. They are copies where links fail, and
    with `copy`. The movie is a copy: the store's stays writable, for Snakemake makes no protected file again.

    Raises MachineError where the disk refuses; then nothing is left of it.
    """
    draft = final.with_name(f"{_DRAFT}{final.name}.{uuid.uuid4().hex[:8]}")
    freeze_frame = _copy if copy else _link
    with disk_errors(final):
        try:
            for frame in record.frames.values():
                freeze_frame(store.path("frame", frame.frame), draft / frame.file)
            _copy(store.path("movie", record.movie["key"]), draft / record.movie["file"])
            text = json.dumps(record.as_data(), indent=1, ensure_ascii=False)
            (draft / FILE).write_text(text + "\n", encoding="utf-8")
            _settle(draft / FILE)
            draft.rename(final)
        finally:
            shutil.rmtree(draft, ignore_errors=True)


def sweep(home: Path) -> None:
    """Remove drafts of killed processes. Only the holder of the lock may call this."""
    for draft in home.glob(f"{_DRAFT}*"):
        shutil.rmtree(draft, ignore_errors=True)


def _link(source: Path, place: Path) -> None:
    """Link a file, which is read-only as the store's is."""
    place.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(source, place)
    except OSError:
        _copy(source, place)


def _copy(source: Path, place: Path) -> None:
    place.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy2(source, place)
    _settle(place)


def _settle(place: Path) -> None:
    """Make a file read-only and flush it to the disk."""
    place.chmod(0o444)
    with place.open("rb") as file:
        os.fsync(file.fileno())


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
        yield from pool.map(_checked, files)


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


def _checked(file: PublishedFile) -> PublishedFile:
    return replace(file, fault=file.fault or _fault(file))


def _fault(file: PublishedFile) -> str | None:
    if not is_there(file.path):
        return "is gone, and was published"
    try:
        digest = digest_of_file(file.path)
    except MissingInputError as error:
        return str(error).removeprefix(f"{file.path}: ")
    return None if digest == file.digest else "is not what was published: damaged, or altered since"
