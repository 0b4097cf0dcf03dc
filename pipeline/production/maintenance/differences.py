"""Differences between plain data, and between the shot files and options of two runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

from pipeline.errors import FlowsculptError
from pipeline.production.request.shot_source import ShotSource
from pipeline.shot.yaml.inheritance import OPTION, inherited
from pipeline.shot.yaml.plain_text import in_yaml
from pipeline.shot.yaml.yaml_source import Where, YamlSource

MISSING = object()
"""Stands for a value that one of two data does not have."""

DIGITS = 6
"""Significant digits of numbers; all are shown of two that differ only beyond them."""


@dataclass(frozen=True)
class Difference:
    """The value at a path before and now; MISSING where there is none."""

    path: Where
    before: Any
    now: Any

    def __str__(self) -> str:
        before, now = _shown(self.before, DIGITS), _shown(self.now, DIGITS)
        if before == now:
            before, now = _shown(self.before), _shown(self.now)
        return f"{'.'.join(map(str, self.path))}: {before} → {now}"


def differences(before: Any, now: Any, path: Where = ()) -> Iterator[Difference]:
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


@dataclass(frozen=True)
class FileEdit:
    """A value that differs between the shot file that made a picture and today's.

    place  file and line where it stands now, or stood before if it is gone
    """

    place: str
    difference: Difference

    def __str__(self) -> str:
        return f"{self.place}: {self.difference}"


def file_edits(before: ShotSource, now: ShotSource, root: Path) -> Iterator[FileEdit]:
    """Yield the differences between the shot files of two sources, but for the options `--set`.

    root  the folder to which their paths are relative

    Yields none where one of them cannot be read.
    """
    try:
        old, new = _read(before), _read(now)
    except FlowsculptError:
        return
    for difference in differences(old.data, new.data):
        file, line, _ = (old if difference.now is MISSING else new).spot_of(difference.path)
        shown = Path(file).relative_to(root) if Path(file).is_relative_to(root) else Path(file)
        yield FileEdit(f"{shown}:{line}", difference)


def option_differences(before: ShotSource, now: ShotSource) -> Iterator[str]:
    """Yield the differences between the options `--set` of two sources, in words."""
    for setting in before.settings:
        if setting not in now.settings:
            yield f"it was made with {OPTION} {setting}, which is not given now"
    for setting in now.settings:
        if setting not in before.settings:
            yield f"{OPTION} {setting} is given now, and was not when it was made"


def _items(before: list[Any], now: list[Any], path: Where) -> Iterator[Difference]:
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


def _read(source: ShotSource) -> YamlSource:
    """Return the shot files of a source, without the settings of the command line."""
    return inherited(source.path, source.text, (), dict(source.beside))
