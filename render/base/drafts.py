"""Drafts: files that are not finished, named after the host and the process that writes them.

So whoever comes later knows which are left of killed processes.
"""

from __future__ import annotations

import os
import platform
import re
import tempfile
import time
import uuid
from contextlib import suppress
from pathlib import Path

from flowsculpt.render.base.processes import is_at_work
from flowsculpt.render.base.root_files import held, remove_file

OLD_DRAFT = 24 * 3600.0
"""Seconds after which a draft of another host counts as left behind."""

_HIDDEN = re.compile(r"\..+\+\d+\+[0-9a-f]{32}(\.\w+)?")
"""The names of hidden drafts, next to the files that they become."""


def draft_name(suffix: str = "") -> str:
    """Return a new name for an unfinished file."""
    return f"{platform.node()}+{os.getpid()}+{uuid.uuid4().hex}{suffix}"


def sweep_drafts(folder: Path) -> None:
    """Remove what killed processes left in a folder for drafts alone.

    Those are drafts of dead processes of this host, and old ones of other hosts, whose processes nobody here
    can ask for.
    """
    with suppress(OSError):
        _sweep(folder, sorted(folder.iterdir()))


def sweep_hidden_drafts(folder: Path, pattern: str = "") -> None:
    """Remove the hidden drafts of killed processes in a folder; by `**/` in those below too."""
    with suppress(OSError):
        found = (path for path in folder.glob(f"{pattern}.*+*+*") if _HIDDEN.fullmatch(path.name))
        _sweep(folder, list(found))


def disk_time(folder: Path) -> float:
    """Return the time of the clock that dates files in a folder, which may be a file server's."""
    try:
        with held(folder) as place, tempfile.TemporaryFile(dir=place) as file:
            return os.fstat(file.fileno()).st_mtime
    except OSError:
        return time.time()


def _sweep(folder: Path, drafts: list[Path]) -> None:
    now = disk_time(folder) if drafts else 0.0
    for path in drafts:
        if _is_left_behind(path, now):
            remove_file(path)


def _is_left_behind(draft: Path, now: float) -> bool:
    host, _, rest = draft.name.lstrip(".").partition("+")  # a writer's own draft of it begins with a point
    number = rest.partition("+")[0]
    if host == platform.node() and number.isdecimal():
        return int(number) == os.getpid() or not is_at_work(int(number))
    return not number or now - draft.stat().st_mtime > OLD_DRAFT
