"""The input-addressed store: every file has a key, is written once and never changed.

A key is a digest of all that a file is made from, so two files with the same key hold the same content,
wherever and whenever they were made. What does not change the content (a comment, the order of a YAML
mapping, a file's time) must stay out of it.

Snakemake deletes a job's declared outputs before the job runs and after it fails, so those outputs
are links; the store is what survives. A file appears under its name whole or not at all: it is written
in `tmp/` beside the store, flushed, made read-only and renamed into place. Its digest is recorded before, and
compared whenever the file is read: `digests.py`.

Checkpoints, the sums of samples of unfinished pictures, lie beside the store. Each is named after the place
and the key of its picture, so one of another look, camera or version is never resumed.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import platform
import shutil
import tempfile
import time
import uuid
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pipeline.errors import FrameError, MachineError
from pipeline.production.store.digests import CorruptFileError, Digests
from pipeline.production.store.paths import CHECKPOINTS, STATE
from render.base.atomic_write import atomic_write, disk_errors
from render.base.errors import CorruptImageError, FlowsculptError, MissingImageError

if TYPE_CHECKING:
    from render.frame.checkpoint import Checkpoint

T = TypeVar("T")

Key = str
"""The SHA-256 of canonical JSON (sorted names, shortest round-trip numbers), cut to 128 bits."""

_CANONICAL = json.JSONEncoder(sort_keys=True, separators=(",", ":"), allow_nan=False)


def key_of(*parts: Any) -> Key:
    """The key of plain data: None, bool, int, float, str, lists, tuples and mappings of these.

    Raises TypeError for anything else, and ValueError for NaN or infinity, which JSON cannot say.
    """
    return hashlib.sha256(_CANONICAL.encode(parts).encode()).hexdigest()[:32]


DAMAGED = (CorruptFileError, CorruptImageError, MissingImageError, FileNotFoundError)
"""Errors that readers raise for a file that must be made again."""


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


WRITABLE = ("movie",)
"""Kinds whose links are outputs of rules: Snakemake refuses to make a write-protected file again."""

ENDS = 65536
"""Bytes at each end of a file that are compared with those of another of its size: pictures have their keys
near the beginning, npz ends with a checksum of every array."""

OLD_DRAFT = 24 * 3600.0
"""Seconds after which a draft of another host counts as left behind."""

KEPT_CHECKPOINT = 7 * 24 * 3600.0
"""Seconds for which a checkpoint is kept for a picture that nobody goes on with."""


@dataclass(frozen=True)
class Store:
    """The store of one root folder, in `root/.flowsculpt/`."""

    root: Path

    @property
    def scratch(self) -> Path:
        return self.root / STATE / "tmp"

    @property
    def digests(self) -> Digests:
        return Digests(self.root)

    def path(self, kind: str, key: Key) -> Path:
        return Path(self._name(kind, key))

    def _name(self, kind: str, key: Key) -> str:
        return f"{self.root}/{STATE}/store/{kind}/{key[:2]}/{key}{SUFFIXES[kind]}"

    def holds(self, kind: str, key: Key | None) -> bool:
        return key is not None and os.path.exists(self._name(kind, key))  # noqa: PTH110  # a Path is slow to make

    def stored_at(self, kind: str, key: Key) -> int:
        """Return when the file of `key` was stored, nanoseconds since the epoch."""
        return self.path(kind, key).stat().st_mtime_ns

    def entries(self) -> Iterator[tuple[str, Key, Path]]:
        """Yield kind, key and path of every stored file."""
        for kind, suffix in SUFFIXES.items():
            for path in sorted((self.root / STATE / "store" / kind).glob(f"*/*{suffix}")):
                yield kind, path.stem, path

    def count(self) -> int:
        """Return how many files are stored."""
        return sum(1 for _ in self.entries())

    def draft(self, suffix: str = "") -> Path:
        """Return a new path for an unfinished file; its name tells the host and the process."""
        return self.scratch / f"{platform.node()}+{os.getpid()}+{uuid.uuid4().hex}{suffix}"

    def put(self, kind: str, key: Key, write: Callable[[Path], object], replace: bool = False) -> Path:
        """Make the file of `key` by `write(path)`, unless it is there; return its path.

        replace  make it even if it is there

        Raises MachineError where the disk refuses; nothing half-written is left.
        """
        final = self.path(kind, key)
        if final.exists() and not replace:
            return final
        with atomic_write(final, self.draft(SUFFIXES[kind])) as draft:
            with _named(draft, final):
                write(draft)
            draft.chmod(0o644 if kind in WRITABLE else 0o444)
            self.digests.add(final, draft)
        return final

    def write(self, path: Path, write: Callable[[Path], object], flush: bool = True) -> None:
        """Write a file that is shown and not stored by `write(draft)`, whole or not at all, with its digest.

        flush  as `atomic_write` takes it

        Raises MachineError where the disk refuses.
        """
        with atomic_write(path, flush=flush) as draft:
            with _named(draft, path):
                write(draft)
            self.digests.add(path, draft)

    def link(self, kind: str, key: Key, target: Path, replace: bool = False) -> None:
        """Show the file of `key` at `target` under the root: a hard link, or a copy if links fail.

        replace  link it even if `target` seems to show it
        """
        if not replace and self.shows(kind, key, target):
            return
        source, place = self.path(kind, key), self.root / target
        self.digests.add_copy(place, source)
        try:
            with atomic_write(place, self.draft(), flush=False) as draft:
                draft.hardlink_to(source)
        except MachineError:  # a file system without links, or another one than the store's
            with atomic_write(place, flush=False) as draft:
                shutil.copy2(source, draft)

    def shows(self, kind: str, key: Key | None, target: Path) -> bool:
        """Tell whether `target` is the file of `key`: the same inode, or a copy by its size and both ends.

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

    def read(self, kind: str, key: Key, target: Path, reader: Callable[[Path], T]) -> T:
        """Read the file of `key` whole; compare its digest. Evict a damaged one: the next run makes it again.

        target  where the file is shown, for the message

        Raises FrameError where it is missing or damaged.
        """
        path = self.path(kind, key)
        try:
            self.digests.check(path)
            return reader(path)
        except DAMAGED as error:
            self.discard(kind, key)
            raise FrameError(f"{target} is damaged; run again to make it again") from error

    def is_whole(self, path: Path) -> bool:
        """Tell whether a shown file is there and, if its digest is known, has that."""
        try:
            self.digests.check(path)
        except (CorruptFileError, OSError):
            return False
        return path.is_file()

    def discard(self, kind: str, key: Key) -> None:
        """Evict a damaged file; the next run that needs it makes it again."""
        with disk_errors(self.path(kind, key)):
            self.path(kind, key).unlink(missing_ok=True)

    def sweep(self) -> None:
        """Remove drafts that killed processes left in `tmp/`, and checkpoints of no more use.

        Those are drafts of dead processes of this host, and old ones of other hosts: a farm's nodes may be at
        work though nobody holds the root's lock. A checkpoint goes when its picture is done, or it is old.
        """
        now = self._disk_time()
        with contextlib.suppress(OSError):
            for path in sorted(self.scratch.iterdir()):
                if _left_behind(path, now):
                    path.unlink(missing_ok=True)
        oldest = now - KEPT_CHECKPOINT
        for path in self._checkpoints():
            with contextlib.suppress(OSError):
                if self.holds("raw", path.stem.rpartition(".")[2]) or path.stat().st_mtime < oldest:
                    path.unlink()

    def _disk_time(self) -> float:
        """Return the time by the clock that dates files, which may be a file server's."""
        try:
            with tempfile.TemporaryFile(dir=self.scratch) as file:
                return os.fstat(file.fileno()).st_mtime
        except OSError:
            return time.time()

    def checkpoint(
        self, target: Path, key: Key, warn: Callable[[str], None], urgent: Callable[[], bool]
    ) -> Checkpoint:
        """Return the checkpoint of the picture of `key`, shown at `target`; remove those of other keys.

        warn, urgent  see `Checkpoint`
        """
        from render.frame.checkpoint import Checkpoint

        path = self.root / CHECKPOINTS / f"{_checkpoint_name(target)}.{key}.npz"
        self.remove_checkpoints([target], keep=path)
        return Checkpoint(path, self.draft(path.suffix), warn, urgent)

    def remove_checkpoints(self, targets: Iterable[Path], keep: Path | None = None) -> None:
        """Remove the checkpoints of pictures that are shown at `targets`, whatever their keys, but `keep`."""
        names = {_checkpoint_name(target) for target in targets}
        for path in self._checkpoints():
            if path != keep and path.stem.rpartition(".")[0] in names:
                with contextlib.suppress(OSError):
                    path.unlink()

    def _checkpoints(self) -> list[Path]:
        return sorted((self.root / CHECKPOINTS).glob("*.npz"))


@contextlib.contextmanager
def _named(draft: Path, path: Path) -> Iterator[None]:
    """Let the messages of errors in the block name the file, not its draft."""
    try:
        yield
    except FlowsculptError as error:
        error.args = tuple(a.replace(str(draft), str(path)) if isinstance(a, str) else a for a in error.args)
        raise


def _checkpoint_name(target: Path) -> str:
    """Return `renders/A010/final/raw/A010.0040.exr` as one word."""
    return "+".join(target.with_suffix("").parts[1:])


def _left_behind(draft: Path, now: float) -> bool:
    host, _, rest = draft.name.lstrip(".").partition("+")  # a writer's own draft of it begins with a point
    number = rest.partition("+")[0]
    if host == platform.node() and number.isdecimal():
        return int(number) == os.getpid() or not _lives(int(number))
    return not number or now - draft.stat().st_mtime > OLD_DRAFT


def _lives(process: int) -> bool:
    """Tell whether a process may still write; a zombie does not."""
    import psutil  # which most processes never need

    with contextlib.suppress(psutil.Error):
        return bool(psutil.Process(process).status() != psutil.STATUS_ZOMBIE)
    return False


def _ends(path: Path, size: int) -> bytes:
    """Return the first and the last bytes of a file."""
    with path.open("rb") as file:
        first = file.read(ENDS)
        file.seek(max(ENDS, size - ENDS))
        return first + file.read(ENDS)
