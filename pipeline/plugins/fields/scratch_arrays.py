"""Arrays that are read again and again, in a temporary file: what is not touched takes no memory."""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

ON_DISK = Path("/var/tmp")
"""Where temporary files are on a disk, also if /tmp is in memory."""

KEPT_FREE = 0.1  # share of the disk that stays free


class ScratchArrays:
    """Float32 arrays of one shape, by numbers. The file has no name and ends with them.

    Where its disk is full or fails, arrays are not kept.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._shape, self._numbers = shape, set[int]()

    def add(self, number: int, array: np.ndarray, is_written: bool = True) -> np.ndarray | None:
        """Return the array in the file, where it is not there yet; None where the disk has no room.

        is_written  False only makes room: it is 0
        """
        try:
            disk = shutil.disk_usage(self._folder)
            if disk.free - array.nbytes < KEPT_FREE * disk.total:
                return None
            left, place = array.data.cast("B"), number * array.nbytes
            if not is_written:
                os.posix_fallocate(self._file.fileno(), place, array.nbytes)
            while left and is_written:
                written = os.pwrite(self._file.fileno(), left, place)
                left, place = left[written:], place + written
        except (OSError, AttributeError):  # macOS cannot make room
            return None
        self._numbers.add(number)
        return self.get(number)

    def get(self, number: int) -> np.ndarray | None:
        """Return an array, of which memory holds what is touched; None where it is not there."""
        if number not in self._numbers:
            return None
        size = 4 * int(np.prod(self._shape))
        return np.memmap(self._file, np.float32, "r+", number * size, self._shape)

    @cached_property
    def _folder(self) -> str:
        is_usual = "TMPDIR" not in os.environ and ON_DISK.is_dir()
        return str(ON_DISK) if is_usual else tempfile.gettempdir()

    @cached_property
    def _file(self) -> Any:
        file = tempfile.TemporaryFile(prefix="flowsculpt-", dir=self._folder)  # noqa: SIM115  # closed below
        weakref.finalize(self, file.close)
        return file
