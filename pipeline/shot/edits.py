"""Which of the files beside shots are edits: what a film is cut by, rather than what it is cut from."""

from __future__ import annotations

import re
from pathlib import Path

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
