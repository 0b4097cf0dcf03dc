"""Digests of the files of sequences, kept so that thousands of files are not read whenever work is planned.

A digest is used again while size, time of change, inode and place of its file are the same, as git does with
the files of a work tree. One that was changed less than REST seconds before it was read is not kept: it may
be changed again within one tick of the clock of its disk.
"""

from __future__ import annotations

import atexit
import os
import time
from functools import cache
from pathlib import Path
from typing import Any

from flowsculpt.render.base.input_files import InputFile
from flowsculpt.render.base.user_cache import CachedAnswer

REST = 2.0
"""Seconds since its last change after which the digest of a file is kept."""

SAVED = 5.0
"""Seconds of reading that a process which is killed may lose."""


class KeptDigests:
    """The digests of the files of one folder, in the user's cache."""

    def __init__(self, folder: Path) -> None:
        self._folder = str(folder)
        self._answer = CachedAnswer.of("digests", [os.path.abspath(folder)])  # noqa: PTH100  # no links resolved
        self._known: dict[str, list[Any]] = self._answer.load(lambda answer: answer) or {}
        self._saved, self._has_new = time.monotonic(), False
        atexit.register(self.save)

    @staticmethod
    @cache
    def of(folder: Path) -> KeptDigests:
        """Return those of a folder, the same in all of the process."""
        return KeptDigests(folder)

    def known(self, name: str) -> str | None:
        """Return the kept digest of a file; None where there is none, or the file has changed since."""
        kept = self._known.get(name)
        if kept is None:
            return None
        state = _state(f"{self._folder}/{name}")
        return kept[-1] if state is not None and kept[:-1] == state else None

    def digest(self, name: str) -> str:
        """Return the SHA-256 of a file, and keep it. Raises what `InputFile.digest` raises."""
        if (known := self.known(name)) is not None:
            return known
        path = f"{self._folder}/{name}"
        before, now = _state(path), time.time()
        digest = InputFile(Path(path)).digest()
        if before is not None and before == _state(path) and now - max(before[1:3]) * 1e-9 > REST:
            self._known[name], self._has_new = [*before, digest], True
        if time.monotonic() - self._saved > SAVED:
            self.save()
        return digest

    def save(self) -> None:
        """Write new ones to the cache; the last of several processes wins, and the next run reads again."""
        if self._has_new:
            self._answer.store(self._known)
        self._saved, self._has_new = time.monotonic(), False


def _state(path: str) -> list[int] | None:
    """Return what tells that a file has changed: size, times and inode; None where it cannot be asked."""
    try:
        facts = os.stat(path)  # noqa: PTH116  # Paths are slow
    except (OSError, ValueError):
        return None
    return [facts.st_size, facts.st_mtime_ns, facts.st_ctime_ns, facts.st_ino]
