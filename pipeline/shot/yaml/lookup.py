"""Files beside shots: whether they are there, which are edits, and names in messages."""

from __future__ import annotations

import re
from pathlib import Path

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


def shown(name: str | Path) -> str:
    """Return a name for a message: at most 200 characters, and printable."""
    text = str(name) if str(name).isprintable() else repr(str(name))
    return text if len(text) <= 200 else f"{text[:100]}…{text[-40:]}"
