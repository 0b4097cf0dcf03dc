"""Uploads to the remote store, and what is left of them where it does not answer.

A file is marked in `.flowsculpt/uploads/` before it is sent, and the mark goes once the remote store has it.
So the next run knows what is still to be sent without comparing two stores, also after a process was killed.
"""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from pipeline.production.store.digests import digest_of
from pipeline.production.store.paths import STATE
from pipeline.production.store.remote_store import SIDE_BY_SIDE
from render.base.atomic_write import disk_errors

if TYPE_CHECKING:
    from pipeline.production.store.store import Key, Store

UPLOADS = STATE / "uploads"

Name = tuple[str, "Key"]
"""The kind and the key of a stored file."""


class Uploaded(NamedTuple):
    """The outcome of uploads.

    sent    files that the remote store has now
    unsent  files that it did not take
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
    return _upload_all(store, missed_uploads(store.root)) if store.remote else Uploaded(0, 0)


def lacking_names(store: Store) -> list[Name]:
    """Return the stored files that the remote store lacks, without reading them."""
    if store.remote is None:
        return []
    there = cache(store.remote.digests)
    return [(kind, key) for kind, key, _ in store.entries() if key not in there(kind)]


def upload_lacking(store: Store) -> Uploaded:
    """Send every stored file that the remote store lacks, and those that are marked."""
    return _upload_all(store, dict.fromkeys([*lacking_names(store), *missed_uploads(store.root)]))


def _upload_all(store: Store, names: Iterable[Name]) -> Uploaded:
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
