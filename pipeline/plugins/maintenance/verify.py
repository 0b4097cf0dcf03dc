"""Verify all that was written, by digests: the store, the files that are shown, and published versions."""

from __future__ import annotations

import errno
import os
import shlex
from collections.abc import Collection, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from itertools import groupby
from pathlib import Path

from flowsculpt import MachineError, MissingInputError
from flowsculpt.api import ShotExtras
from flowsculpt.api.files import InputFile
from flowsculpt.api.frames import (
    Folders,
    FrameRange,
    PublishedVersion,
    Store,
    StoredFiles,
)


@dataclass(frozen=True)
class StoredFile:
    """A file of the store.

    fault       what is wrong with it, if anything
    has_digest  whether its digest is known; if not, it was decoded
    refusal     why it, or its digest, could not be read, and so may be whole; None where it was
    """

    kind: str
    key: str
    path: Path
    fault: str | None
    has_digest: bool = True
    refusal: str | None = None


@dataclass(frozen=True)
class ShownFile:
    """A file outside of the store, with `fault` and `refusal` as `StoredFile` has them."""

    path: Path
    fault: str | None
    refusal: str | None = None


_DAMAGE = (None, errno.EIO, errno.ENOENT, errno.ENOTDIR)
"""Error numbers of files that are damaged or gone; None of libraries, for what they cannot decode. Others say
that a file may not be read, or not now."""


def _refusal(path: Path, error: Exception) -> str | None:
    """Return in words why the operating system refuses a file; None for errors that mean damage."""
    if not isinstance(error, OSError) or error.errno in _DAMAGE:
        return None
    return str(MachineError.of_path(Path(error.filename or path), error, "read"))


def refused_folders(root: Path) -> Iterator[str]:
    """Yield a message for each folder of the store, of digests and of renders/ that cannot be listed."""
    errors: list[OSError] = []
    folders = Folders.of_root(root)
    for folder in (folders.state / "store", folders.digests, folders.renders):
        for _ in os.walk(folder, onerror=errors.append):
            pass
    for error in errors:
        if message := _refusal(Path(error.filename), error):
            yield message


def verify(store: Store, threads: int) -> Iterator[StoredFile]:
    """Check every file of the store and yield it with its fault; change nothing."""
    with ThreadPoolExecutor(threads) as pool:
        yield from pool.map(lambda entry: verify_stored(store, *entry), store.entries())


def verify_stored(store: Store, kind: str, key: str, path: Path) -> StoredFile:
    """Check a stored file by its digest; one without, made before there were digests, is decoded."""
    try:
        has_digest = store.digests.check(path)
        if not has_digest:
            StoredFiles(kind).reader(key)(path)
    except Exception as error:  # libraries raise all kinds for what is damaged
        refusal = _refusal(path, error)
        fault = str(error).removeprefix(f"{path}: ") if refusal is None else None
        return StoredFile(kind, key, path, fault, refusal=refusal)
    return StoredFile(kind, key, path, None, has_digest)


def shown_with_digest(store: Store) -> list[Path]:
    """Return the files that have digests, wherever output was written to, but the store and versions."""
    apart = [Folders.of_root(store.root).state, *_of_versions(store.root)]
    folders = (f for f in store.digests.folders() if not any(map(f.is_relative_to, apart)))
    paths = (folder / name for folder in folders for name in sorted(store.digests.in_folder(folder)))
    return [path for path in paths if InputFile(path).is_there()]


def verify_shown(
    store: Store, stored: Iterable[StoredFile], paths: Iterable[Path], threads: int
) -> Iterator[ShownFile]:
    """Yield files outside of the store, each with its fault; change nothing.

    stored  the files of the store; links to them are not read again, and have no fault of their own
    """
    linked = {inode(file.path) for file in stored}

    def shown(path: Path) -> ShownFile:
        try:
            if inode(path) not in linked:
                store.digests.check(path)
        except (*StoredFiles.DAMAGED, OSError) as error:
            refusal = _refusal(path, error)
            return ShownFile(path, str(error).removeprefix(f"{path}: ") if refusal is None else None, refusal)
        return ShownFile(path, None)

    with ThreadPoolExecutor(threads) as pool:
        yield from pool.map(shown, paths)


def files_without_digest(store: Store, stored: Iterable[StoredFile]) -> list[Path]:
    """Return files in renders/ that cannot be checked: they have no digest, and are no links to the store."""
    linked = {inode(file.path) for file in stored}

    @cache
    def known(folder: Path) -> Collection[str]:
        with suppress(OSError):  # which `verify_shown` says of each file
            return store.digests.in_folder(folder)
        return {path.name for path in folder.iterdir()}

    return [
        path
        for path in shown_files(store.root)
        if path.name not in known(path.parent) and inode(path) not in linked
    ]


def shown_files(root: Path) -> Iterator[Path]:
    """Yield the files in renders/, but those of versions."""
    apart = _of_versions(root)
    for path in sorted(Folders.of_root(root).renders.rglob("*")):
        if InputFile(path).is_there() and not any(map(path.is_relative_to, apart)):
            yield path


def roots(root: Path) -> list[Path]:
    """Return a root and those below it in which published versions were made again."""
    repeated = Folders.of_root(root).repeated.glob("*")
    return [root, *sorted(path for path in repeated if Folders.of_root(path).state.is_dir())]


def _of_versions(root: Path) -> list[Path]:
    """Return the folders of versions, which nothing repairs, and of roots that these are made again in."""
    folders = Folders.of_root(root)
    return [folders.published, folders.repeated]


def inode(path: Path) -> tuple[int, int]:
    """Return what links to one file have in common; a file that is gone has nothing in common."""
    try:
        facts = path.stat()
    except OSError:
        return -1, -1
    return facts.st_dev, facts.st_ino


# Published versions


@dataclass(frozen=True)
class PublishedFile:
    """A file of a version, at `path`.

    number  its frame number; None if it is no frame
    fault   what is wrong with it, if anything
    """

    version: PublishedVersion
    path: Path
    number: int | None = None
    fault: str | None = None

    @property
    def folder(self) -> Path:
        """The folder of its version."""
        return self.version.record.parent


def published_files(store: Store) -> Iterator[PublishedFile]:
    """Yield the files of all versions under a root, unchecked, and each provenance that is damaged."""
    for extras in ShotExtras.of_plugins().values():
        for version in extras.versions(store.root):
            fault = _fault_of_record(store, version.record) or version.fault
            if fault:  # its digests of frames may be wrong
                yield PublishedFile(version, version.record, fault=fault)
                continue
            numbers = {path: number for number, path in version.frames.items()}
            for path in version.files:
                yield PublishedFile(version, path, numbers.get(path))


def _fault_of_record(store: Store, path: Path) -> str | None:
    try:
        store.digests.check(path)
    except OSError as error:
        return str(MachineError.of_path(path, error, "read")).removeprefix(f"{path}: ")
    except StoredFiles.DAMAGED as error:
        return str(error).removeprefix(f"{path}: ")
    return None


def checked(files: Iterable[PublishedFile], threads: int) -> Iterator[PublishedFile]:
    """Yield the files with their faults. Nothing is repaired: people say what replaces a published file."""
    with ThreadPoolExecutor(threads) as pool:
        yield from pool.map(lambda file: replace(file, fault=file.fault or _fault(file)), files)


def remedies(faulty: Iterable[PublishedFile], root: Path) -> Iterator[str]:
    """Yield a line for each version among faulty files that says how to make its files again."""
    for version, files in groupby(faulty, key=lambda file: file.version):
        record, folder = version.record, version.record.parent
        damaged = [file for file in files if file.path != version.notes]
        if not damaged:
            notes = Folders.of_root(root).notes
            yield f"{folder}: restore its notes from a backup; the current notes are in {notes}"
        elif damaged[0].path == record:
            yield (
                f"{folder}: only its {record.name} records what it was made from; restore that file from a "
                "backup"
            )
        else:
            numbers = [file.number for file in damaged if file.number is not None]
            only_frames = f" -f {FrameRange.of(numbers)}" if len(numbers) == len(damaged) else ""
            again = Folders.of_root(root).repeated / f"{version.shot}.{version.name}"
            yield (
                f"{folder}: flowsculpt reproduce {shlex.quote(str(record))}{only_frames} makes it again, in "
                f"{again}; published files are never written to"
            )


def _fault(file: PublishedFile) -> str | None:
    try:
        file.path.stat()
        digest = InputFile(file.path).digest()
    except FileNotFoundError:
        return "is gone, and was published"
    except OSError as error:
        return str(MachineError.of_path(file.path, error, "read")).removeprefix(f"{file.path}: ")
    except MissingInputError as error:
        return str(error).removeprefix(f"{file.path}: ")
    return (
        None
        if digest == file.version.files[file.path]
        else "differs from the published file: damaged, or altered since"
    )
