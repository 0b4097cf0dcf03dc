"""The file that FFmpeg writes to."""

from __future__ import annotations

from pathlib import Path


class Sink:
    """Keeps the disk's complaint until somebody can hear it.

    FFmpeg calls back into Python to write, where an exception would be printed and lost.
    """

    def __init__(self, path: Path) -> None:
        self.name = str(path)
        self.error: OSError | None = None
        self._file = path.open("w+b", buffering=0)

    def write(self, data: bytes) -> int:
        view = memoryview(data)
        while len(view) and self.error is None:
            try:
                view = view[self._file.write(view) :]
            except OSError as error:
                self.error = error
        return len(data)

    def read(self, size: int) -> bytes:
        """A second pass over what was written moves a movie's index to its beginning."""
        return self._file.read(size) or b""

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()

    def close(self) -> None:
        self._file.close()

    def check(self) -> None:
        if self.error is not None:
            raise self.error
