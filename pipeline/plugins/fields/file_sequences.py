"""Sequences of files, in the order of their numbers: v_2 before v_10, whatever the zeros before them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from decimal import Decimal
from itertools import pairwise
from pathlib import Path
from typing import Any

from flowsculpt import MissingInputError, UsageError
from flowsculpt.api import shorten
from flowsculpt.api.files import InputFile
from flowsculpt.api.shots import ParseContext
from flowsculpt.pipeline.plugins.fields.stored_arrays import is_zarr

_INTEGER, _DECIMAL = (re.compile(rf"((?:(?<![^\W_])-)?[0-9]+{rest})") for rest in ("", r"(?:\.[0-9]+)?"))
"""Numbers in names; a minus after a letter or a digit separates, as in wind-3."""

SEQUENCE = re.compile(r"\*|#+|%0?\d*d|\$F\d*")
"""Marks that stand for a number in names, also those of other programs, such as Houdini's $F4."""


def files_named(name: str, context: ParseContext) -> tuple[Path, ...]:
    """Return the path of a file, or the paths in order that match a name whose last part has a *.

    Whoever reads the files hashes them and notes their digests. Raises UsageError for a name that is none,
    MissingInputError or a finding for files that are not there.
    """
    if "*" not in name:
        path = context.folder / name
        if (shape := SEQUENCE.sub("*", path.name)) != path.name and not is_there(path):
            fact = "* stands for the numbers of a sequence"
            raise MissingInputError(f"file {shorten(name)} is not there; {fact}. Write {shape}.")
        return (path if is_there(path) else context.file(name),)
    folder = context.folder / Path(name).parent
    try:
        if "**" in name:  # from Python 3.13 on, glob takes it for one *
            raise ValueError
        found = folder.glob(Path(name).name)  # hidden files are of other programs
        paths = [path for path in found if is_there(path) and not path.name.startswith(".")]
    except (OSError, ValueError):
        raise UsageError(
            f"file {shorten(name)} is not a name of a sequence; each * stands for any letters. "
            "Write one where names differ, as in wind_*.npz."
        ) from None
    if not paths:
        where = f" in {folder}" if folder != Path() else ""
        raise MissingInputError(f"no file matches {shorten(name)}{where}. Correct the name.")
    return in_order(paths, context.notes.append)


def is_there(path: Path) -> bool:
    """Tell whether a path is a file, or the folder of a Zarr store."""
    return InputFile(path).is_there() or is_zarr(path)


def in_order(paths: Iterable[Path], note: Callable[[str], object]) -> tuple[Path, ...]:
    """Return paths by the numbers in their names, which may be decimal and negative.

    note  called with a line about the first two files whose order is doubtful: 1 and 01, or 1.10 and 1.9
    """
    files = sorted(paths, key=lambda path: (_parts(_DECIMAL, path), path.name))
    for first, second in pairwise(files):
        is_tie = _parts(_DECIMAL, first) == _parts(_DECIMAL, second)
        if is_tie or _parts(_INTEGER, first) > _parts(_INTEGER, second):
            note(
                f"{first.name} is read before {second.name}, by decimal numbers; give all numbers as many "
                "digits if it comes after"
            )
            break
    return tuple(files)


def _parts(number: re.Pattern[str], path: Path) -> list[Any]:
    """Return the text and the numbers of a name by turns."""
    return [Decimal(part) if at % 2 else part for at, part in enumerate(number.split(path.name))]
