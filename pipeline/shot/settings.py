"""Values of a shot that are set from outside: `flows.0.vortex.strength=2`."""

from __future__ import annotations

import copy
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pipeline.errors import ShotError, suggestion
from pipeline.shot.source import Source, Where

OPTION = "--set"

_FORM = re.compile(r"\s*([^=\s]+?)\s*=(.*)", re.DOTALL)


def with_settings(source: Source, settings: Iterable[str]) -> Source:
    """The source with settings in place of its values, or beside them; a later one counts over one before.

    A value is YAML, as in the file. Names that are not there yet may be the last of a path, or stand at the
    top of the shot. Raises ShotError, with the setting in place of a line, where one is no setting or leads
    nowhere; what its value does wrong is for the document to say.
    """
    for setting in settings:
        source = _set(source, setting)
    return source


def _set(source: Source, setting: str) -> Source:
    place = f"{OPTION} {setting}"
    match = _FORM.fullmatch(setting)
    if not match:
        raise ShotError(f"{place}: this is no setting. Write name=value, such as flows.0.twist.amount=90.")
    if match[1].split(".")[0] == "extends":
        raise ShotError(
            f"{place}: what a shot extends is said in its file alone; settings come on top of both. "
            "Write extends there, or set the values themselves."
        )
    try:
        value = Source.read(Path(OPTION), match[2] if match[2].strip() else "null").data
    except ShotError:
        raise ShotError(
            f"{place}: {match[2]!r} is no YAML. Quote it for the shell, and look at its brackets."
        ) from None
    data = copy.deepcopy(source.data)
    where = _put(data, match[1].split("."), value, place)
    new = [where[:i] for i in range(1, len(where) + 1) if i == len(where) or where[:i] not in source.places]

    def kept(path: Where) -> bool:
        return path[: len(where)] != where

    return Source(
        source.path,
        data,
        {**{path: spot for path, spot in source.places.items() if kept(path)}, **dict.fromkeys(new, (0, 0))},
        source.problems,
        {path: spot for path, spot in source.texts.items() if kept(path)},
        {**{path: file for path, file in source.others.items() if kept(path)}, **dict.fromkeys(new, place)},
    )


def _put(data: Any, steps: list[str], value: Any, place: str) -> Where:
    """Put a value where the steps lead; the path to it, with the keys as they are in the data."""
    where: Where = ()
    here = data
    for i, step in enumerate(steps):
        said, last = ".".join(steps[:i]) or "the shot", i == len(steps) - 1
        if isinstance(here, list):
            if not step.isdigit() or int(step) >= len(here):
                many = f"it has {len(here)} items, 0 to {len(here) - 1}" if here else "it is empty"
                raise ShotError(f"{place}: {said} has no item {step}; {many}. Name one of them.")
            key: Any = int(step)
        elif isinstance(here, dict):
            key = next((name for name in here if str(name) == step), int(step) if step.isdigit() else step)
            if not last and key not in here:
                if i:
                    hint = suggestion(step, map(str, here))
                    raise ShotError(f"{place}: {said} has no {step}. {hint}")
                here[key] = {}
            if not last and here[key] is None:
                here[key] = {}
        else:
            raise ShotError(f"{place}: {said} is {here!r}, which holds no {step}. Set {said} as a whole.")
        where = (*where, key)
        if last:
            here[key] = value
        else:
            here = here[key]
    return where
