"""What the disk can refuse, said once: full, read-only, no permission."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.errors import MachineError

_REMEDIES = {
    errno.ENOSPC: "the disk is full; free some space and run again, nothing done is lost",
    errno.EDQUOT: "the disk quota is used up; free some space or ask for more",
    errno.EFBIG: "the file is larger than this process may write; raise `ulimit -f`",
    errno.EROFS: "the file system is read-only; choose another folder with --root",
    errno.EACCES: "permission denied; choose another folder with --root or change its owner",
    errno.EPERM: "not permitted; choose another folder with --root or change its owner",
    errno.ENOTDIR: "a file stands where a folder should be; choose another folder with --root",
    errno.EEXIST: "a file stands where a folder should be; choose another folder with --root",
    errno.EISDIR: "a folder stands where a file should be; move it away",
    errno.ENAMETOOLONG: "the name is too long for this file system; choose a shorter one",
}


@contextmanager
def disk_faults(path: Path) -> Iterator[None]:
    """Turn what the system refuses at `path` into a MachineError of one line."""
    try:
        yield
    except OSError as error:
        fact = _REMEDIES.get(error.errno or 0) or os.strerror(error.errno or errno.EIO)
        raise MachineError(f"{path}: {fact}") from error
