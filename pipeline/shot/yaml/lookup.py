"""Files that shots and commands name: whether they are there, what they hold, how messages show names."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

from pipeline.errors import MissingInputError


def is_there(path: Path) -> bool:
    """Whether a path names a file; one that can name none, being too long for one, does not."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def digest_of_file(path: Path) -> str:
    """SHA-256 of a file's contents. Raises MissingInputError where it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise MissingInputError(
            f"{path}: it cannot be read ({error.strerror or error}); look at its permissions"
        ) from None


def shown(name: str | Path) -> str:
    """A name as a message holds it: not too long, and without what cannot be printed."""
    text = str(name) if str(name).isprintable() else repr(str(name))
    return text if len(text) <= 200 else f"{text[:100]}…{text[-40:]}"


DEFAULTS = "defaults.yaml"
"""Beside shots: what holds for all of them unless they say otherwise."""

_EDIT, _SHOT = re.compile(r"^shots\s*:", re.MULTILINE), re.compile(r"^(subject|extends)\s*:", re.MULTILINE)


def is_edit(path: Path) -> bool:
    """Whether a file names shots, and no subject of its own: told even where it is no good YAML.

    A file that cannot be read is none; whoever reads it says why.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return False
    return bool(_EDIT.search(text)) and not _SHOT.search(text)
