"""What can go wrong between arrays and a film, each with the exit code the command line answers with.

A message says place, fact, rule and remedy, in one line.
"""

from __future__ import annotations


class RenderError(Exception):
    """Anything about a picture that a user can be told in one line."""

    exit_code = 2


class BadInputError(RenderError):
    """A surface, a value or a name that cannot be rendered (exit code 2)."""


class MissingImageError(RenderError):
    """A picture or a movie that is named but not there (exit code 3)."""

    exit_code = 3


class CorruptImageError(RenderError):
    """A picture or a movie that is there but cannot be read to its end (exit code 1)."""

    exit_code = 1


class RenderEnvironmentError(RenderError):
    """The machine's fault: disk full, no permission, no renderer that works (exit code 4)."""

    exit_code = 4
