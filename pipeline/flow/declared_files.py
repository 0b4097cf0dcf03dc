"""Files that a Python flow opens: only those that its shot names, for their contents decide keys."""

from __future__ import annotations

import os
import site
import sys
import threading
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from pipeline.errors import FrameError

_CODE = (".py", ".pyc", ".so", ".nbi", ".nbc", ".kernel", ".pth")
"""Modules, and what caches compile from them; keys do not hold imports."""

_current = threading.local()


@contextmanager
def only_declared(flow: Path, files: Collection[Path]) -> Iterator[None]:
    """Let this thread read no data but those files while it runs the code of a flow.

    Opening another one raises a FrameError that names it. Files of Python, of packages and of the system may
    be read.
    """
    _watch()
    before = getattr(_current, "allowed", None)
    _current.allowed = flow, {os.path.realpath(file) for file in files}
    try:
        yield
    finally:
        _current.allowed = before


@cache
def _watch() -> None:
    sys.addaudithook(_check)


@cache
def _system() -> tuple[str, ...]:
    python = (sys.prefix, sys.base_prefix, site.getusersitepackages())
    return (
        *(f"{folder}/" for folder in {*python, *map(os.path.realpath, python)}),
        "/proc/",
        "/sys/",
        "/dev/",
        "/etc/",
        "/usr/",
        "/lib/",
    )


def _check(event: str, arguments: tuple[Any, ...]) -> None:
    if event != "open" or getattr(_current, "allowed", None) is None:
        return
    name, mode, flags = arguments
    writes = set(mode) & set("wax") if isinstance(mode, str) else flags & (os.O_WRONLY | os.O_RDWR)
    if writes or not isinstance(name, str | bytes | os.PathLike):
        return
    flow, files = _current.allowed
    path = os.path.realpath(os.fsdecode(name))
    if path in files or path.endswith(_CODE) or path.startswith(_system()) or not Path(path).is_file():
        return
    raise FrameError(
        f"{flow}: it opens {path}, which its shot does not name, so changes to it would not update any "
        "frame. "
        f"Write reads: [{Path(path).name}], with its folder, beside function."
    )
