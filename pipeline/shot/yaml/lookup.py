"""Files beside shots: whether they are there, what they hold, which are edits, and names in messages."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

from pipeline.errors import MissingInputError

DEFAULTS = "defaults.yaml"
"""The file beside shots that holds defaults for all of them."""

_EDIT, _SHOT = re.compile(r"^shots\s*:", re.MULTILINE), re.compile(r"^(subject|extends)\s*:", re.MULTILINE)


def is_there(path: Path) -> bool:
    """Tell whether a path names a file; a name too long for a file does not."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def is_folder(path: Path) -> bool:
    """Tell whether a path names a folder; a name too long for one does not."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def is_edit(path: Path) -> bool:
    """Tell whether a file is an edit: it lists shots and has no subject. Works on broken YAML too.

    False for a file that cannot be read; whoever reads it reports why.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return False
    return bool(_EDIT.search(text)) and not _SHOT.search(text)


def digest_of_file(path: Path) -> str:
    """Return the SHA-256 of a file's contents. Raises MissingInputError where it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise MissingInputError(
            f"{path}: it cannot be read ({error.strerror or error}); look at its permissions"
        ) from None


def shown(name: str | Path) -> str:
    """Return a name for a message: at most 200 characters, and printable."""
    text = str(name) if str(name).isprintable() else repr(str(name))
    return text if len(text) <= 200 else f"{text[:100]}…{text[-40:]}"
