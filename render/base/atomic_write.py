"""Files that appear under their name only when whole."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from render.base.errors import RenderEnvironmentError


@contextmanager
def appearing(path: Path) -> Iterator[Path]:
    """A temporary name beside `path`; what is written there is flushed to the disk and takes its place.

    Where writing fails, nothing stays behind. Raises RenderEnvironmentError for what the operating
    system refuses: a full disk, a folder that cannot be written.
    """
    temporary = path.with_name(f".{path.stem}.tmp{os.getpid()}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        raise cannot_write(path, error.strerror or str(error)) from None
    finally:
        with suppress(OSError):  # not there, or its folder is no folder
            temporary.unlink()


def cannot_write(path: Path, reason: str) -> RenderEnvironmentError:
    """The error for a file that could not be written, in the words a user reads."""
    return RenderEnvironmentError(
        f"{path}: cannot be written ({reason}); look at the disk's free space and the folder's permissions"
    )
