"""The planning cache: what reading a shot found, so that planning need not read it again.

It only makes planning faster and may be deleted at any time. An entry is filed under everything it was found
from: the shot's text and settings, the sources of the whole project, the versions of the packages they use.
A damaged entry counts as none.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

from pipeline.errors import MachineError
from pipeline.production.store.paths import STATE
from pipeline.production.store.store import Store, key_of
from render.base.atomic_write import atomic_write
from render.base.serialise import from_plain, to_plain

Data = TypeVar("Data")

PACKAGES = ("numpy", "numba", "trimesh", "pydantic", "ruamel.yaml", "fileseq", "mitsuba", "OpenImageIO")
KEPT_SECONDS = 60 * 24 * 3600.0
"""Seconds without use after which a run removes an entry."""

_PROJECT = Path(__file__).parents[3]


@dataclass(frozen=True)
class PlanningCache:
    """The planning cache of a root folder; without one it keeps nothing."""

    root: Path | None

    def get(self, *found_from: Any) -> Any:
        """Return the plain data that was put under `found_from`; None where there is none."""
        if self.root is None:
            return None
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

    def put(self, data: Any, *found_from: Any) -> None:
        """File plain data under `found_from`, if a run has begun in the root. Ignore errors of the disk."""
        if self.root is None or not (self.root / STATE).is_dir():
            return
        path, text = self._path(found_from), json.dumps(data, separators=(",", ":"))
        with (
            contextlib.suppress(OSError, MachineError),
            atomic_write(path, Store(self.root).draft(".json"), flush=False) as draft,
        ):
            draft.write_text(f"{_digest(text)}\n{text}", encoding="utf-8")

    def found_or_made(self, kind: type[Data], make: Callable[[], Data], *found_from: Any) -> Data:
        """Return the data of a dataclass that was put under `found_from`, or make it and put it there."""
        known = self.get(*found_from)
        if known is not None:
            return from_plain(kind, known)
        data = make()
        self.put(to_plain(data), *found_from)
        return data

    def prune(self) -> None:
        """Remove entries that nobody used for long. Runs do this once: listing a large folder takes time."""
        oldest = time.time() - KEPT_SECONDS
        with contextlib.suppress(OSError), os.scandir(self._folder) as entries:
            for entry in entries:
                with contextlib.suppress(OSError):
                    if entry.stat().st_mtime < oldest:
                        Path(entry.path).unlink()

    @property
    def _folder(self) -> str:
        return f"{self.root}/{STATE}/planning"

    def _path(self, found_from: tuple[Any, ...]) -> Path:
        return Path(f"{self._folder}/{key_of(_code(), *found_from)}.json")


NO_CACHE = PlanningCache(None)


@cache
def _code() -> list[str]:
    """Return all that entries may depend on beside a shot: more than they do, so that nothing is left out."""
    digest = hashlib.sha256()
    for package in ("pipeline", "render"):
        for file in sorted((_PROJECT / package).rglob("*.py")):
            digest.update(file.relative_to(_PROJECT).as_posix().encode())
            digest.update(file.read_bytes())
    return [digest.hexdigest(), sys.version, *(f"{name}={version(name)}" for name in PACKAGES)]


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
