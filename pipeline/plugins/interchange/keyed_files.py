"""A folder of exported files, and the JSON file that records what each was made from."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.production.store.store import Key, Store


@dataclass(eq=False)
class KeyedFiles:
    """The exported files of one folder. A file is current while it has the key and the size that are noted.

    folder  absolute
    name    of the JSON file, which holds key and size by file name
    """

    folder: Path
    name: str
    store: Store
    _noted: dict[str, dict[str, Any]] = field(init=False)
    _written: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._noted = _read(self.folder / self.name)

    @property
    def written(self) -> tuple[str, ...]:
        """The names of the files written so far."""
        return tuple(self._written)

    def keys(self) -> Mapping[str, Key]:
        """Return the keys of the files that are whole, by name."""
        return {name: str(noted.get("key")) for name, noted in self._noted.items() if self._is_whole(name)}

    def is_current(self, name: str, key: Key) -> bool:
        """Tell whether a file is there, whole, and made from what `key` says."""
        return self._noted.get(name, {}).get("key") == key and self._is_whole(name)

    def write(self, name: str, key: Key, write: Callable[[Path], object]) -> None:
        """Write a file by `write(draft)`, whole or not at all. Raises MachineError where the disk refuses."""
        path = self.folder / name
        self.store.write(path, write, flush=False)
        self._noted[name] = {"key": key, "bytes": path.stat().st_size}
        self._written.append(name)

    @contextmanager
    def noting(self) -> Iterator[None]:
        """Write the JSON file when the block ends, also by an error, if files were written in it."""
        before = len(self._written)
        try:
            yield
        finally:
            if len(self._written) > before:
                text = json.dumps(dict(sorted(self._noted.items())), indent=1) + "\n"
                self.store.write(
                    self.folder / self.name,
                    lambda draft: draft.write_text(text, encoding="utf-8"),
                    flush=False,
                )

    def _is_whole(self, name: str) -> bool:
        try:
            return (self.folder / name).stat().st_size == self._noted[name].get("bytes")
        except OSError:
            return False


def _read(path: Path) -> dict[str, dict[str, Any]]:
    """Return what the JSON file says; nothing if it is missing or damaged: all is then written again."""
    try:
        noted = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    if not isinstance(noted, dict):
        return {}
    return {name: entry for name, entry in noted.items() if isinstance(entry, dict)}
