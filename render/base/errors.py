"""The errors of the whole project, each with the exit code that the command line answers with.

A message says place, fact, rule and remedy, in that order and in one line.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


class FlowsculptError(Exception):
    """Base class: anything that a user can be told in one line. `exit_code` is what the process ends with."""

    exit_code = 2


class MachineError(FlowsculptError):
    """The machine's fault: disk full, no permission, no renderer that works (exit code 4)."""

    exit_code = 4


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
    text = " ".join(str(error).split()) or type(error).__name__
    text = text if text.isprintable() else ascii(text)
    return text if len(text) <= 120 else text[:117] + "…"


MOST_LISTED = 20
"""Most names that a suggestion lists."""


def suggestion(word: object, names: Iterable[str], cutoff: float = 0.66, listing: str = "") -> str:
    """Return the remedy for an unknown name: `Did you mean 'vortex'?`, or the names there are.

    cutoff   similarity that a name needs to be proposed, 0 to 1
    listing  a sentence that says where to find the names if they are more than MOST_LISTED
    """
    known = list(names)
    spelt = str(word).strip().lower().replace("-", "_").replace(" ", "_")
    close = [spelt] if spelt in known else get_close_matches(str(word), known, n=1, cutoff=cutoff)
    if close:
        return f"Did you mean {close[0]!r}?"
    if len(known) <= MOST_LISTED:
        return f"There are: {', '.join(known)}."
    return f"There are {len(known)}, such as {', '.join(known[:3])}. {listing}".rstrip()
