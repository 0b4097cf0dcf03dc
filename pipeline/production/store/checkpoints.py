"""Checkpoints of pictures: their sums of samples, kept beside the store until the pictures are done.

A file is named after the picture and its key, so a checkpoint of another look, camera or version is never
resumed. It goes when its picture is done, when another picture is begun in its place, and a week after it was
written.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.production.store.paths import CHECKPOINTS
from pipeline.production.store.store import Key, Store

if TYPE_CHECKING:
    from render.frame.checkpoint import Checkpoint

KEPT_SECONDS = 7 * 24 * 3600.0

_SUFFIX = ".npz"


def checkpoint_of(
    store: Store, target: Path, key: Key, warn: Callable[[str], None], urgent: Callable[[], bool]
) -> Checkpoint:
    """Return the checkpoint of the picture of `key`, which is shown at `target`; remove those of other keys.

    warn, urgent  see `Checkpoint`
    """
    from render.frame.checkpoint import Checkpoint

    path = store.root / CHECKPOINTS / f"{_name(target)}.{key}{_SUFFIX}"
    _remove(other for other in _all(store.root) if _is_of(other, target) and other != path)
    return Checkpoint(path, store.draft(_SUFFIX), warn, urgent)


def sweep(store: Store) -> None:
    """Remove checkpoints of pictures that the store holds by now, and old ones.

    Only the holder of the root's lock may call this.
    """
    oldest = time.time() - KEPT_SECONDS
    for path in _all(store.root):
        with contextlib.suppress(OSError):
            if store.holds("raw", path.stem.rpartition(".")[2]) or path.stat().st_mtime < oldest:
                path.unlink()


def forget(root: Path, targets: Iterable[Path]) -> None:
    """Remove the checkpoints of pictures that are shown at `targets` now, whatever their keys are."""
    kept = list(_all(root))
    if kept:
        _remove(path for target in targets for path in kept if _is_of(path, target))


def _name(target: Path) -> str:
    """Return `renders/A010/final/raw/A010.0040.exr` as one word."""
    return "+".join(target.with_suffix("").parts[1:])


def _is_of(path: Path, target: Path) -> bool:
    return path.stem.rpartition(".")[0] == _name(target)


def _all(root: Path) -> list[Path]:
    return sorted((root / CHECKPOINTS).glob(f"*{_SUFFIX}"))


def _remove(paths: Iterable[Path]) -> None:
    for path in paths:
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)
