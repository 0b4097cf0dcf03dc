"""Where compiled kernels live, and the decorator that makes those of pictures.

numba's on-disk cache does not notice edits in functions that a kernel calls from another file, and would run
what was compiled with the old ones: so the cache folder is named by a hash of every kernel source.
"""

from __future__ import annotations

import getpass
import hashlib
import os
import stat
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba
import platformdirs

F = TypeVar("F", bound=Callable[..., Any])


def compiled(**options: Any) -> Callable[[F], F]:
    """`numba.njit` in our cache folder, without the interpreter's lock and its errors of division."""

    def decorate(function: F) -> F:
        numba.config.CACHE_DIR = str(_folder())
        dispatcher: F = numba.njit(cache=True, nogil=True, error_model="numpy", **options)(function)
        return dispatcher

    return decorate


@cache
def _folder() -> Path:
    return folder_of(Path(__file__).parent, Path(__file__))


def folder_of(package: Path, *more: Path) -> Path:
    """The folder of the kernels below a package, in the user's cache or, where unwritable, among temporary
    files.

    numba runs what it finds there, so a folder among temporary files is taken only where it is the user's
    own and closed to others; else the kernels are compiled anew, into a folder of this process.
    """
    digest = hashlib.sha256(f"{numba.__version__} SVML={numba.config.USING_SVML}".encode())
    for file in (*more, *sorted(package.rglob("_kernels*.py"))):
        digest.update(file.read_bytes())
    name = digest.hexdigest()[:16]
    for base in (_user_cache, _temporary_cache):
        try:
            folder = base() / "kernels" / name
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return folder
    return Path(tempfile.mkdtemp(prefix="flowsculpt-kernels-"))


def _user_cache() -> Path:
    return platformdirs.user_cache_path("flowsculpt")


def _temporary_cache() -> Path:
    """A folder that is named after the user and theirs alone. Raises PermissionError where it is not."""
    user = os.getuid() if hasattr(os, "getuid") else getpass.getuser()
    folder = Path(tempfile.gettempdir()) / f"flowsculpt-cache-{user}"
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    if hasattr(os, "getuid") and (found.st_uid != user or stat.S_IMODE(found.st_mode) & 0o077):
        raise PermissionError(f"{folder} is open to others")
    if not stat.S_ISDIR(found.st_mode):
        raise PermissionError(f"{folder} is a link")
    return folder
