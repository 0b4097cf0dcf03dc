"""Numbered files: those whose names match a pattern such as `fluid_####.ply`, by number."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from flowsculpt import MissingInputError, UsageError
from flowsculpt.api import quote, shorten
from flowsculpt.api.meshes import ModelFile

_NUMBER = re.compile(r"#+|%0?(\d*)d|\*")
"""The place of the number in a pattern: as Houdini's and Nuke's # write it, as printf does, or any digits."""

MOST_LISTED = 12
"""Numbers that a message lists."""


def is_pattern(name: str) -> bool:
    """Tell whether the last part of a name stands for numbered files."""
    return _NUMBER.search(name.replace("\\", "/").rpartition("/")[2]) is not None


def numbered_files(pattern: str, folder: Path) -> Mapping[int, Path]:
    """Return the files that a pattern names, by number, in ascending order; numbers may be negative.

    folder  that patterns are relative to

    Raises UsageError for a pattern with no or several places for a number, and for two files of one number;
    MissingInputError where no file matches.
    """
    above, _, name = pattern.rpartition("/")
    place = folder / above if above else folder
    found: dict[int, Path] = {}
    matches = _matcher(name)
    for file in sorted(_names(place)):
        number = matches(file)
        if number is None:
            continue
        if number in found:
            raise UsageError(
                f"{found[number].name} and {file} in {place} are both number {number}. Remove one."
            )
        found[number] = place / file
    if not found:
        also = "; a * stands for the number alone" if "*" in name else ""
        raise MissingInputError(
            f"no file matches {shorten(pattern)} in {place}{also}. Correct its name or #."
        )
    return dict(sorted(found.items()))


def in_other_format(pattern: str, folder: Path, numbers: Iterable[int]) -> str:
    """Return the sentence about a mesh file that has one of some numbers, in another format than a pattern's.

    It begins with a space; empty where there is none.
    """
    above, _, name = pattern.rpartition("/")
    place, wanted = folder / above if above else folder, set(numbers)
    stem, names = Path(name).stem, sorted(_names(place))
    for suffix in sorted({Path(file).suffix for file in names} - {Path(name).suffix}):
        if is_pattern(stem) and ModelFile(place / f"a{suffix}").reader is not None:
            matches = _matcher(stem + suffix)
            for file in names:
                if matches(file) in wanted:
                    return f" {file} is in another format; write all files in one."
    return ""


def _names(folder: Path) -> Iterable[str]:
    """Return the names in a folder. Raises MissingInputError where it cannot be read."""
    try:
        return os.listdir(folder)  # noqa: PTH208  # Paths of thousands of files are slow
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise MissingInputError(f"{folder}: it cannot be listed ({reason}). Correct the folder.") from None


def _matcher(name: str) -> Callable[[str], int | None]:
    """Return a function of a file's name that returns its number, or None where it does not match."""
    places = list(_NUMBER.finditer(name))
    if len(places) != 1:
        raise UsageError(
            f"{quote(name)} has {len(places)} places for a number; numbered files have one, at the end of "
            "their name. Write it as fluid_####.ply."
        )
    (place,) = places
    mark, digits = place[0], place[1]
    width = len(mark) if mark[0] == "#" else int(digits or 0)
    before, after = name[: place.start()], name[place.end() :]

    def number(file: str) -> int | None:
        text = file[len(before) : len(file) - len(after)]
        if not (file.startswith(before) and file.endswith(after) and len(file) >= len(before) + len(after)):
            return None
        if not re.fullmatch(r"-?[0-9]+", text, re.ASCII):
            return None
        value = int(text)
        known = {f"{value:0{width}d}", f"-{-value:0{width}d}" if value < 0 else text[:0]}
        return value if mark == "*" or text in known else None

    return number


def listed_numbers(numbers: Iterable[int]) -> str:
    """Return numbers for a message, in runs: `3, 5-9 and 41-96`; of many runs the first ones."""
    runs: list[list[int]] = []
    for number in sorted(numbers):
        if runs and runs[-1][1] == number - 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    words = [str(first) if first == last else f"{first}-{last}" for first, last in runs]
    if len(words) > MOST_LISTED:
        return f"{', '.join(words[:MOST_LISTED])} and more"
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
