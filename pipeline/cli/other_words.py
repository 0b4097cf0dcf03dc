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


COMMANDS = {
    "help": "--help",
    "play": "preview",
    "view": "preview",
    "show": "preview",
    "list": "status",
    "ls": "status",
    "check": "validate",
    "lint": "validate",
    "annotate": "review",
    "comments": "notes",
    "create": "new",
    "init": "new --show",
    "encode": "deliver",
    "build": "film",
    "make": "film",
    "explain": "why",
    "delete": "clean",
    "remove": "clean",
}
"""Commands of other programs, and those that do the same here."""

OPTIONS = {
    "--frame": "--frames",
    "--range": "--frames",
    "--start": "--frames 1-24",
    "--end": "--frames 1-24",
    "-r": "-f",
    "-s": "-f 1-24",
    "-e": "-f 1-24",
    "--cores": "-j",
    "--threads": "-j",
    "--jobs": "-j",
    "-c": "-j",
    "-n": "--dry-run",
    "--dryrun": "--dry-run",
    "--overwrite": "--force",
    "-F": "--force",
    "--resolution": "--scale 50%",
    "--res": "--scale 50%",
    "--size": "--scale 50%",
    "--samples": "--set quality.draft.samples=16",
    "--spp": "--set quality.draft.samples=16",
    "--config": "--set",
    "--format": "--as",
    "--out": "-o",
    "--device": "--variant cuda_ad_rgb",
    "--gpu": "--variant cuda_ad_rgb",
    "--directory": "--root",
    "-d": "--root",
}
"""Options of other programs, and those that do the same here."""


def require_command(name: str, known: Collection[str]) -> None:
    """Raise UsageError for a command that has another name here."""
    meant = COMMANDS.get(name.lower())
    if name not in known and meant:
        raise UsageError(f"there is no command {name}; write flowsculpt {meant}")


def require_options(words: Iterable[str], known: Collection[str]) -> None:
    """Raise UsageError for an option that has another name here.

    known  the options of the command
    """
    for word in words:
        name = word.partition("=")[0]
        meant = OPTIONS.get(name)
        if name not in known and meant and meant.split()[0] in known:
            raise UsageError(f"there is no option {name}; write {meant}")
