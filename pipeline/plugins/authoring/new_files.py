"""New files of a show: each is written whole or not at all, and none replaces another."""

from __future__ import annotations

import filecmp
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

from flowsculpt import UsageError
from flowsculpt.api.files import ChangedFileError, atomic_write

Content = str | Path | Callable[[Path], object]
"""What a new file holds: a text, the contents of a file, or what a function writes to a path."""


def same_contents(file: Path, copied: Path, remedy: str = "rename one of the two files") -> bool:
    """Tell whether a copy of a file is there already. Raises UsageError where it has other contents."""
    if not copied.exists():
        return False
    if file.is_file() and not filecmp.cmp(file, copied, shallow=False):
        raise UsageError(f"{copied} is there already with other contents; {remedy}")
    return True


def write_new(files: Mapping[Path, Content]) -> None:
    """Write files in their order, each whole or not at all; one that others write meanwhile stays.

    Raises UsageError where that has other contents.
    """
    for path, content in files.items():
        for attempt in range(2):  # between comparison and renaming others have some microseconds
            try:
                _write_once(path, content)
                break
            except ChangedFileError:
                if attempt:
                    raise UsageError(f"{path} is there already; choose another name") from None


def _write_once(path: Path, content: Content) -> None:
    """Write a file that is not there, or is there with the same contents. Raises ChangedFileError."""
    drafts: list[Path] = []

    def is_same(place: Path) -> bool:
        return not place.exists() or filecmp.cmp(drafts[0], place, shallow=False)

    with atomic_write(path, is_same=is_same) as draft:
        drafts.append(draft)
        if isinstance(content, str):
            draft.write_text(content, encoding="utf-8")
        elif isinstance(content, Path):
            shutil.copyfile(content, draft)
        else:
            content(draft)
