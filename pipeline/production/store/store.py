"""The content-addressed store: every file a key, every file written once and never changed.

Snakemake deletes a job's declared outputs before the job runs and after it fails, so those outputs
are links; the store is what survives. A file appears under its name whole or not at all: it is written
in `tmp/` beside the store, synced, made read-only and renamed into place.
"""

from __future__ import annotations

import contextlib
import os
import platform
import shutil
import time
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from pipeline.production.keys.digest import Key
from pipeline.production.store.paths import STATE
from render.base.atomic_write import disk_errors


class CorruptFileError(Exception):
    """A file of the store that cannot be read to its end, or says what cannot be."""


SUFFIXES = {
    "mesh": ".npz",
    "normals": ".npz",
    "cameras": ".json",
    "raw": ".exr",
    "frame": ".exr",
    "movie": ".mp4",
    "mov": ".mov",
    "mkv": ".mkv",
    "webp": ".webp",
    "png": ".png",
    "png16": ".png",
    "jpeg": ".jpg",
    "measures": ".json",
}


ENDS = 65536
"""Bytes at each end of a file that tell it from others of its size: pictures have their keys near the
beginning, npz ends with a checksum of every array."""

OLD_DRAFT = 24 * 3600.0
"""Seconds after which what another host was writing is taken for left behind."""


@dataclass(frozen=True)
class Store:
    """The store of one root folder; `root/.flowsculpt/` holds it."""

    root: Path

    @property
    def scratch(self) -> Path:
        return self.root / STATE / "tmp"

    def path(self, kind: str, key: Key) -> Path:
        return Path(self._name(kind, key))

    def _name(self, kind: str, key: Key) -> str:
        return f"{self.root}/{STATE}/store/{kind}/{key[:2]}/{key}{SUFFIXES[kind]}"

    def holds(self, kind: str, key: Key | None) -> bool:
        return key is not None and os.path.exists(self._name(kind, key))  # noqa: PTH110  # a Path is slow to make

    def entries(self) -> Iterator[tuple[str, Key, Path]]:
        """Every file that is there: its kind, its key, and where it lies."""
        for kind, suffix in SUFFIXES.items():
            for path in sorted((self.root / STATE / "store" / kind).glob(f"*/*{suffix}")):
                yield kind, path.stem, path

    def draft(self, suffix: str = "") -> Path:
        """Where this process may write what is not whole yet: the name says whose it is."""
        return self.scratch / f"{platform.node()}+{os.getpid()}+{uuid.uuid4().hex}{suffix}"

    def put(self, kind: str, key: Key, write: Callable[[Path], object]) -> Path:
        """Have `write(path)` make the file of `key`, unless it is there already; returns where it lies.

        Raises MachineError where the disk refuses; nothing half-written is left.
        """
        final = self.path(kind, key)
        if final.exists():
            return final
        draft = self.draft(SUFFIXES[kind])
        with disk_errors(final):
            try:
                draft.parent.mkdir(parents=True, exist_ok=True)
                final.parent.mkdir(parents=True, exist_ok=True)
                write(draft)
                _sync(draft)
                draft.chmod(0o444)
                draft.replace(final)
            finally:
                draft.unlink(missing_ok=True)
        return final

    def link(self, kind: str, key: Key, target: Path) -> None:
        """Show the file of `key` at `target` under the root: a hard link, or a copy where none can be."""
        if self.shows(kind, key, target):
            return
        source, place = self.path(kind, key), self.root / target
        draft = self.draft()
        with disk_errors(place):
            try:
                place.parent.mkdir(parents=True, exist_ok=True)
                draft.parent.mkdir(parents=True, exist_ok=True)
                try:
                    os.link(source, draft)
                    draft.replace(place)
                except OSError:
                    draft.unlink(missing_ok=True)
                    beside = place.with_name(f".{draft.name}.tmp")
                    try:
                        shutil.copy2(source, beside)
                        beside.replace(place)
                    finally:
                        beside.unlink(missing_ok=True)
            finally:
                draft.unlink(missing_ok=True)

    def shows(self, kind: str, key: Key | None, target: Path) -> bool:
        """Whether `target` is the file of `key`: the same inode, or a copy by its size and both ends.

        Times tell nothing: clocks of hosts differ, and Snakemake sets the times of what it has checked.
        """
        if key is None:
            return False
        ours, theirs = self.path(kind, key), self.root / target
        try:
            one, other = ours.stat(), theirs.stat()
            if os.path.samestat(one, other):
                return True
            return one.st_size == other.st_size and _ends(ours, one.st_size) == _ends(theirs, one.st_size)
        except OSError:
            return False

    def discard(self, kind: str, key: Key) -> None:
        """Forget a file found to be corrupt; it is made anew when next asked for."""
        with disk_errors(self.path(kind, key)):
            self.path(kind, key).unlink(missing_ok=True)

    def sweep(self) -> None:
        """Remove what killed processes left in `tmp/`: of this host what nobody writes to, of others what is
        old. A farm's nodes may be at work though nobody holds the root's lock."""
        with contextlib.suppress(OSError):
            for path in sorted(self.scratch.iterdir()):
                if _left_behind(path):
                    path.unlink(missing_ok=True)
            self.scratch.rmdir()


def _left_behind(draft: Path) -> bool:
    host, _, rest = draft.name.lstrip(".").partition("+")  # a writer's own draft of it begins with a point
    number = rest.partition("+")[0]
    if host == platform.node() and number.isdecimal():
        return int(number) == os.getpid() or not _lives(int(number))
    return not number or time.time() - draft.stat().st_mtime > OLD_DRAFT


def _lives(process: int) -> bool:
    """A zombie writes nothing any more."""
    import psutil  # which most processes never need

    with contextlib.suppress(psutil.Error):
        return bool(psutil.Process(process).status() != psutil.STATUS_ZOMBIE)
    return False


def _ends(path: Path, size: int) -> bytes:
    """The first and the last bytes of a file."""
    with path.open("rb") as file:
        first = file.read(ENDS)
        file.seek(max(ENDS, size - ENDS))
        return first + file.read(ENDS)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
