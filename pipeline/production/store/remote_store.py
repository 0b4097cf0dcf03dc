"""The remote store as the core sees it: files of many roots under their keys, on another machine.

The plug-in that adds it knows addresses and file systems. Without an address nothing of it is loaded.

A file is marked in `.flowsculpt/uploads/` before it is sent, and the mark goes once the remote store has it.
So the next run knows what is still to be sent without comparing two stores, also after a process was killed.
"""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Protocol

from pipeline.errors import UsageError
from pipeline.plugin import named, plugins
from pipeline.production.store.digests import DIGITS, digest_of
from pipeline.production.store.paths import STATE
from render.base.atomic_write import atomic_write, disk_errors
from render.base.user_cache import kernel_homes

if TYPE_CHECKING:
    from pipeline.production.store.store import Key, Store


VARIABLE = "FLOWSCULPT_STORE"
"""The environment variable that holds the address. Processes and farms pass it on to their jobs."""

LOG = logging.getLogger("flowsculpt.store")
"""Logger of warnings, which the command line and jobs pass on to the user."""

SIDE_BY_SIDE = 16
"""Requests that are made at once."""


class RemoteStore(Protocol):
    """A remote store. It raises no error where it does not answer: it then holds nothing.

    url   its address
    told  the warnings that this process has logged
    """

    url: str

    @property
    def told(self) -> Collection[str]: ...

    def holds(self, kind: str, key: str) -> bool:
        """Tell whether it has a file of `key` that is not known to be damaged."""
        ...

    def digests(self, kind: str) -> Mapping[str, Sequence[str]]:
        """Return the digests of all files of a kind, by key."""
        ...

    def fault(self) -> str | None:
        """Ask it for a listing; return what is wrong with it, or None."""
        ...

    def fetch(self, kind: str, key: str, draft: Path) -> str | None:
        """Write the file of `key` to `draft`; return its digest, or None where there is no whole one."""
        ...

    def send(self, kind: str, key: str, path: Path, digest: str, replace: bool = False) -> bool:
        """Upload the file of `key`; return whether it is there now. `replace` removes others of `key`."""
        ...

    def reject(self, kind: str, key: str) -> None:
        """Remove the files of `key`: they are what was sent, and cannot be read."""
        ...


class RemoteStores(Protocol):
    """Find remote stores by their addresses; added by a plug-in."""

    def checked(self, typed: str) -> str:
        """Return the address that a user typed. Raises UsageError or MachineError where it cannot be used."""
        ...

    def opened(self, url: str) -> RemoteStore:
        """Return the store at an address, one for each process. Raises what `checked` raises."""
        ...

    def load(self, url: str) -> None:
        """Import what the store at an address needs, without starting a thread."""
        ...

    def send_kernels(self, remote: RemoteStore) -> str:
        """Upload the kernels of this machine; return their name, by which a plan lets workers take them."""
        ...

    def fetch_kernels(self, remote: RemoteStore, planned: str | None = None) -> bool:
        """Fetch the kernels for this machine, those of a name or any; return whether some came."""
        ...


def store_url() -> str | None:
    """Return the address of the remote store that the environment names, or None."""
    return os.environ.get(VARIABLE) or None


def remote_stores() -> RemoteStores:
    """Return what finds remote stores. Raises UsageError where no plug-in does."""
    place = next((plugin.remote_stores for plugin in plugins() if plugin.remote_stores), None)
    if place is None:
        raise UsageError(f"no plug-in knows remote stores; leave out --store, and {VARIABLE} empty")
    stores: RemoteStores = named(place)
    return stores


UPLOADS = STATE / "uploads"

Name = tuple[str, "Key"]
"""The kind and the key of a stored file."""


class Uploaded(NamedTuple):
    """The outcome of uploads.

    sent    files that the remote store has now
    unsent  files that it did not accept
    """

    sent: int
    unsent: int


def upload(store: Store, name: Name, digest: str, replace: bool = False) -> bool:
    """Send a stored file to the remote store; return whether that has it now. Without one, do nothing.

    replace  remove other files of the key there

    Raises MachineError where the disk refuses the mark.
    """
    if store.remote is None:
        return False
    mark = _mark(store.root, name)
    with disk_errors(mark):
        mark.parent.mkdir(parents=True, exist_ok=True)
        mark.touch()
    sent = store.remote.send(*name, store.path(*name), digest, replace)
    if sent:
        mark.unlink(missing_ok=True)
    return sent


def missed_uploads(root: Path) -> list[Name]:
    """Return the files that are marked, and so were not sent to their end."""
    folder = root / UPLOADS
    if not folder.is_dir():
        return []
    names = (path.name.partition(".") for path in sorted(folder.iterdir()))
    return [(kind, key) for kind, _, key in names]


def upload_missed(store: Store) -> Uploaded:
    """Send the files that are marked. One that is gone or damaged meanwhile loses its mark."""
    return upload_all(store, missed_uploads(store.root)) if store.remote else Uploaded(0, 0)


def upload_all(store: Store, names: Iterable[Name]) -> Uploaded:
    """Send stored files. One that is gone or damaged meanwhile loses its mark."""

    def upload_one(name: Name) -> bool | None:
        """Return None for a file that is gone, damaged, or of unknown digest."""
        path = store.path(*name)
        try:
            digest = digest_of(path)
        except OSError:
            digest = ""
        if digest not in store.digests.known(path):
            _mark(store.root, name).unlink(missing_ok=True)
            return None
        return upload(store, name, digest)

    with ThreadPoolExecutor(SIDE_BY_SIDE) as pool:
        outcomes = list(pool.map(upload_one, names))
    return Uploaded(outcomes.count(True), outcomes.count(False))


def _mark(root: Path, name: Name) -> Path:
    return root / UPLOADS / ".".join(name)


def has_kernels(key: str) -> bool:
    """Tell whether this machine has all kernels of a key of `kernels_key`, without importing numba."""
    return any((home / f"complete-{key}").exists() for home in kernel_homes())


def kernels_key() -> str:
    """Return the digest of all that decides what is compiled on this machine."""
    from render.base.kernel_cache import all_kernels, folder_name  # numba, which many jobs never need

    parts = "\n".join([folder_name(), *all_kernels()])
    return hashlib.blake2b(parts.encode(), digest_size=DIGITS // 2).hexdigest()


def note_all_compiled() -> None:
    """Note that this machine has all kernels. Raises MachineError where the disk refuses."""
    if not has_kernels(key := kernels_key()):
        with atomic_write(kernel_homes()[1] / f"complete-{key}", flush=False) as draft:
            draft.touch()
