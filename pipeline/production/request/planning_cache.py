"""The ledger: keys that were found before, so that planning need not read a shot to find them anew.

It only makes planning faster and may be deleted at any time. What stands in it is filed under all that it
was found from: the shot's text and settings, the code of the whole project, the versions of what that rests
on. An entry that cannot be read, or was changed, counts as none.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import sys
import time
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pipeline.production.keys.digest import Key, key_of
from pipeline.production.store.paths import STATE
from pipeline.production.store.store import Store

_PROJECT = Path(__file__).parents[3]

PACKAGES = ("numpy", "numba", "trimesh", "pydantic", "ruamel.yaml", "fileseq", "mitsuba", "OpenImageIO")
KEPT_SECONDS = 60 * 24 * 3600.0
"""Entries that nobody has asked for so long are removed when another is written."""


@dataclass(frozen=True)
class PlanningCache:
    """The ledger of a root folder."""

    root: Path

    def recall(self, *found_from: Any) -> Any:
        """What was noted of this, plain data; None where nothing was."""
        path = self._path(found_from)
        try:
            digest, text = path.read_text(encoding="utf-8").split("\n", 1)
        except (OSError, ValueError):
            return None
        if digest != _digest(text):
            return None
        with contextlib.suppress(OSError):
            if time.time() - path.stat().st_mtime > KEPT_SECONDS / 2.0:
                os.utime(path)
        return json.loads(text)

    def note(self, data: Any, *found_from: Any) -> None:
        """Remember plain data, where there is something to be remembered for: a root that no run has begun
        in stays as it is. A disk that refuses hinders nothing."""
        path, text = self._path(found_from), json.dumps(data, separators=(",", ":"))
        draft = Store(self.root).draft(".json")
        with contextlib.suppress(OSError):
            if not (self.root / STATE).is_dir():
                return
            for folder in (path.parent, draft.parent):
                folder.mkdir(exist_ok=True)
            try:
                draft.write_text(f"{_digest(text)}\n{text}", encoding="utf-8")
                draft.replace(path)
            finally:
                draft.unlink(missing_ok=True)
            self._forget_old()

    def _path(self, found_from: tuple[Any, ...]) -> Path:
        return self.root / STATE / "ledger" / f"{key_of(_code(), *found_from)}.json"

    def _forget_old(self) -> None:
        oldest = time.time() - KEPT_SECONDS
        with os.scandir(self.root / STATE / "ledger") as entries:
            for entry in entries:
                with contextlib.suppress(OSError):
                    if entry.stat().st_mtime < oldest:
                        Path(entry.path).unlink()


@cache
def _code() -> list[str]:
    """Return all that keys may depend on beside a shot: more than they do, so that nothing is left out."""
    digest = hashlib.sha256()
    for package in ("pipeline", "render"):
        for file in sorted((_PROJECT / package).rglob("*.py")):
            digest.update(file.relative_to(_PROJECT).as_posix().encode())
            digest.update(file.read_bytes())
    return [digest.hexdigest(), sys.version, *(f"{name}={version(name)}" for name in PACKAGES)]


def _digest(text: str) -> Key:
    return hashlib.sha256(text.encode()).hexdigest()
