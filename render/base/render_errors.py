"""The errors of the whole project, each with the exit code that the command line answers with.

A message says place, fact, rule and remedy, in that order and in one line.
"""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path

MOST_QUOTED = 80
"""Most characters of a value that a message quotes."""

PROBE = 65536
"""Bytes that tell whether a disk takes more."""

REMEDIES = {
    errno.ENOSPC: "the disk is full; free some space and run again; finished work is kept",
    errno.EDQUOT: "the disk quota is used up; free some space or ask for more",
    errno.EFBIG: "the file is larger than this process may write; raise `ulimit -f`",
    errno.EROFS: "the file system is read-only; choose another folder (--root)",
    errno.EACCES: "permission denied; choose another folder (--root) or change its owner",
    errno.EPERM: "not permitted; choose another folder (--root) or change its owner",
    errno.ENOTDIR: "a file stands where a folder should be; choose another folder",
    errno.EEXIST: "a file stands where a folder should be; choose another folder",
    errno.EISDIR: "a folder stands where a file should be; move it away",
    errno.EIO: "the disk reports an error; check it, then run `flowsculpt verify`",
    errno.ESTALE: "the network folder is no longer mounted; mount it again",
    errno.ELOOP: "links point at each other; remove one of them",
    errno.ENAMETOOLONG: "the name is too long for this file system; choose a shorter one",
}
"""Remedies by error number, for files that the operating system refuses."""


_LONGEST_WORD, _LONGEST_LINE = 250, 1500


class FlowsculptError(Exception):
    """Base class: anything that a user can be told in one line. `exit_code` is what the process ends with.

    Its message is of a length to read, whatever is quoted in it.
    """

    exit_code = 2

    def __init__(self, message: str = "") -> None:
        super().__init__(readable(message))


class MachineError(FlowsculptError):
    """The machine's fault: disk full, no permission, no renderer that works (exit code 4).

    full_disk  the file that a full disk, or a quota that is used up, did not take; None for other faults
    """

    exit_code = 4
    full_disk: Path | None = None

    @classmethod
    def of_path(cls, path: Path, error: OSError, verb: str = "written") -> MachineError:
        """Return the error of a path, which the operating system refused to have written, or read."""
        fact = REMEDIES.get(error.errno or 0) or os.strerror(error.errno or errno.EIO)
        if error.errno == errno.ENOENT:
            fact = "its folder was removed meanwhile; run again to make it again"
            if error.filename is not None and Path(os.fsdecode(error.filename)) in path.parents:
                fact = f"the folder {os.fsdecode(error.filename)} cannot be made; name another"
        fault = cls(f"{path}: cannot be {verb}: {fact}")
        fault.full_disk = path if error.errno in (errno.ENOSPC, errno.EDQUOT) else None
        return fault

    @classmethod
    def of_draft(cls, path: Path, draft: Path, reason: str) -> MachineError:
        """Return the error of a path whose draft a library failed to write without an errno.

        What the operating system refuses is found out by writing more to the draft.
        """
        try:
            with draft.open("ab") as file:
                file.write(bytes(PROBE))
        except OSError as error:
            return cls.of_path(path, error)
        return cls(
            f"{path}: cannot be written: {reason}; check the disk's free space and the folder's permissions"
        )


class MissingInputError(FlowsculptError):
    """A named file or shot that does not exist, or cannot be opened (exit code 3)."""

    exit_code = 3


class RenderError(FlowsculptError):
    """Base class of what is wrong with a picture, a movie or what they are made from."""


class BadInputError(RenderError):
    """A surface, a value or a name that cannot be rendered (exit code 2)."""


class MissingImageError(RenderError):
    """A picture or a movie that is named but not there (exit code 3)."""

    exit_code = 3


class CorruptImageError(RenderError):
    """A picture or a movie that is there but cannot be read to its end (exit code 1)."""

    exit_code = 1


def reason_of(error: Exception) -> str:
    """Return the text of a parser's error on one line, shortened for a message."""
    text = printable(" ".join(str(error).split()) or type(error).__name__)
    return text if len(text) <= 120 else text[:117] + "…"


def quote(value: object) -> str:
    """Return the repr of a value for a message; a long one loses its middle."""
    return shorten(repr(value))


def shorten(value: object) -> str:
    """Return a value, or why an error was raised, as printable text for a message; a long one is cut."""
    if isinstance(value, Exception):
        return reason_of(value)
    text = printable(str(value))
    return text if len(text) <= MOST_QUOTED else f"{text[:50]}…{text[-5:]}"


def printable(text: str) -> str:
    r"""Return text with what does not show spelt out, such as line ends and no-break spaces: ``\xa0``."""
    return text if text.isprintable() else "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def readable(message: str) -> str:
    """Return a message whose long words lose their middle, and long lines their end.

    What does not show, such as characters by which a file could command a terminal, is spelt out.
    """
    message = "\n".join(map(printable, message.split("\n")))
    words = re.sub(rf"\S{{{_LONGEST_WORD},}}", lambda word: f"{word[0][:50]}…{word[0][-80:]}", message)
    lines = (line if len(line) <= _LONGEST_LINE else f"{line[:_LONGEST_LINE]}…" for line in words.split("\n"))
    return "\n".join(lines)


MOST_LISTED = 20
"""Most names that a suggestion lists."""


def suggest(word: object, names: Iterable[str], cutoff: float = 0.66, listing: str = "") -> str:
    """Return the remedy for an unknown name: `Did you mean 'vortex'?`, or the names there are.

    cutoff   similarity that a name needs to be proposed, 0 to 1
    listing  a sentence that says where to find the names if they are more than MOST_LISTED
    """
    known = list(map(printable, names))
    spelt = str(word).strip().lower().replace("-", "_").replace(" ", "_")
    close = [spelt] if spelt in known else get_close_matches(str(word), known, n=1, cutoff=cutoff)
    if close:
        return f"Did you mean {close[0]!r}?"
    if len(known) <= MOST_LISTED:
        return f"There are: {', '.join(known)}."
    return f"There are {len(known)}, such as {', '.join(known[:3])}. {listing}".rstrip()
