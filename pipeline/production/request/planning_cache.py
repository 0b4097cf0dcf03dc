"""The planning cache: what reading a shot found, so that planning need not read it again.

It only makes planning faster and may be deleted at any time. An entry is filed under everything it was found
from: the shot's text and settings, the sources of the whole project, the versions of the packages they use.
A damaged entry, or one of another form, counts as none.

    .flowsculpt/planning/<key>.json          in a root where a run has begun: all who work in it share them
    ~/.cache/flowsculpt/planning/<key>.json  before, for commands that only look leave a root as it is
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
from pipeline.plugin import plugins
from pipeline.production.store.paths import STATE
from pipeline.production.store.store import Store, key_of
from render.base.atomic_write import atomic_write
from render.base.render_errors import BadInputError
from render.base.serialise import from_plain, to_plain
from render.base.user_cache import writable_cache

Data = TypeVar("Data")

PACKAGES = ("numpy", "numba", "trimesh", "pydantic", "ruamel.yaml", "fileseq", "mitsuba", "OpenImageIO")
KEPT_SECONDS = 60 * 24 * 3600.0
"""Seconds without use after which an entry is removed."""

_PROJECT = Path(__file__).parents[3]


@dataclass(frozen=True)
class PlanningCache:
    """The planning cache of a root folder; without one it keeps nothing."""

    root: Path | None

    def get(self, kind: type[Data], *found_from: Any) -> Data | None:
        """Return the data of a dataclass that were put under `found_from`; None where there are none."""
        if self.root is None:
            return None
        name = f"{key_of(_code(), *found_from)}.json"
        for folder in (self._folder, _user_folder()):
            with contextlib.suppress(BadInputError):
                if (plain := _entry(f"{folder}/{name}")) is not None:
                    return from_plain(kind, plain)
        return None

    def put(self, data: Any, *found_from: Any) -> None:
        """File the data of a dataclass under `found_from`. Ignore errors of the disk."""
        if self.root is None:
            return
        name, text = f"{key_of(_code(), *found_from)}.json", json.dumps(to_plain(data), separators=(",", ":"))
        draft = Store(self.root).draft(".json") if self._has_begun else None
        path = Path(self._folder if self._has_begun else _pruned_user_folder(), name)
        with contextlib.suppress(OSError, MachineError), atomic_write(path, draft, flush=False) as written:
            written.write_text(f"{_digest(text)}\n{text}", encoding="utf-8")

    def found_or_made(self, kind: type[Data], make: Callable[[], Data], *found_from: Any) -> Data:
        """Return the data of a dataclass that were put under `found_from`, or make and put them there."""
        known = self.get(kind, *found_from)
        if known is not None:
            return known
        data = make()
        self.put(data, *found_from)
        return data

    def prune(self) -> None:
        """Remove entries that nobody used for long. Runs do this once: listing a large folder takes time."""
        _prune(self._folder)

    @property
    def _folder(self) -> str:
        return f"{self.root}/{STATE}/planning"

    @property
    def _has_begun(self) -> bool:
        """True if a run has begun in the root."""
        return self.root is not None and (self.root / STATE).is_dir()


NO_CACHE = PlanningCache(None)


@cache
def _code() -> list[str]:
    """Return everything besides a shot that entries may depend on: too much rather than too little."""
    digest = hashlib.sha256()
    for package in ("pipeline", "render"):
        for file in sorted((_PROJECT / package).rglob("*.py")):
            digest.update(file.relative_to(_PROJECT).as_posix().encode())
            digest.update(file.read_bytes())
    for plugin in plugins():
        for file in plugin.sources:
            digest.update(file.read_bytes())
    versions = [f"{name}={version(name)}" for name in PACKAGES]
    versions += [f"{plugin.name}={plugin.version}" for plugin in plugins()]
    return [digest.hexdigest(), sys.version, *versions]


def _entry(path: str) -> Any:
    """Return the plain data of an entry; None where it is not there, or damaged."""
    try:
        with open(path, encoding="utf-8") as file:  # noqa: PTH123  # Paths are slow
            digest, text = file.read().split("\n", 1)
        if digest != _digest(text):
            return None
        plain = json.loads(text)
        if time.time() - os.stat(path).st_mtime > KEPT_SECONDS / 2.0:  # noqa: PTH116
            with contextlib.suppress(OSError):  # of a folder that is only read
                os.utime(path)
    except (OSError, ValueError):
        return None
    return plain


def _user_folder() -> str:
    """Return the folder of entries of roots where no run has begun."""
    return f"{writable_cache()}/planning"


@cache
def _pruned_user_folder() -> str:
    """Return the same folder without entries that nobody used for long: no run looks after it."""
    _prune(_user_folder())
    return _user_folder()


def _prune(folder: str) -> None:
    oldest = time.time() - KEPT_SECONDS
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            with contextlib.suppress(OSError):
                if entry.stat().st_mtime < oldest:
                    Path(entry.path).unlink()


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
