"""Noticing that a shot was saved: by what its files hold, for editors save in many ways."""

from __future__ import annotations

import time
from collections.abc import Collection
from pathlib import Path

LOOK_AGAIN = 0.1
"""Seconds between looks."""

Stamp = frozenset[tuple[str, int, int]]
"""Paths, and when they were last written, ns, and how large they are."""


def stamp(paths: Collection[Path]) -> Stamp:
    """Of files as they are; one that is not there counts too, for editors take it away before they save."""
    found = set()
    for path in paths:
        try:
            facts = path.stat()
            found.add((str(path), facts.st_mtime_ns, facts.st_size))
        except OSError:
            found.add((str(path), 0, 0))
    return frozenset(found)


def wait_for_edit(paths: Collection[Path], before: Stamp) -> None:
    """Wait until files differ from `before`, and are done changing."""
    now = before
    while now == before:
        time.sleep(LOOK_AGAIN)
        now = stamp(paths)
    last = before
    while now != last:
        time.sleep(LOOK_AGAIN / 2)
        last, now = now, stamp(paths)
