"""Replace a file only while it holds what was read from it: what somebody else saves meanwhile wins.

A file cannot be compared and replaced in one step. Under Linux the new and the old file change places in one
step; the old one is compared then, and put back where it is another. Elsewhere, and on file systems that
cannot do that, it is compared right before it is replaced, which leaves others some microseconds.
"""

from __future__ import annotations

import ctypes
import errno
import os
from collections.abc import Callable
from pathlib import Path

_AT_FDCWD, _RENAME_EXCHANGE = -100, 2
"""Constants of Linux: paths are relative to the working folder; both are renamed to each other."""

_UNSUPPORTED = (errno.ENOSYS, errno.EINVAL, errno.EOPNOTSUPP, errno.EPERM)


class ChangedFileError(Exception):
    """Raised where a file does not hold any more what was read from it."""


def replace_unchanged(draft: Path, path: Path, is_same: Callable[[Path], bool]) -> None:
    """Rename a draft to `path`.

    is_same  returns True if the file at a path, or its absence, is still what was read from `path`

    Raises ChangedFileError where it is not, and OSError; `path` then has what others have written.
    """
    if not is_same(path):
        raise ChangedFileError
    ours = draft.stat()
    if not path.exists():
        _place(draft, path)
    elif not _exchange(draft, path):
        draft.replace(path)
    elif not is_same(draft):
        _exchange(draft, path)
        if not os.path.samestat(draft.stat(), ours) or draft.stat().st_mtime_ns != ours.st_mtime_ns:
            draft.replace(path)  # somebody has saved once more in between
        raise ChangedFileError


def _place(draft: Path, path: Path) -> None:
    """Rename a draft to a path that nothing has, or raise ChangedFileError."""
    try:
        path.hardlink_to(draft)
    except FileExistsError:
        raise ChangedFileError from None
    except OSError:  # a file system without links
        draft.replace(path)


def _exchange(one: Path, other: Path) -> bool:
    """Have two files change places; return False where the system cannot. Raises OSError."""
    rename = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if rename is None:
        return False
    if rename(_AT_FDCWD, os.fsencode(one), _AT_FDCWD, os.fsencode(other), _RENAME_EXCHANGE) == 0:
        return True
    number = ctypes.get_errno()
    if number in _UNSUPPORTED:
        return False
    raise OSError(number, os.strerror(number), str(other))
