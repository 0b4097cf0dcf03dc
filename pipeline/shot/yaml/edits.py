"""Which of the files beside shots are none: edits, by which films are cut, and what holds for all shots."""

from __future__ import annotations

import re
from pathlib import Path

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
