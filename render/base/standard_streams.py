"""Standard output and standard error where they are closed, full, without a reader, or of another encoding.

Results go to standard output. Where they cannot be written the command ends with one line and exit code 4,
or quietly where their reader has left. Messages go to standard error: what that refuses is lost, and the work
goes on.
"""

from __future__ import annotations

import codecs
import errno
import io
import os
import select
import sys
from pathlib import Path
from typing import Any

from flowsculpt.render.base.render_errors import MachineError

READER_LEFT = 141
"""Exit code where the reader of a pipe has left, as shells have it: 128 and the number of SIGPIPE."""

LIKENESS = "flowsculpt.likeness"
"""The name of the error handler that writes similar characters for those that an encoding lacks."""

_SIMILAR = {"–": "-", "—": "-", "×": "x", "·": "-", "…": "...", "→": "->", "≤": "<=", "≥": ">=", "°": " deg"}


class OutputError(MachineError):
    """Standard output cannot be written (exit code 4, or READER_LEFT)."""

    def __init__(self, error: OSError) -> None:
        closed = "standard output: cannot be written: it is closed; send it to a file, or to /dev/null"
        is_closed = error.errno == errno.EBADF
        super().__init__(closed if is_closed else str(MachineError.of_path(Path("standard output"), error)))
        if error.errno == errno.EPIPE:
            self.exit_code = READER_LEFT


class _Results(io.FileIO):
    """The file of standard output. Raises OutputError."""

    def write(self, content: Any) -> int:
        try:
            while (count := super().write(content)) is None:  # a pipe that is full, and does not block
                select.select([], [self], [])
        except OSError as error:
            raise OutputError(error) from error
        return count


class _Messages(_Results):
    """The file of standard error. Takes everything, and loses what it cannot write."""

    def write(self, content: Any) -> int:
        try:
            return super().write(content)
        except OutputError:
            return len(content)


def prepare_streams() -> None:
    """Open standard output and standard error as this module has them.

    Closed standard streams become ones that refuse what is written. Otherwise the next file that is opened
    would have the number of one, and what a library prints would end in it.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDONLY)  # takes the lowest free number
            os.set_inheritable(number, True)
    codecs.register_error(LIKENESS, write_similar)
    sys.stdout, sys.stderr = (
        _stream(_Results(1, "w", closefd=False)),
        _stream(_Messages(2, "w", closefd=False)),
    )


def _stream(file: io.FileIO) -> io.TextIOWrapper:
    """Return a text stream to a file, in the encoding that Python has chosen for the standard stream."""
    chosen = sys.__stdout__ if file.fileno() == 1 else sys.__stderr__
    encoding = chosen.encoding if chosen else None  # none was open
    by_line = file.isatty() or file.fileno() == 2
    return io.TextIOWrapper(io.BufferedWriter(file), encoding, LIKENESS, line_buffering=by_line)


def discard_output() -> None:
    """Send what standard output still holds nowhere, so that Python does not fail at it when it ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.close(nowhere)


def write_similar(error: UnicodeError) -> tuple[str, int]:
    """Return what is written for characters that an encoding lacks: similar ones, or their numbers."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = error.object[error.start : error.end]
    escaped = (_SIMILAR.get(c) or c.encode("ascii", "backslashreplace").decode() for c in lacking)
    return "".join(escaped), error.end
