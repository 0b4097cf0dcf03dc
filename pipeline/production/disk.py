"""What the disk can refuse, said once: full, read-only, no permission."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.errors import MachineError

_REMEDIES = {
    errno.ENOSPC: "the disk is full; free some space and run again; nothing done is lost",
    errno.EDQUOT: "the disk quota is used up; free some space or ask for more",
    errno.EFBIG: "the file is larger than this process may write; raise `ulimit -f`",
    errno.EROFS: "the file system is read-only; choose another folder with --root",
    errno.EACCES: "permission denied; choose another folder with --root or change its owner",
    errno.EPERM: "not permitted; choose another folder with --root or change its owner",
}


@contextmanager
def disk_faults(path: Path) -> Iterator[None]:
    """Turn what the disk refuses at `path` into an MachineError of one line."""
    try:
        yield
    except OSError as error:
        if error.errno not in _REMEDIES:
            raise
        raise MachineError(f"{path}: {_REMEDIES[error.errno]}") from error
