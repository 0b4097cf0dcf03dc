"""Commands and options by the words that other programs have for them."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterable

from pipeline.errors import UsageError


def require_readable(*words: str) -> None:
    """Raise UsageError for words that are not UTF-8, and as `require_readable_path` for files."""
    for word in words:
        name = word.encode(errors="surrogateescape").decode(errors="backslashreplace")
        if name != word:
            raise UsageError(f"{name}: this name is not UTF-8, as on some old file shares; rename it")
        if os.path.lexists(word):
            require_readable_path(word)


def require_readable_path(path: str) -> None:
    """Raise UsageError for a path that messages, logs and shot files cannot hold in one line."""
    if re.search(r"[\x00-\x1f\x7f]", path):
        raise UsageError(f"{path!r}: a line break or control character in a path; rename it")


_COMMANDS = {
    "--help": "help",
    "preview": "play view show",
    "status": "list ls",
    "validate": "check lint",
    "new": "create init",
    "film": "build make",
    "why": "explain",
    "clean": "delete remove",
}
"""By commands, those of other programs that do the same."""

_OPTIONS = {
    "--frames": "--frame --range --start --end",
    "-f": "-r -s -e",
    "-j": "--cores --threads --jobs -c",
    "--dry-run": "-n --dryrun",
    "--force": "--overwrite -F",
    "--scale 50%": "--resolution --res --size",
    "--set quality.draft.samples=16": "--samples --spp",
    "--as": "--format",
    "-o": "--out",
    "--variant cuda_ad_rgb": "--device --gpu",
    "--root": "--directory -d",
}
"""By options, those of other programs that do the same."""


def _meant(table: dict[str, str], word: str) -> str | None:
    return next((name for name, words in table.items() if word in words.split()), None)


def require_command(name: str, known: Collection[str]) -> None:
    """Raise UsageError for a command that has another name here."""
    meant = _meant(_COMMANDS, name.lower())
    if name not in known and meant:
        raise UsageError(f"unknown command {name}. Did you mean {meant}?")


def require_options(words: Iterable[str], known: Collection[str]) -> None:
    """Raise UsageError for an option that has another name here.

    known  the options of the command
    """
    for word in words:
        name = word.partition("=")[0]
        meant = _meant(_OPTIONS, name)
        if name not in known and meant and meant.split()[0] in known:
            raise UsageError(f"unknown option {name}. Did you mean {meant}?")
