"""What completes a word on the command line of a shell, from a table that is made beforehand.

Each Tab starts Python, so this module imports nothing that takes time. `completion_command` makes the table
of all commands, options and names, which takes seconds. It holds until a file of flowsculpt or of a plug-in,
or the list of installed packages, changes. As for compiled modules, Python's own rule for files is used: they
are as they were if size and time are.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from typing import Any

VARIABLE = "_FLOWSCULPT_COMPLETE"
"""The environment variable by which a shell asks; it names the shell."""

FILES = ":files"
"""The answer that has the shell complete the names of files."""

SHOTS, EDITS = "@shots", "@edits"
"""Stand in the table for the names of shots and edits in shots/."""

_EDIT, _SHOT = (
    re.compile(rb"^shots\s*:", re.MULTILINE),
    re.compile(rb"^(subjects?|extends)\s*:", re.MULTILINE),
)


def table_file() -> str:
    """Return the file of the table of this installation."""
    cache = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111  # Paths are slow
    return f"{cache}/flowsculpt/completion/{__file__.strip('/').replace('/', '-')}.json"


def states(files: list[str]) -> list[list[Any]]:
    """Return paths with sizes and times of change."""
    found = []
    for file in files:
        try:
            state = os.stat(file)  # noqa: PTH116
        except OSError:
            continue
        found.append([file, state.st_size, state.st_mtime_ns])
    return found


def packages() -> list[str]:
    """Return names and versions of installed packages."""
    names = set()
    for folder in sys.path:
        try:
            names |= {name for name in os.listdir(folder) if name.endswith((".dist-info", ".egg-info"))}  # noqa: PTH208
        except OSError:
            continue
    return sorted(names)


def current_commands() -> dict[str, Any] | None:
    """Return the commands of the table, as `completions` takes them; None without a table that holds."""
    import json

    try:
        with open(table_file(), encoding="utf-8") as file:  # noqa: PTH123
            table = json.load(file)
        is_current = (
            table["packages"] == packages()
            and states([name for name, *_ in table["files"]]) == table["files"]
        )
        return table["commands"] if is_current else None
    except (OSError, ValueError, LookupError, TypeError):
        return None


def answer(words: list[str]) -> bool:
    """Print what may stand in place of the last word, a line each; False without a table that holds."""
    if (commands := current_commands()) is None:
        return False
    words, cut = words or [""], 0
    if os.environ.get(VARIABLE) == "bash":
        words, cut = _joined(words)
    sys.stdout.write("".join(f"{line[cut:]}\n" for line in completions(commands, words)))
    return True


def _joined(words: list[str]) -> tuple[list[str], int]:
    """Join words that Bash cuts at `=`; return them, and the letters of the last that it does not replace."""
    joined, cut = list[str](), 0
    for word in words:
        if word == "=" and joined:
            joined[-1] += "="
            cut = len(joined[-1])
        elif cut and joined[-1][cut:] == "":
            joined[-1] += word
        else:
            joined.append(word)
            cut = 0
    return joined, cut


def completions(commands: dict[str, Any], words: list[str]) -> Iterator[str]:
    """Yield what may stand in place of the last word: words, with a tab and their help where there is one.

    commands  by name, `export FORMAT` among them, and under an empty name what comes before a command:
              `options`, each with the kinds of its value, or None, and its help; and `words`, the kinds of
              each place. A kind is a word, or one of FILES, SHOTS and EDITS
    """
    *before, current = words
    name, place, wanted = "", 0, None
    for word in before:
        options = {**commands[""]["options"], **commands[name]["options"]}
        if wanted is not None:
            wanted = None
        elif word.startswith("-"):
            wanted = None if "=" in word else options.get(word, [None])[0]
        elif not place and (inner := f"{name} {word}".strip()) in commands:
            name = inner
        else:
            place += 1
    options = {**commands[name]["options"], **commands[""]["options"]}
    option, is_set, begun = current.partition("=")
    if wanted is None and current.startswith("-"):
        if is_set:
            yield from (f"{option}={value}" for value in _named(options.get(option, [None])[0] or [], begun))
        else:
            yield from (
                f"{each}\t{about}" for each, (_, about) in options.items() if each.startswith(current)
            )
        return
    rows = commands[name]["words"]
    of_place = rows[min(place, len(rows) - 1)] if rows and (name or not place) else []
    yield from _named(of_place if wanted is None else wanted, current)


def _named(kinds: list[str], begun: str) -> Iterator[str]:
    """Yield the names of these kinds that begin so; of several, the last."""
    shots, edits = _shots() if {SHOTS, EDITS} & set(kinds) else ([], [])
    if FILES in kinds or ("/" in begun and (shots or edits)):
        yield FILES
    names = {SHOTS: shots, EDITS: edits, FILES: []}
    earlier, comma, last = begun.rpartition(",")
    for name in dict.fromkeys(name for kind in kinds for name in names.get(kind, [kind])):
        if name.startswith(last):
            yield f"{earlier}{comma}{name}"


def _shots() -> tuple[list[str], list[str]]:
    """Return the names of the shots and of the edits in shots/."""
    shots, edits = list[str](), list[str]()
    for file in sorted(os.listdir("shots")) if os.path.isdir("shots") else ():  # noqa: PTH112, PTH208
        name, suffix = os.path.splitext(file)  # noqa: PTH122
        if suffix != ".yaml" or file.startswith(".") or name == "defaults":
            continue
        with open(f"shots/{file}", "rb") as opened:  # noqa: PTH123
            text = opened.read(1 << 16)
        is_edit = name == "film" or (_EDIT.search(text) and not _SHOT.search(text))
        (edits if is_edit else shots).append(name)
    return shots, edits
