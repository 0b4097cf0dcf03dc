"""Which files a piece of code opens, in whatever process and by whatever library: Linux's inotify knows."""

from __future__ import annotations

import ctypes
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_OPEN, _IS_FOLDER, _NONBLOCK = 0x20, 0x40000000, 0o4000
_EVENT = struct.Struct("iIII")


@contextmanager
def opened_below(folder: Path) -> Iterator[set[Path]]:
    """Yield a set that holds, once the block has ended, the files below a folder that were opened in it."""
    libc = ctypes.CDLL(None, use_errno=True)
    watch = libc.inotify_init1(_NONBLOCK)
    opened: set[Path] = set()
    try:
        folders = [folder, *(path for path in folder.rglob("*") if path.is_dir())]
        watched = {libc.inotify_add_watch(watch, os.fsencode(place), _OPEN): place for place in folders}
        yield opened
        opened.update(_events(watch, watched))
    finally:
        os.close(watch)


def _events(watch: int, watched: dict[int, Path]) -> Iterator[Path]:
    """Yield files that were opened. An event is there as soon as a process has opened a file."""
    with suppress(BlockingIOError):  # there are no more
        while True:
            data, at = os.read(watch, 1 << 20), 0
            while at < len(data):
                number, mask, _, length = _EVENT.unpack_from(data, at)
                name = data[at + _EVENT.size : at + _EVENT.size + length].rstrip(b"\0")
                at += _EVENT.size + length
                if name and not mask & _IS_FOLDER:
                    yield watched[number] / os.fsdecode(name)
