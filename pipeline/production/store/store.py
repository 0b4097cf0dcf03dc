"""The input-addressed store: every file has a key, is written once and never changed.

A key is a digest of all that a file is made from, so two files with the same key hold the same content,
wherever and whenever they were made. What does not change the content (a comment, the order of a YAML
mapping, a file's time) must stay out of it.

Snakemake deletes a job's declared outputs before the job runs and after it fails, so those outputs
are links; the store is what survives. A file appears under its name whole or not at all: it is written
in the store's `tmp/`, flushed, made read-only and renamed into place. Its digest is recorded before, and
compared whenever the file is read: `digests.py`.

Where a remote store is named, which several roots share, files that it has count as held, and are fetched
when they are needed (`bring`); what is put here is uploaded: `remote_store.py`. A file is marked in
`.flowsculpt/uploads/` before it is sent, and the mark goes once the remote store has it. So the next run
knows what is still to be sent without comparing two stores, also after a process was killed.

Unfinished files are drafts in `tmp/`, of the root and of the store, and checkpoints, which hold the sums of
samples of unfinished pictures. A checkpoint is named after the place and the key of its picture, so one of
another look, camera or version is never resumed.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import shutil
import stat
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeVar

from flowsculpt.pipeline.errors import FrameError, MachineError
from flowsculpt.pipeline.production.store.digests import CorruptFileError, Digests, digest_of
from flowsculpt.pipeline.production.store.paths import CHECKPOINTS, STATE, STORE, SUFFIXES
from flowsculpt.pipeline.production.store.remote_store import (
    LOG,
    SIDE_BY_SIDE,
    RemoteStore,
    is_read_only,
    remote_stores,
    store_url,
)
from flowsculpt.render.base.atomic_write import atomic_write, disk_errors
from flowsculpt.render.base.drafts import disk_time, draft_name, sweep_drafts
from flowsculpt.render.base.plural import plural
from flowsculpt.render.base.render_errors import CorruptImageError, FlowsculptError, MissingImageError
from flowsculpt.render.base.root_files import guard, held, remove_file, touch

if TYPE_CHECKING:
    from flowsculpt.render.frame.checkpoint import Checkpoint


T = TypeVar("T")

Key = str
"""The SHA-256 of canonical JSON (sorted names, shortest round-trip numbers), cut to 128 bits."""

Name = tuple[str, Key]
"""The kind and the key of a stored file."""

UPLOADS = STATE / "uploads"
"""The folder of marks of files that are sent to the remote store."""

_CANONICAL = json.JSONEncoder(sort_keys=True, separators=(",", ":"), allow_nan=False)


def key_of(*parts: Any) -> Key:
    """The key of plain data: None, bool, int, float, str, lists, tuples and mappings of these.

    Raises TypeError for anything else, and ValueError for NaN or infinity, which JSON cannot say.
    """
    return hashlib.sha256(_CANONICAL.encode(parts).encode()).hexdigest()[:32]


DAMAGED = (CorruptFileError, CorruptImageError, MissingImageError, FileNotFoundError)
"""Errors that readers raise for a file that must be made again."""


ENDS = 65536
"""Bytes at each end of a file that are compared with those of another of its size: pictures have their keys
near the beginning, npz ends with a checksum of every array."""


@dataclass(frozen=True)
class Store:
    """The store of one root folder, in `root/.flowsculpt/`.

    url  the address of the remote store behind it, by default what the environment names; None for none
    """

    root: Path
    url: str | None = field(default_factory=store_url)

    COPIED: ClassVar[tuple[str, ...]] = ("movie", "mov", "mkv", "webp", "avif", "gif")
    """Kinds that are shown as copies, for people to edit and hand on; others are read-only links."""

    def __post_init__(self) -> None:
        guard(self.root)

    @property
    def remote(self) -> RemoteStore | None:
        """The remote store. Raises UsageError and MachineError for an address that cannot be used."""
        return None if self.url is None else remote_stores().opened(self.url)

    @property
    def may_upload(self) -> bool:
        """True if there is a remote store, and the user does not keep us from writing to it."""
        return self.url is not None and not is_read_only()

    @property
    def scratch(self) -> Path:
        """The folder of drafts on the disk of the root."""
        return self.root / STATE / "tmp"

    @property
    def inner_scratch(self) -> Path:
        """The folder of drafts on the disk of the store, which may be another."""
        return self.root / STORE / "tmp"

    @property
    def digests(self) -> Digests:
        return Digests(self.root)

    def path(self, kind: str, key: Key) -> Path:
        return Path(self._name(kind, key))

    def _name(self, kind: str, key: Key) -> str:
        return f"{self._folder}/{kind}/{key[:2]}/{key}{SUFFIXES[kind]}"

    @cached_property
    def _folder(self) -> str:
        return f"{self.root}/{STORE}"

    def holds(self, kind: str, key: Key | None) -> bool:
        """Tell whether the file of `key` is here or in the remote store, and so need not be made."""
        if key is None:
            return False
        return self.is_here(kind, key) or (self.remote is not None and self.remote.holds(kind, key))

    def is_remote(self, kind: str, key: Key) -> bool:
        """Tell whether only the remote store has the file of `key`."""
        return self.remote is not None and not self.is_here(kind, key) and self.remote.holds(kind, key)

    def is_here(self, kind: str, key: Key) -> bool:
        """Tell whether the file of `key` is on this disk. A link in its place is not of ours."""
        try:
            return stat.S_ISREG(os.lstat(self._name(kind, key)).st_mode)  # a Path is slow to make
        except OSError:
            return False

    def stored_at(self, kind: str, key: Key) -> int:
        """Return when the file of `key` was stored here, nanoseconds since the epoch; 0 if it is not here."""
        return self.path(kind, key).stat().st_mtime_ns if self.is_here(kind, key) else 0

    def bring(self, kind: str, key: Key) -> bool:
        """Fetch the file of `key` if only the remote store has it; tell whether it is here.

        Raises MachineError where the disk refuses.
        """
        if self.is_here(kind, key):
            return True
        if self.remote is None or not self.remote.holds(kind, key):
            return False
        final = self.path(kind, key)
        with disk_errors(final), held(self.inner_scratch, make=True) as folder:
            draft = folder / self.draft(SUFFIXES[kind]).name
            try:
                with _named(draft, final):
                    digest = self.remote.fetch(kind, key, draft)
                if digest is None:
                    return False
                draft.chmod(STORED)
                self.digests.add_known(final, digest)
                with atomic_write(final, draft):
                    pass  # fetched already
            finally:
                with contextlib.suppress(OSError):
                    draft.unlink()
        return True

    def holds_whole(self, kind: str, key: Key) -> bool:
        """Bring the file of `key`, evict a damaged one, and tell whether it is here. Raises as `bring`."""
        if self.bring(kind, key) and not self.is_whole(self.path(kind, key)):
            self.discard(kind, key)
        return self.bring(kind, key)

    def bring_all(self, names: Collection[tuple[str, Key]]) -> int:
        """Fetch files that are not here, given by kind and key, side by side; return how many came."""
        LOG.info(f"Fetching {plural(len(names), 'file')} from {self.url}")
        with ThreadPoolExecutor(SIDE_BY_SIDE) as pool:
            return sum(pool.map(lambda name: self.bring(*name), names))

    def entries(self) -> Iterator[tuple[str, Key, Path]]:
        """Yield kind, key and path of every stored file."""
        for kind, suffix in SUFFIXES.items():
            for path in sorted((self.root / STORE / kind).glob(f"*/*{suffix}")):
                yield kind, path.stem, path

    def free_bytes(self) -> int:
        """Return the bytes that are free on the disk of the store."""
        folder = self.root / STORE
        return shutil.disk_usage(next(f for f in (folder, *folder.parents) if f.exists())).free

    def draft(self, suffix: str = "") -> Path:
        """Return a new path for an unfinished file, named after the host and the process."""
        return self.scratch / draft_name(suffix)

    def put(self, kind: str, key: Key, write: Callable[[Path], object], replace: bool = False) -> Path:
        """Make the file of `key` by `write(path)`, unless it is there; return its path.

        What is made is uploaded to the remote store, if there is one.

        replace  make it even if it is there

        Raises MachineError where the disk refuses; nothing half-written is left.
        """
        final = self.path(kind, key)
        if not replace and (self.holds_whole if kind in self.COPIED else self.bring)(kind, key):
            return final
        with atomic_write(final, self.inner_scratch / self.draft(SUFFIXES[kind]).name) as draft:
            with _named(draft, final):
                write(draft)
            draft.chmod(STORED)
            digest = self.digests.add(final, draft)
        upload(self, (kind, key), digest, replace)
        return final

    def write(self, path: Path, write: Callable[[Path], object], flush: bool = True) -> str:
        """Write a file that is shown and not stored by `write(draft)`, whole or not at all.

        Return its digest.

        flush  as `atomic_write` takes it

        Raises MachineError where the disk refuses.
        """
        with atomic_write(path, flush=flush) as draft:
            with _named(draft, path):
                write(draft)
            return self.digests.add(path, draft)

    def link(self, kind: str, key: Key, target: Path, replace: bool = False) -> None:
        """Show the file of `key` at `target` under the root.

        It is a copy for COPIED kinds. Else it is a hard link, a symbolic link where the store is on another
        disk, a copy where links fail.

        replace  link it even if `target` seems to show it

        Raises FrameError where the remote store alone had the file, and has lost it.
        """
        if not replace and self.shows(kind, key, target) and self._is_same(kind, key, target):
            return
        if self.remote is not None and not self.bring(kind, key):
            raise FrameError(f"{target} could not be fetched from {self.url}; run again to make it again")
        source, place = self.path(kind, key), self.root / target
        self.digests.add_copy(place, source)
        if kind in self.COPIED:
            with atomic_write(place, flush=False) as draft:
                _copy(source, draft)
            return
        try:
            with atomic_write(place, self.draft(), flush=False) as draft:
                draft.hardlink_to(source)
        except MachineError:
            with atomic_write(place, flush=False) as draft:
                _link_or_copy(source, draft)

    def shows(self, kind: str, key: Key | None, target: Path | str) -> bool:
        """Tell whether `target` is the file of `key`: the same inode, or a copy by its size and both ends.

        Of COPIED kinds the same inode shows nothing: what is written to it would damage the store.
        Times tell nothing: clocks of hosts differ, and Snakemake sets the times of what it has checked.
        """
        if key is None:
            return False
        ours, theirs = self._name(kind, key), f"{self.root}/{target}"
        try:
            one, other = os.stat(ours), os.stat(theirs)  # noqa: PTH116  # a Path is slow to make
            if os.path.samestat(one, other):
                return kind not in self.COPIED
            return one.st_size == other.st_size and _ends(ours, one.st_size) == _ends(theirs, one.st_size)
        except OSError:
            return False

    def _is_same(self, kind: str, key: Key, target: Path) -> bool:
        """Compare a file that shows that of `key` with it, byte by byte unless they are one."""
        source, place = self.path(kind, key), self.root / target
        return place.samefile(source) or digest_of(place) == digest_of(source)

    def read(self, kind: str, key: Key, target: Path, reader: Callable[[Path], T]) -> T:
        """Read the file of `key` whole; compare its digest.

        Evict a damaged one: where the remote store has a whole one, that is fetched and shown in its place,
        else the next run makes it again.

        target  where the file is shown, also for the message

        Raises FrameError where it is missing or damaged.
        """
        try:
            return self._read(kind, key, reader)
        except DAMAGED as error:
            damaged = FrameError(f"{target} is damaged; run again to make it again")
            damaged.__cause__ = error
            self.discard(kind, key)
        if self.remote is None or not self.bring(kind, key):
            raise damaged
        try:
            content = self._read(kind, key, reader)
        except DAMAGED:
            self.reject(kind, key)
            raise damaged from None
        if (self.root / target).exists():
            self.link(kind, key, target, replace=True)
        return content

    def _read(self, kind: str, key: Key, reader: Callable[[Path], T]) -> T:
        self.bring(kind, key)
        path = self.path(kind, key)
        self.digests.check(path)
        return reader(path)

    def is_whole(self, path: Path) -> bool:
        """Tell whether a shown file is there and, if its digest is known, has that."""
        try:
            self.digests.check(path)
        except (CorruptFileError, OSError):
            return False
        return path.is_file()

    def reject(self, kind: str, key: Key) -> None:
        """Evict a file that cannot be read though it is as it was written, from the remote store too."""
        self.discard(kind, key)
        if self.remote is not None and self.may_upload:
            self.remote.reject(kind, key)

    def discard(self, kind: str, key: Key) -> None:
        """Evict a damaged file; the next run that needs it makes it again."""
        with disk_errors(self.path(kind, key)):
            remove_file(self.path(kind, key))

    def upload_missed(self, others: Iterable[Name] = ()) -> Uploaded:
        """Send the files that are marked, and others. One that is gone or damaged loses its mark."""
        if not self.may_upload:
            return Uploaded(0, 0)

        def upload_one(name: Name) -> bool | None:
            """Return None for a file that is gone, damaged, or of unknown digest."""
            path = self.path(*name)
            try:
                digest = digest_of(path)
            except OSError:
                digest = ""
            if digest not in self.digests.known(path):
                remove_file(_mark(self.root, name))
                return None
            return upload(self, name, digest)

        with ThreadPoolExecutor(SIDE_BY_SIDE) as pool:
            outcomes = list(pool.map(upload_one, dict.fromkeys([*others, *missed_uploads(self.root)])))
        return Uploaded(outcomes.count(True), outcomes.count(False))


@contextlib.contextmanager
def _named(draft: Path, path: Path) -> Iterator[None]:
    """Let the messages of errors in the block name the file, not its draft."""
    try:
        yield
    except FlowsculptError as error:
        error.args = tuple(a.replace(str(draft), str(path)) if isinstance(a, str) else a for a in error.args)
        raise


def _link_or_copy(source: Path, draft: Path) -> None:
    """Show a stored file at a draft in a folder to which there may be no hard link.

    A symbolic link names the store from there, so that a show that is moved keeps it.
    """
    try:
        draft.hardlink_to(source)
    except OSError as error:
        if error.errno == errno.EXDEV:
            with contextlib.suppress(OSError):
                draft.symlink_to(os.path.relpath(source.absolute(), draft.parent.resolve()))
                return
        shutil.copy2(source, draft)


STORED = 0o444
"""Permissions of stored files."""


def _copy(source: Path, draft: Path) -> None:
    """Copy a file for people to write to; some disks share its blocks until one is written."""
    with contextlib.suppress(AttributeError, OSError), source.open("rb") as one, draft.open("wb") as other:
        while os.copy_file_range(one.fileno(), other.fileno(), 1 << 30):
            pass
    if not draft.exists() or draft.stat().st_size != source.stat().st_size:
        shutil.copyfile(source, draft)


def _ends(path: str, size: int) -> bytes:
    """Return the first and the last bytes of a file."""
    with Path(path).open("rb") as file:
        first = file.read(ENDS)
        file.seek(max(ENDS, size - ENDS))
        return first + file.read(ENDS)


KEPT_CHECKPOINT = 7 * 24 * 3600.0
"""Seconds for which a checkpoint is kept for a picture that nobody goes on with."""


def sweep(store: Store) -> None:
    """Remove drafts that killed processes left in `tmp/`, and checkpoints of no more use.

    A farm's nodes may be at work though nobody holds the root's lock. A checkpoint goes when its picture is
    done, or it is old.
    """
    for folder in (store.scratch, store.inner_scratch):
        sweep_drafts(folder)
    oldest = disk_time(store.scratch) - KEPT_CHECKPOINT
    for path in _checkpoints(store):
        with contextlib.suppress(OSError):
            if store.is_here("raw", path.stem.rpartition(".")[2]) or path.stat().st_mtime < oldest:
                remove_file(path)


def checkpoint_of(
    store: Store, target: Path, key: Key, warn: Callable[[str], None], urgent: Callable[[], bool]
) -> Checkpoint:
    """Return the checkpoint of the picture of `key`, shown at `target`; remove those of other keys.

    warn, urgent  see `Checkpoint`
    """
    from flowsculpt.render.frame.checkpoint import Checkpoint

    path = shared_file(store, target, key)
    remove_checkpoints(store, [target], keep=path)
    return Checkpoint(path, store.draft(path.suffix), warn, urgent)


def shared_file(store: Store, target: Path, key: Key) -> Path:
    """Return the file by which jobs of a run share what they make of the raw picture shown at `target`.

    It goes with the checkpoints: when the run is done, or it is old.
    """
    return store.root / CHECKPOINTS / f"{_checkpoint_name(target)}.{key}.npz"


def remove_checkpoints(store: Store, targets: Iterable[Path], keep: Path | None = None) -> None:
    """Remove the checkpoints of pictures that are shown at `targets`, whatever their keys, but `keep`."""
    paths = _checkpoints(store)
    names = {_checkpoint_name(target) for target in targets} if paths else set()
    for path in paths:
        if path != keep and path.stem.rpartition(".")[0] in names:
            with contextlib.suppress(OSError):
                remove_file(path)


def _checkpoints(store: Store) -> list[Path]:
    return sorted((store.root / CHECKPOINTS).glob("*.npz"))


def _checkpoint_name(target: Path) -> str:
    """Return `renders/A010/final/raw/A010.0040.exr` as one word."""
    return "+".join(target.with_suffix("").parts[1:])


class Uploaded(NamedTuple):
    """The outcome of uploads.

    sent    files that the remote store has now
    unsent  files that it did not accept
    """

    sent: int
    unsent: int


def upload(store: Store, name: Name, digest: str, replace: bool = False) -> bool:
    """Send a stored file to the remote store; return whether that has it now.

    Without one, or where it may only be read, do nothing.

    replace  remove other files of the key there

    Raises MachineError where the disk refuses the mark.
    """
    if store.remote is None or not store.may_upload:
        return False
    mark = _mark(store.root, name)
    with disk_errors(mark):
        touch(mark)
    sent = store.remote.send(*name, store.path(*name), digest, replace)
    if sent:
        remove_file(mark)
    return sent


def missed_uploads(root: Path) -> list[Name]:
    """Return the files that are marked, and so were not sent to their end."""
    folder = root / UPLOADS
    if not folder.is_dir():
        return []
    names = (path.name.partition(".") for path in sorted(folder.iterdir()))
    return [(kind, key) for kind, _, key in names if kind in SUFFIXES]


def _mark(root: Path, name: Name) -> Path:
    return root / UPLOADS / ".".join(name)
