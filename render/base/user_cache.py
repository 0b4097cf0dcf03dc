"""Folders of what is cached for the user: compiled kernels, and answers that are slow to find.

numba and Dr.Jit run what they find in their caches. So a folder is trusted only where nobody else could have
put files into it: it and all folders above it belong to the user or to root, and others may not write there.
One that only root may write, as in a container's image, is read and not written.
"""

from __future__ import annotations

import hashlib
import json
import os
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import platformdirs

from flowsculpt.render.base.atomic_write import atomic_write
from flowsculpt.render.base.render_errors import MachineError
from flowsculpt.render.base.root_files import remove_file
from flowsculpt.render.base.state_files import mapping, read_state

T = TypeVar("T")

WARNED = "FLOWSCULPT_CACHE_WARNED"
"""The environment variable by which a process lets those it starts know that the user was warned."""

SHIPPED = Path(__file__).absolute().parents[1] / "compiled"
"""Compiled kernels that came with the packages, and are trusted as these are; others have no such folder."""

KEPT_SECONDS = 60 * 24 * 3600.0
"""Seconds without use after which what is kept for speed alone is removed."""

_UNMAPPED = 65534
"""The owner that files of others have in a container with user namespaces, those of root too."""


def readable_cache() -> Path:
    """Return the user's cache folder where it can be trusted, even if only root may write there."""
    folder = platformdirs.user_cache_path("flowsculpt")
    return folder if _is_readable(folder) else writable_cache()


def writable_cache() -> Path:
    """Return the user's cache folder or, where it cannot be written or trusted, one among temporary files.

    Where not even that can be trusted, the folder is of this process alone.
    """
    return _first_writable(platformdirs.user_cache_path("flowsculpt"))


def _folders_for_cache(own: Path) -> Iterator[Path]:
    yield own
    # Parsers may write nothing, not even the file by which Python finds this folder.
    yield Path(tempfile.gettempdir()) / f"flowsculpt-cache-{user_number()}"


def kernel_homes() -> tuple[Path, ...]:
    """Return the folders with compiled kernels of all kinds; new ones are written to the second."""
    return readable_cache() / "kernels", writable_cache() / "kernels", SHIPPED


@cache
def _is_readable(folder: Path) -> bool:
    return folder.is_dir() and intruder(folder) is None


@cache
def _first_writable(own: Path) -> Path:
    for folder in _folders_for_cache(own):
        with suppress(OSError):
            _make_private(folder)
            reason = intruder(folder)
            if reason is None and os.access(folder, os.W_OK):
                return folder
            if reason is not None:
                _warn(
                    f"{folder}: this cache is not used: {reason}, and files in it would run as code; remove "
                    "that permission, or set XDG_CACHE_HOME to a folder of your own"
                )
    return Path(tempfile.mkdtemp(prefix="flowsculpt-cache-"))


def intruder(folder: Path) -> str | None:
    """Return who else may change what a folder holds, as "others may write …"; None where nobody may."""
    if os.name != "posix":  # access is not in the mode there; a user's own folder is private
        return None
    inner = {folder.absolute(), folder.resolve()}
    outer = {parent for path in inner for parent in path.parents}
    for place in (*inner, *outer):
        try:
            found = place.lstat()
        except OSError as error:
            return f"{place} cannot be read ({error.strerror})"
        if found.st_uid not in (os.getuid(), 0) and not (place in outer and found.st_uid == _UNMAPPED):
            return f"{place} belongs to user {found.st_uid}"
        each_their_own = place in outer and found.st_mode & stat.S_ISVTX  # as in /tmp
        by_group = found.st_mode & stat.S_IWGRP and not _is_alone_in(found.st_gid)
        is_open = found.st_mode & stat.S_IWOTH or by_group
        if is_open and not (each_their_own or stat.S_ISLNK(found.st_mode)):
            return f"others may write {place}"
    return None


def user_number() -> int:
    """Return the number of the user; 0 on systems that have none."""
    return os.getuid() if hasattr(os, "getuid") else 0


def _is_alone_in(group: int) -> bool:
    """Tell whether a group is the user's own, which many systems make for each user. Root's is."""
    import grp
    import pwd

    with suppress(KeyError):
        user, named = pwd.getpwuid(os.getuid()), grp.getgrgid(group)
        return named.gr_name == user.pw_name and set(named.gr_mem) <= {user.pw_name}
    return group == 0


def _make_private(folder: Path) -> None:
    """Create a folder, and those above it that are missing, for the user alone."""
    for place in (*reversed(folder.absolute().parents), folder):
        if not place.exists():
            place.mkdir(mode=0o700, exist_ok=True)


def _warn(message: str) -> None:
    if WARNED not in os.environ:
        os.environ[WARNED] = "1"
        print(message, file=sys.stderr)


@dataclass(frozen=True)
class CachedAnswer:
    """A file of JSON, mostly in the user's cache, for what takes long to find out again.

    What cannot be used, because it is damaged or of another version, counts as none.
    """

    path: Path

    @classmethod
    def of(cls, kind: str, depends_on: Sequence[str], suffix: str = ".json") -> CachedAnswer:
        """Return the file of an answer. Its name is a hash of all that the answer depends on."""
        name = hashlib.blake2b("\n".join(depends_on).encode(), digest_size=12).hexdigest()
        return cls(readable_cache() / kind / f"{name}{suffix}")

    @staticmethod
    def home() -> Path:
        """Return the folder for files of any kind: the user's cache, or another one if that is read-only."""
        return writable_cache()

    def load(self, reader: Callable[[dict[str, Any]], T]) -> T | None:
        """Return what `reader`, as `read_state` takes it, makes of JSON; None where there is none."""
        return read_state(self.path, lambda answer: reader(mapping(answer)))

    def store(self, answer: dict[str, Any]) -> None:
        """Store JSON. A folder that cannot be written only means that the next process asks again."""
        with suppress(MachineError), atomic_write(self.path, flush=False) as draft:
            draft.write_text(json.dumps(answer), encoding="utf-8")

    def store_alone(self, answer: dict[str, Any]) -> None:
        """Store JSON, and remove answers of its kind that nobody has stored or used for long."""
        remove_unused(self.path.parent)
        self.store(answer)


def remove_unused(folder: str | Path) -> None:
    """Remove files of a folder of the cache that nobody used for KEPT_SECONDS."""
    oldest = time.time() - KEPT_SECONDS
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            with suppress(OSError):
                if entry.stat().st_mtime < oldest:
                    remove_file(Path(entry.path))
