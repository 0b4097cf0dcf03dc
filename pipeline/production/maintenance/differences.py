"""Where two pieces of plain data differ, as paths: `look.roughness: 0.1 → 0.3`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

NOTHING = object()
"""Stands for what one of the two does not have."""


@dataclass(frozen=True)
class Difference:
    """What was and what is at a path of names and places; NOTHING where there was, or is, no such thing."""

    path: tuple[str | int, ...]
    was: Any
    now: Any

    def __str__(self) -> str:
        return f"{'.'.join(map(str, self.path))}: {_shown(self.was)} → {_shown(self.now)}"


def differences(was: Any, now: Any, path: tuple[str | int, ...] = ()) -> Iterator[Difference]:
    """The smallest parts that differ, in the order of what is now."""
    if isinstance(was, dict) and isinstance(now, dict):
        for name in dict.fromkeys([*now, *was]):
            yield from differences(was.get(name, NOTHING), now.get(name, NOTHING), (*path, name))
    elif isinstance(was, list | tuple) and isinstance(now, list | tuple) and len(was) == len(now):
        for place, (one, other) in enumerate(zip(was, now, strict=True)):
            yield from differences(one, other, (*path, place))
    elif was is NOTHING or now is NOTHING or was != now:
        yield Difference(path, was, now)


def _shown(value: Any) -> str:
    if value is NOTHING:
        return "nothing"
    text = str(list(value) if isinstance(value, tuple) else value)
    return text if len(text) <= 60 else f"{text[:57]}…"
