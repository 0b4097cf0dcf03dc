"""Differences between plain data, such as a shot file before an edit and after it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

from pipeline.shot.yaml.plain_text import in_yaml

MISSING = object()
"""Stands for a value that one of two data does not have."""

DIGITS = 6
"""Significant digits of numbers; all are shown of two that differ only beyond them."""

Path = tuple[str | int, ...]
"""Names and indices that lead to a value."""


@dataclass(frozen=True)
class Difference:
    """The value at a path before and now; MISSING where there is none."""

    path: Path
    before: Any
    now: Any

    def __str__(self) -> str:
        before, now = _shown(self.before, DIGITS), _shown(self.now, DIGITS)
        if before == now:
            before, now = _shown(self.before), _shown(self.now)
        return f"{'.'.join(map(str, self.path))}: {before} → {now}"


def differences(before: Any, now: Any, path: Path = ()) -> Iterator[Difference]:
    """Yield the smallest parts of plain data that differ, in the order of `now`.

    Lists are compared from both ends, so that an item added or removed is one difference.
    """
    if isinstance(before, dict) and isinstance(now, dict):
        for name in dict.fromkeys([*now, *before]):
            yield from differences(before.get(name, MISSING), now.get(name, MISSING), (*path, name))
    elif isinstance(before, list | tuple) and isinstance(now, list | tuple):
        yield from _items(list(before), list(now), path)
    elif before is MISSING or now is MISSING or before != now:
        yield Difference(path, before, now)


def _items(before: list[Any], now: list[Any], path: Path) -> Iterator[Difference]:
    """Yield the differences between two lists: equal items at both ends are left out."""
    shorter = min(len(before), len(now))
    first = next((i for i in range(shorter) if before[i] != now[i]), shorter)
    last = next((i for i in range(shorter - first) if before[-1 - i] != now[-1 - i]), shorter - first)
    middle = before[first : len(before) - last], now[first : len(now) - last]
    for index, (one, other) in enumerate(zip_longest(*middle, fillvalue=MISSING), first):
        yield from differences(one, other, (*path, index))


def _shown(value: Any, digits: int | None = None) -> str:
    """Return a value in YAML, its numbers rounded to so many significant digits."""
    if value is MISSING:
        return "nothing"
    text = in_yaml(_rounded(value, digits)) or "nothing"
    return text if len(text) <= 60 else f"{text[:57]}…"


def _rounded(value: Any, digits: int | None) -> Any:
    if isinstance(value, dict):
        return {name: _rounded(item, digits) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item, digits) for item in value]
    return float(f"{value:.{digits}g}") if isinstance(value, float) and digits else value
