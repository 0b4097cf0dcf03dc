"""Half-done pictures: what their passes have found, kept beside the store until they are done.

A file is called after the picture and its key, so that what was begun for another look, camera or code is
never gone on with. It is removed when its picture is done, when another is begun in its place, and a week
after it was written.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.production.keys.digest import Key
from pipeline.production.store.paths import HALVES
from pipeline.production.store.store import Store

if TYPE_CHECKING:
    from render.frame.checkpoint import Checkpoint

KEPT_SECONDS = 7 * 24 * 3600.0

_SUFFIX = ".npz"


def begun(
    store: Store, target: Path, key: Key, warn: Callable[[str], None], urgent: Callable[[], bool]
) -> Checkpoint:
    """Where the picture of `key`, to be shown at `target`, is kept while it is rendered. What was kept there
    of others is removed.

    warn, urgent  see `Checkpoint`
    """
    from render.frame.checkpoint import Checkpoint

    path = store.root / HALVES / f"{_name(target)}.{key}{_SUFFIX}"
    _remove(other for other in _all(store.root) if _is_of(other, target) and other != path)
    return Checkpoint(path, store.draft(_SUFFIX), warn, urgent)


def sweep(store: Store) -> None:
    """Remove what was kept of pictures that the store holds by now, or nobody came back to. Only whoever
    holds the root's lock may call this."""
    oldest = time.time() - KEPT_SECONDS
    for path in _all(store.root):
        with contextlib.suppress(OSError):
            if store.holds("raw", path.stem.rpartition(".")[2]) or path.stat().st_mtime < oldest:
                path.unlink()


def forget(root: Path, targets: Iterable[Path]) -> None:
    """Remove what was kept of pictures that are shown at `targets` now, whatever their keys were."""
    kept = list(_all(root))
    if kept:
        _remove(path for target in targets for path in kept if _is_of(path, target))
        with contextlib.suppress(OSError):
            (root / HALVES).rmdir()


def _name(target: Path) -> str:
    """`renders/A010/final/raw/A010.0040.exr` as one word."""
    return "+".join(target.with_suffix("").parts[1:])


def _is_of(path: Path, target: Path) -> bool:
    return path.stem.rpartition(".")[0] == _name(target)


def _all(root: Path) -> Iterator[Path]:
    yield from sorted((root / HALVES).glob(f"*{_SUFFIX}"))


def _remove(paths: Iterable[Path]) -> None:
    for path in paths:
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)
