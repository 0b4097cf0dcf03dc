"""Unfinished files: drafts in `tmp/`, of the root and of the store, and checkpoints, the sums of samples of
unfinished pictures.

A checkpoint is named after the place and the key of its picture, so one of another look, camera or version is
never resumed.
"""

from __future__ import annotations

import contextlib
import os
import platform
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.production.store.paths import CHECKPOINTS
from pipeline.production.store.processes import is_at_work
from pipeline.production.store.store import Key, Store

if TYPE_CHECKING:
    from render.frame.checkpoint import Checkpoint

OLD_DRAFT = 24 * 3600.0
"""Seconds after which a draft of another host counts as left behind."""

KEPT_CHECKPOINT = 7 * 24 * 3600.0
"""Seconds for which a checkpoint is kept for a picture that nobody goes on with."""


def sweep(store: Store) -> None:
    """Remove drafts that killed processes left in `tmp/`, and checkpoints of no more use.

    Those are drafts of dead processes of this host, and old ones of other hosts: a farm's nodes may be at
    work though nobody holds the root's lock. A checkpoint goes when its picture is done, or it is old.
    """
    now = _disk_time(store)
    for folder in (store.scratch, store.inner_scratch):
        with contextlib.suppress(OSError):
            for path in sorted(folder.iterdir()):
                if _left_behind(path, now):
                    path.unlink(missing_ok=True)
    oldest = now - KEPT_CHECKPOINT
    for path in _checkpoints(store):
        with contextlib.suppress(OSError):
            if store.is_here("raw", path.stem.rpartition(".")[2]) or path.stat().st_mtime < oldest:
                path.unlink()


def _disk_time(store: Store) -> float:
    """Return the time of the clock that dates files, which may be a file server's."""
    try:
        with tempfile.TemporaryFile(dir=store.scratch) as file:
            return os.fstat(file.fileno()).st_mtime
    except OSError:
        return time.time()


def checkpoint_of(
    store: Store, target: Path, key: Key, warn: Callable[[str], None], urgent: Callable[[], bool]
) -> Checkpoint:
    """Return the checkpoint of the picture of `key`, shown at `target`; remove those of other keys.

    warn, urgent  see `Checkpoint`
    """
    from render.frame.checkpoint import Checkpoint

    path = store.root / CHECKPOINTS / f"{_checkpoint_name(target)}.{key}.npz"
    remove_checkpoints(store, [target], keep=path)
    return Checkpoint(path, store.draft(path.suffix), warn, urgent)


def remove_checkpoints(store: Store, targets: Iterable[Path], keep: Path | None = None) -> None:
    """Remove the checkpoints of pictures that are shown at `targets`, whatever their keys, but `keep`."""
    paths = _checkpoints(store)
    names = {_checkpoint_name(target) for target in targets} if paths else set()
    for path in paths:
        if path != keep and path.stem.rpartition(".")[0] in names:
            with contextlib.suppress(OSError):
                path.unlink()


def _checkpoints(store: Store) -> list[Path]:
    return sorted((store.root / CHECKPOINTS).glob("*.npz"))


def _checkpoint_name(target: Path) -> str:
    """Return `renders/A010/final/raw/A010.0040.exr` as one word."""
    return "+".join(target.with_suffix("").parts[1:])


def _left_behind(draft: Path, now: float) -> bool:
    host, _, rest = draft.name.lstrip(".").partition("+")  # a writer's own draft of it begins with a point
    number = rest.partition("+")[0]
    if host == platform.node() and number.isdecimal():
        return int(number) == os.getpid() or not is_at_work(int(number))
    return not number or now - draft.stat().st_mtime > OLD_DRAFT
