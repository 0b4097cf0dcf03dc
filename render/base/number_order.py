"""The order of numbered files: v_2 before v_10, whatever the zeros before their numbers."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from decimal import Decimal
from itertools import pairwise
from pathlib import Path
from typing import Any

_INTEGER, _DECIMAL = (re.compile(rf"((?:(?<![^\W_])-)?[0-9]+{rest})") for rest in ("", r"(?:\.[0-9]+)?"))
"""Numbers in names; a minus after a letter or a digit separates, as in wind-3."""


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
