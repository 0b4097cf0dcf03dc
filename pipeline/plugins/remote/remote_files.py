"""The remote store: files of many roots in a bucket or on a file share, each under its key and its digest.

    PREFIX/frame/a/ab12….<digest of the content>.exr

The digest in the name says what the content must be, so every reader notices a truncated or damaged file, and
writing takes one request. Whole files are checked too: each must hold its key, or have the format of its kind
(`fetched_content.py`). One listing of a kind of files answers for all its keys; it is made of sixteen, side
by side, by the first digit of the key.

Nothing here raises an error for what the remote store does. While it does not answer (`remote_requests.py`),
the answer to everything is that it holds nothing.
"""

from __future__ import annotations

import contextlib
import errno
import math
import os
import re
import threading
import time
import uuid
from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path

from flowsculpt import MachineError
from flowsculpt.api import RemoteStores
from flowsculpt.api.frames import StoredFiles
from flowsculpt.pipeline.plugins.remote.fetched_content import fault_of, suffix_of
from flowsculpt.pipeline.plugins.remote.remote_requests import (
    NO_FOLDER,
    RemoteRequests,
    UnreachableError,
    checked_url,
    load_package,
    open_url,
)

SIDE_BY_SIDE = 16
"""Requests for listings that are made at once, one for each first digit of a key."""

LISTED_SECONDS = 60.0
"""Seconds for which a listing counts: what others upload meanwhile is seen after these."""

_NAME = re.compile(r"([0-9a-f]{32})\.([0-9a-f]{32})(\.\w+)", re.ASCII)
"""Names that are used; others in a listing, and their folders, never become part of a path."""

_BUCKETS = ("s3", "s3a", "gs", "gcs", "abfs", "abfss", "az", "adl", "oci", "oss", "memory")
"""Protocols of object stores, where a file appears whole or not at all. By others it is renamed into place,
and the folder of the address must be there."""

_LOCAL_FAULTS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)
"""Errors of the disk that a file is fetched to."""


@dataclass(eq=False)
class RemoteFiles:
    """The remote store at a checked address, with its path there. One for each process and address."""

    url: str
    requests: RemoteRequests
    home: str
    _listed: dict[str, tuple[float, dict[str, list[str]]]] = field(default_factory=dict)
    _bad: set[str] = field(default_factory=set)
    _listing_lock: threading.Lock = field(default_factory=threading.Lock)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @classmethod
    def of(cls, url: str) -> RemoteFiles:
        """Return the remote store at an address, as the user gave it.

        Raises UsageError and MachineError for an address that cannot be used.
        """
        return _opened(url, os.getpid())

    @property
    def told(self) -> Collection[str]:
        """The warnings that this process has logged."""
        return self.requests.told

    def holds(self, kind: str, key: str) -> bool:
        """Tell whether the remote store has a file of `key` that is not known to be damaged."""
        return bool(self._names(kind, key))

    def digests(self, kind: str) -> Mapping[str, Sequence[str]]:
        """Return the digests of all files of a kind, by key. Empty where the remote store does not answer."""
        known = self._listing(kind)
        return {key: [_digest_in(name) for name in names] for key, names in known.items()}

    def fault(self) -> str | None:
        """Ask the remote store for a listing; return what is wrong with it, or None."""
        with contextlib.suppress(UnreachableError):
            bucket = self.home.partition("/")[0] if self._is_bucket else self.home
            if not self.requests.tried(lambda: self.requests.call("exists", bucket)):
                return NO_FOLDER
            self._names_of("cameras")
        return self.requests.fault

    def _names(self, kind: str, key: str) -> list[str]:
        return [name for name in self._listing(kind).get(key, ()) if name not in self._bad]

    def _listing(self, kind: str) -> dict[str, list[str]]:
        """Return the names of files of a kind by key, as of LISTED_SECONDS ago or later."""
        if self.requests.is_silent:
            return {}
        with self._listing_lock:
            made, names = self._listed.get(kind, (-math.inf, {}))
            if time.monotonic() - made > LISTED_SECONDS:
                try:
                    names = self._names_of(kind)
                except UnreachableError:
                    return {}
                self._listed[kind] = time.monotonic(), names
            return names

    def _names_of(self, kind: str) -> dict[str, list[str]]:
        """Ask for the names of all files of a kind, by key. Raises UnreachableError."""
        found: dict[str, list[str]] = {}
        suffix = suffix_of(kind)
        with ThreadPoolExecutor(SIDE_BY_SIDE) as pool:
            for paths in pool.map(self._ls, self._ls(f"{self.home}/{kind}")):
                for path in paths:
                    name = path.rpartition("/")[2]
                    if (match := _NAME.fullmatch(name)) and match[3] == suffix:
                        found.setdefault(name.partition(".")[0], []).append(name)
        return found

    def _ls(self, folder: str) -> list[str]:
        def ask() -> list[str]:
            try:
                return list(self.requests.call("ls", folder, detail=False))
            except FileNotFoundError:  # nothing was put there yet
                self._require_folder()
                return []

        return self.requests.tried(ask)

    def fetch(self, kind: str, key: str, draft: Path) -> str | None:
        """Write the file of `key` to `draft`; return its digest, or None where there is no whole one.

        Raises MachineError where the disk of `draft` refuses.
        """
        with contextlib.suppress(UnreachableError):
            for name in self._names(kind, key):
                fault = None
                for _ in range(2):  # damaged on the way, perhaps
                    if not self.requests.tried(partial(self._get, self._place(kind, name), draft)):
                        break
                    is_as_sent = StoredFiles.digest_of(draft) == _digest_in(name)
                    fault = fault_of(kind, key, draft) if is_as_sent else "differs from the stored file"
                    if fault is None:
                        return _digest_in(name)
                    if is_as_sent:
                        break
                if fault is not None:
                    self.requests.warn(
                        f"{self.url}: {kind}/{name[0]}/{name} {fault}: it is not used, and is replaced once "
                        "it is made again"
                    )
                self._bad.add(name)
        return None

    def _get(self, place: str, draft: Path) -> bool:
        """Write a remote file to `draft`; return whether it was there."""
        try:
            draft.parent.mkdir(parents=True, exist_ok=True)
            self.requests.call("get_file", place, str(draft))
        except FileNotFoundError:
            return False
        except OSError as error:
            if error.errno in _LOCAL_FAULTS:
                raise MachineError.of_path(draft, error) from error
            raise
        return True

    def send(self, kind: str, key: str, path: Path, digest: str, replace: bool = False) -> bool:
        """Upload the file of `key`; return whether it is there. `replace` removes other files of `key`."""
        name = f"{key}.{digest}{path.suffix}"
        listed = self._listing(kind) if replace else self._listed.get(kind, (0.0, {}))[1]
        others = [other for other in listed.get(key, ()) if other != name]
        try:
            self.requests.tried(lambda: self._put(path, self._place(kind, name)))
        except UnreachableError:
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
            self.requests.warn(f"{self.url}: {kind}/{key[0]}/{names[0]} cannot be read; it is made again")
        self._remove(kind, names)

    def _remove(self, kind: str, names: Sequence[str]) -> None:
        self._bad.update(names)
        for name in names:
            with contextlib.suppress(Exception):  # whoever may not remove it leaves it alone
                self.requests.call("rm_file", self._place(kind, name))

    def _put(self, path: Path, place: str) -> None:
        if self._is_bucket:
            self.requests.call("put_file", str(path), place)
            return
        self._require_folder()
        draft = f"{self.home}/tmp/{uuid.uuid4().hex}"
        try:
            for folder in (draft, place):
                self.requests.files.makedirs(folder.rpartition("/")[0], exist_ok=True)
            self.requests.call("put_file", str(path), draft)
            self.requests.files.mv(draft, place)
        except BaseException:
            with contextlib.suppress(Exception):
                self.requests.files.rm_file(draft)
            raise

    def _place(self, kind: str, name: str) -> str:
        return f"{self.home}/{kind}/{name[0]}/{name}"

    @property
    def _is_bucket(self) -> bool:
        return self.url.partition("://")[0] in _BUCKETS

    def _require_folder(self) -> None:
        """Raise NotADirectoryError where the folder is not there, as when a share is not mounted."""
        if not (self._is_bucket or self.requests.files.isdir(self.home)):
            raise NotADirectoryError(self.home)


@lru_cache
def _opened(url: str, process: int) -> RemoteFiles:
    """Open the remote store of a process: connections do not outlive a fork."""
    checked = checked_url(url)
    files, home = open_url(checked)
    return RemoteFiles(checked, RemoteRequests(checked, files), home)


def _digest_in(name: str) -> str:
    return name.split(".")[1]


class RemoteFileStores(RemoteStores):
    """Finds buckets and folders on file shares."""

    def checked(self, typed: str) -> str:
        return checked_url(typed)

    def opened(self, url: str) -> RemoteFiles:
        return RemoteFiles.of(url)

    def load(self, url: str) -> None:
        load_package(url)
