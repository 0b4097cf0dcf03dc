"""Write files whole or not at all, and say in one line what the disk refuses.

Every file of the project that another process may read is written through `atomic_write`.

A file that must hold what was read from it cannot be compared and replaced in one step. Under Linux the new
and the old file change places in one step; the old one is compared then, and put back where it is another.
Elsewhere, and on file systems that cannot do that, it is compared right before it is replaced, which leaves
others some microseconds.
"""

from __future__ import annotations

import ctypes
import errno
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from flowsculpt.render.base.drafts import draft_name
from flowsculpt.render.base.render_errors import MachineError
from flowsculpt.render.base.root_files import held, scratch_of

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
    """Have two files change places; return False where the system cannot.

    Raises ChangedFileError where one is not there any more, and OSError.
    """
    rename = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if rename is None:
        return False
    if rename(_AT_FDCWD, os.fsencode(one), _AT_FDCWD, os.fsencode(other), _RENAME_EXCHANGE) == 0:
        return True
    number = ctypes.get_errno()
    if number in _UNSUPPORTED:
        return False
    if number == errno.ENOENT:  # somebody has just moved it away, to save another
        raise ChangedFileError
    raise OSError(number, os.strerror(number), str(other))


@contextmanager
def atomic_write(
    path: Path,
    draft: Path | None = None,
    *,
    flush: bool = True,
    is_same: Callable[[Path], bool] | None = None,
) -> Iterator[Path]:
    """Yield a temporary path to write to. When the block ends, it replaces `path`; if it raises, it goes.

        with atomic_write(path) as draft:
            draft.write_text(text)

    Missing folders are made, and below a root no link is followed (`root_files`). The temporary path has the
    suffix of `path`. Threads, processes and hosts may write one path at once: the last one wins.

    draft    temporary path, on the file system of `path`; by default a hidden file next to it, or for the
             state of a root a file in its folder for drafts
    flush    write through to the disk first, so that `path` survives a power failure; caches need not
    is_same  returns True if the file at a path is still the one that was read: others' changes are kept

    Raises MachineError where the operating system refuses, and ChangedFileError where `is_same` is false.
    Where the file is only a cache, suppress MachineError.
    """
    if draft is None:
        name, scratch = draft_name(path.suffix), scratch_of(path)
        draft = scratch / name if scratch else path.with_name(f".{name}")
    place, folder, name = path.parent, draft.parent, draft.name
    try:
        with disk_errors(path), held(place, make=True) as place, held(folder, make=True) as folder:
            draft = folder / name
            try:
                yield draft
                if flush:
                    with draft.open("rb") as file:
                        os.fsync(file.fileno())
                if is_same is None:
                    draft.replace(place / path.name)
                else:
                    replace_unchanged(draft, place / path.name, is_same)
            finally:
                with suppress(OSError):  # not there, or its folder is a file
                    draft.unlink()
    except MachineError as error:  # of a writer that knows only the draft
        renamed = MachineError(str(error).replace(str(draft), str(path)))
        renamed.full_disk = path if error.full_disk else None
        raise renamed from error


def write_text(path: Path, text: str, *, flush: bool = True) -> None:
    """Write a file of text, whole or not at all: see `atomic_write`."""
    with atomic_write(path, flush=flush) as draft:
        draft.write_text(text, encoding="utf-8")


@contextmanager
def disk_errors(path: Path) -> Iterator[None]:
    """Turn an OSError in the block into a MachineError of one line about `path`."""
    try:
        yield
    except OSError as error:
        raise MachineError.of_path(path, error) from error


def make_folder(folder: Path) -> None:
    """Make a folder, and those above it, where they are missing. Raises MachineError."""
    with disk_errors(folder), held(folder, make=True):
        pass


@contextmanager
def atomic_folder(place: Path, prefix: str) -> Iterator[Path]:
    """Yield a new folder beside a place, which is renamed to it when the block ends; if it raises, it goes.

    prefix  of the name of the new folder, which a process that is killed leaves behind

    Raises MachineError where the disk refuses.
    """
    with disk_errors(place), held(place.parent, make=True) as home:
        draft = Path(tempfile.mkdtemp(prefix=prefix, dir=home))
        draft.chmod(0o755)
        try:
            yield draft
            draft.rename(home / place.name)
        finally:
            shutil.rmtree(draft, ignore_errors=True)
