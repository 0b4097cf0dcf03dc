"""A cache of arrays in memory that spills to temporary files."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from threading import Lock

import psutil

from pipeline.arrays import AnyArray
from pipeline.production.store.readers import read_npz, write_npz
from pipeline.production.store.store import Key
from render.base.atomic_write import atomic_write, disk_errors

SHARE = 0.2
"""Fraction of the free memory that a cache may take."""

Arrays = Mapping[str, AnyArray]


class SpillCache:
    """Arrays by key: in memory up to `room` bytes, then in temporary files until `close`."""

    def __init__(self, room: float | None = None) -> None:
        self._room = SHARE * psutil.virtual_memory().available if room is None else room
        self._held: dict[Key, Arrays] = {}
        self._counting = Lock()
        with disk_errors(Path(tempfile.gettempdir())):
            self._folder = tempfile.TemporaryDirectory(prefix="flowsculpt-")

    def close(self) -> None:
        self._held.clear()
        self._folder.cleanup()

    def __contains__(self, key: Key) -> bool:
        return key in self._held or self._file(key).exists()

    def put(self, key: Key, arrays: Arrays) -> None:
        """Keep arrays under a key. Raises MachineError if neither memory nor disk has room."""
        size = sum(values.nbytes for values in arrays.values())
        with self._counting:
            fits = size <= self._room
            self._room -= size if fits else 0
        if fits:
            self._held[key] = arrays
        else:
            self._write(self._file(key), arrays)

    def get(self, key: Key) -> Arrays:
        return self._held[key] if key in self._held else read_npz(self._file(key))

    def drop(self, key: Key) -> None:
        """Forget the arrays of a key."""
        with self._counting:
            self._room += sum(values.nbytes for values in self._held.pop(key, {}).values())
        self._file(key).unlink(missing_ok=True)

    def keep_only(self, keys: set[Key]) -> None:
        """Forget all arrays but those of these keys."""
        for key in {*self._held, *(file.stem for file in Path(self._folder.name).iterdir())} - keys:
            self.drop(key)

    def _write(self, file: Path, arrays: Arrays) -> None:
        with atomic_write(file, flush=False) as draft:
            write_npz(draft, dict(arrays))

    def _file(self, key: Key) -> Path:
        return Path(self._folder.name) / f"{key}.npz"
