"""The remote store: files of many roots in a bucket or on a file share, each under its key and its digest.

    PREFIX/frame/a/ab12….<digest of the content>.exr

The digest in the name says what the content must be, so a file that is truncated, damaged or of somebody else
is told from a whole one by whoever reads it, and writing takes one request. One listing of a kind of files
answers for all its keys; it is made of sixteen, side by side, by the first digit of the key.

Nothing here raises an error for what the remote store does. It is asked again for some seconds; then a
warning is logged, and for a minute, later longer, the answer to everything is that it holds nothing.
"""

from __future__ import annotations

import contextlib
import errno
import logging
import math
import os
import random
import re
import threading
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, TypeVar

from pipeline.production.store.digests import digest_of
from pipeline.production.store.remote_url import checked_url, open_url
from render.base.atomic_write import machine_error
from render.base.errors import MachineError

T = TypeVar("T")

LOG = logging.getLogger("flowsculpt.store")
"""Logger of warnings, which the command line and jobs pass on to the user."""

LISTED_SECONDS = 60.0
"""Seconds for which a listing counts: what others upload meanwhile is seen after these."""

PATIENCE = 5.0
"""Seconds for which a request that failed is tried again."""

FIRST_PAUSE = 0.25
"""Seconds before the second try; each further pause is twice as long."""

REQUEST_SECONDS = 300.0
"""Seconds that one request may take, the transfer of a file too: of 900 MB at 3 MB/s."""

SILENT_SECONDS = 60.0
"""Seconds for which a remote store that failed is left alone; twice as many each further time, up to
MAX_SILENT_SECONDS."""

MAX_SILENT_SECONDS = 3600.0

SIDE_BY_SIDE = 16
"""Requests that are made at once."""

_NAME = re.compile(r"([0-9a-f]{32})\.([0-9a-f]{32})\.\w+")

_BUCKETS = ("s3", "s3a", "gs", "gcs", "abfs", "abfss", "az", "adl", "oci", "oss", "memory")
"""Protocols of object stores, where a file appears whole or not at all. By others it is renamed into place,
and the folder of the address must be there."""

_LOCAL_FAULTS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)
"""Errors of the disk that a file is fetched to."""


class _UnreachableError(Exception):
    """The remote store does not answer, and has been told of."""


@dataclass(eq=False)
class RemoteStore:
    """The remote store at a checked address. One for each process and address: `RemoteStore.of`.

    files  the fsspec file system
    home   the path in it
    told   the warnings that this process has logged
    """

    url: str
    files: Any
    home: str
    told: set[str] = field(default_factory=set)
    _listed: dict[str, tuple[float, dict[str, list[str]]]] = field(default_factory=dict)
    _bad: set[str] = field(default_factory=set)
    _silent_until: float = 0.0
    _silence: float = SILENT_SECONDS
    _fault: str | None = None
    _listing_lock: threading.Lock = field(default_factory=threading.Lock)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @classmethod
    def of(cls, url: str) -> RemoteStore:
        """Return the remote store at an address, as the user gave it.

        Raises UsageError and MachineError for an address that cannot be used.
        """
        return _opened(url, os.getpid())

    # What it holds

    def holds(self, kind: str, key: str) -> bool:
        """Tell whether the remote store has a file of `key` that is not known to be damaged."""
        return bool(self._names(kind, key))

    def digests(self, kind: str) -> Mapping[str, Sequence[str]]:
        """Return the digests of all files of a kind, by key. Empty where the remote store does not answer."""
        known = self._listing(kind)
        return {key: [_digest_in(name) for name in names] for key, names in known.items()}

    def fault(self) -> str | None:
        """Ask the remote store for a listing; return what is wrong with it, or None."""
        with contextlib.suppress(_UnreachableError):
            if not self._tried(lambda: self._call("exists", self._bucket)):
                return _NO_FOLDER
            self._names_of("cameras")
        return self._fault

    def _names(self, kind: str, key: str) -> list[str]:
        return [name for name in self._listing(kind).get(key, ()) if name not in self._bad]

    def _listing(self, kind: str) -> dict[str, list[str]]:
        """Return the names of files of a kind by key, as of LISTED_SECONDS ago or later."""
        if time.monotonic() < self._silent_until:
            return {}
        with self._listing_lock:
            made, names = self._listed.get(kind, (-math.inf, {}))
            if time.monotonic() - made > LISTED_SECONDS:
                try:
                    names = self._names_of(kind)
                except _UnreachableError:
                    return {}
                self._listed[kind] = time.monotonic(), names
            return names

    def _names_of(self, kind: str) -> dict[str, list[str]]:
        """Ask for the names of all files of a kind, by key. Raises _UnreachableError."""
        found: dict[str, list[str]] = {}
        with ThreadPoolExecutor(SIDE_BY_SIDE) as pool:
            for paths in pool.map(self._ls, self._ls(f"{self.home}/{kind}")):
                for path in paths:
                    name = path.rpartition("/")[2]
                    if _NAME.fullmatch(name):
                        found.setdefault(name.partition(".")[0], []).append(name)
        return found

    def _ls(self, folder: str) -> list[str]:
        def ask() -> list[str]:
            try:
                return list(self._call("ls", folder, detail=False))
            except FileNotFoundError:  # nothing was put there yet
                self._require_folder()
                return []

        return self._tried(ask)

    # Files

    def fetch(self, kind: str, key: str, draft: Path) -> str | None:
        """Write the file of `key` to `draft`; return its digest, or None where there is no whole one.

        Raises MachineError where the disk of `draft` refuses.
        """
        with contextlib.suppress(_UnreachableError):
            for name in self._names(kind, key):
                for _ in range(2):  # damaged on the way, perhaps
                    if not self._tried(partial(self._get, self._place(kind, name), draft)):
                        break
                    if digest_of(draft) == _digest_in(name):
                        return _digest_in(name)
                else:
                    self._tell(
                        f"{self.url}: {kind}/{name[0]}/{name} is not what was stored: it is left alone, and "
                        "replaced once it is made again"
                    )
                self._bad.add(name)
        return None

    def _get(self, place: str, draft: Path) -> bool:
        """Write a remote file to `draft`; return whether it was there."""
        try:
            draft.parent.mkdir(parents=True, exist_ok=True)
            self._call("get_file", place, str(draft))
        except FileNotFoundError:
            return False
        except OSError as error:
            if error.errno in _LOCAL_FAULTS:
                raise machine_error(draft, error) from error
            raise
        return True

    def send(self, kind: str, key: str, path: Path, digest: str, replace: bool = False) -> bool:
        """Upload the file of `key`; return whether the remote store has it now.

        replace  remove other files of `key`
        """
        name = f"{key}.{digest}{path.suffix}"
        listed = self._listing(kind) if replace else self._listed.get(kind, (0.0, {}))[1]
        others = [other for other in listed.get(key, ()) if other != name]
        try:
            self._tried(lambda: self._put(path, self._place(kind, name)))
        except _UnreachableError:
            return False
        with self._lock:
            self._bad.discard(name)
            if kind in self._listed:
                known = self._listed[kind][1].setdefault(key, [])
                known += [name] if name not in known else []
        self._remove(kind, [other for other in others if replace or other in self._bad])
        return True

    def reject(self, kind: str, key: str) -> None:
        """Remove the files of `key`: they are what was sent, and cannot be read."""
        names = self._names(kind, key)
        if names:
            self._tell(f"{self.url}: {kind}/{key[0]}/{names[0]} cannot be read; it is made again")
        self._remove(kind, names)

    def _remove(self, kind: str, names: Sequence[str]) -> None:
        self._bad.update(names)
        for name in names:
            with contextlib.suppress(Exception):  # whoever may not remove it leaves it alone
                self._call("rm_file", self._place(kind, name))

    def _put(self, path: Path, place: str) -> None:
        if self._is_bucket:
            self._call("put_file", str(path), place)
            return
        self._require_folder()
        draft = f"{self.home}/tmp/{uuid.uuid4().hex}"
        try:
            for folder in (draft, place):
                self.files.makedirs(folder.rpartition("/")[0], exist_ok=True)
            self._call("put_file", str(path), draft)
            self.files.mv(draft, place)
        except BaseException:
            with contextlib.suppress(Exception):
                self.files.rm_file(draft)
            raise

    def _place(self, kind: str, name: str) -> str:
        return f"{self.home}/{kind}/{name[0]}/{name}"

    @property
    def _is_bucket(self) -> bool:
        return self.url.partition("://")[0] in _BUCKETS

    @property
    def _bucket(self) -> str:
        """The bucket, or the folder, which must be there."""
        return self.home.partition("/")[0] if self._is_bucket else self.home

    def _require_folder(self) -> None:
        """Raise NotADirectoryError where the folder is not there, as when a share is not mounted."""
        if not (self._is_bucket or self.files.isdir(self.home)):
            raise NotADirectoryError(self.home)

    # Requests

    def _call(self, method: str, *arguments: Any, **options: Any) -> Any:
        """Call a method of the file system; one that can be ended ends after REQUEST_SECONDS."""
        if not self.files.async_impl:
            return getattr(self.files, method)(*arguments, **options)
        import asyncio  # takes a moment, and most runs have no remote store

        from fsspec.asyn import sync

        async def bounded() -> Any:
            request = getattr(self.files, f"_{method}")(*arguments, **options)
            return await asyncio.wait_for(request, REQUEST_SECONDS)

        return sync(self.files.loop, bounded)

    def _tried(self, request: Callable[[], T]) -> T:
        """Make a request, again and again for PATIENCE seconds. Raises _UnreachableError, after a warning."""
        pause, deadline = FIRST_PAUSE, time.monotonic() + (PATIENCE if self._fault is None else 0.0)
        while True:
            if time.monotonic() < self._silent_until:
                raise _UnreachableError
            try:
                answer = request()
            except MachineError:  # of this machine's disk
                raise
            except Exception as error:  # each file system has errors of its own
                fault, is_final = _fault_of(error)
                if is_final or time.monotonic() + pause > deadline:
                    self._leave_alone(fault)
                    raise _UnreachableError from error
                time.sleep(pause * random.uniform(0.5, 1.0))
                pause *= 2.0
            else:
                self._fault, self._silence = None, SILENT_SECONDS
                return answer

    def _leave_alone(self, fault: str) -> None:
        """Warn of what is wrong, and ask for nothing for a while."""
        with self._lock:
            self._fault = fault
            if time.monotonic() < self._silent_until:
                return
            self._silent_until = time.monotonic() + self._silence
            self._silence = min(2.0 * self._silence, MAX_SILENT_SECONDS)
        self._tell(
            f"{self.url}: {fault}; going on without it. What is made stays here, and the next run uploads it"
        )

    def _tell(self, message: str) -> None:
        """Log a warning, each once."""
        with self._lock:
            if message in self.told:
                return
            self.told.add(message)
        LOG.warning(message)


@lru_cache
def _opened(url: str, process: int) -> RemoteStore:
    """Open the remote store of a process: connections do not outlive a fork."""
    checked = checked_url(url)
    return RemoteStore(checked, *open_url(checked))


def _digest_in(name: str) -> str:
    return name.split(".")[1]


_NO_FOLDER = "no such bucket or folder; make it, and mind the spelling"

_FAULTS: tuple[tuple[str, str, bool], ...] = (
    ("PermissionError|AccessDenied", "permission denied; check its credentials", True),
    ("Credential|ProfileNotFound|TokenRetrieval", "no credentials for it were found", True),
    ("FileNotFoundError|NotADirectoryError", _NO_FOLDER, True),
    ("NotImplementedError", "it can only be read", True),
    ("Timeout|Connection|Connect|gaierror|Disconnected", "it does not answer", False),
)
"""Names of classes of errors, what they mean, and whether it is of no use to try again."""


def _fault_of(error: Exception) -> tuple[str, bool]:
    """Return what an error of a file system means, in words, and whether it is final."""
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        return "it is full", True
    name = type(error).__name__
    for pattern, words, is_final in _FAULTS:
        if re.search(pattern, name):
            return words, is_final
    text = str(error).strip().partition("\n")[0]
    return f"it answers {text or name!r}", False
