"""Values of a shot that are set from outside: `flows.0.vortex.strength=2`."""

from __future__ import annotations

import copy
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pipeline.errors import ShotError, suggestion
from pipeline.shot.checks.file_checks import read_clock
from pipeline.shot.yaml.source import Source, Where

OPTION = "--set"

_FORM = re.compile(r"\s*([^=\s]+?)\s*=(.*)", re.DOTALL)
_FRAME = re.compile(r"[+-]?\d+(\.\d+)?")
_TIME = re.compile(r"[+-]?\d+\.\d+s?")


def with_settings(source: Source, settings: Iterable[str]) -> Source:
    """The source with settings in place of its values, or beside them; a later one counts over one before.

    A value is YAML, as in the file. Names that are not there yet may be the last of a path, or stand at the
    top of the shot. Under `keys` a time is one name, its point too: `keys.0.5s=2`; one that is not there yet
    takes its place among the others. Raises ShotError, with the setting in place of a line, where one is no
    setting or leads nowhere; what its value does wrong is for the document to say.
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
    _sort_keys(source, data, where)
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
    here, steps = data, list(steps)
    while steps:
        said = ".".join(map(str, where)) or "the shot"
        step = _taken(steps, here, of_keys=where[-1:] == ("keys",))
        if isinstance(here, list):
            if not step.isdigit() or int(step) >= len(here):
                many = f"it has {len(here)} items, 0 to {len(here) - 1}" if here else "it is empty"
                raise ShotError(f"{place}: {said} has no item {step}; {many}. Name one of them.")
            key: Any = int(step)
        elif isinstance(here, dict):
            key = _named(here, step)
            if steps and key not in here:
                if where:
                    raise ShotError(f"{place}: {said} has no {step}. {_hint(where, step, here)}")
                here[key] = {}
            if steps and here[key] is None:
                here[key] = {}
        else:
            raise ShotError(f"{place}: {said} is {here!r}, which holds no {step}. Set {said} as a whole.")
        where = (*where, key)
        if not steps:
            here[key] = value
        else:
            here = here[key]
    return where


def _hint(where: Where, step: str, here: dict[Any, Any]) -> str:
    """What there is; times are not mistyped names of each other."""
    if where[-1] == "keys":
        return f"There are: {', '.join(map(str, here))}. Set a new key as a whole."
    return suggestion(step, map(str, here))


def _taken(steps: list[str], here: Any, of_keys: bool) -> str:
    """The next name, taken from the steps: of keys two of them, where together they are a time.

    `keys.17.1` is the second number of key 17 where that is a list, and otherwise key 17.1.
    """
    joined = ".".join(steps[:2])
    if of_keys and isinstance(here, dict) and len(steps) > 1 and _TIME.fullmatch(joined):
        holder = here.get(_named(here, steps[0]))
        if _named(here, joined) in here or not isinstance(holder, list | dict):
            del steps[:2]
            return joined
    return steps.pop(0)


def _named(here: dict[Any, Any], step: str) -> Any:
    """The key of a mapping that a step names: the one that is written so, or else a new one."""
    new: Any = step
    if _FRAME.fullmatch(step):
        new = float(step) if "." in step else int(step)
    return next((name for name in here if str(name) == step), new)


def _sort_keys(source: Source, data: Any, where: Where) -> None:
    """Give a key that is new its place among the others, where these go forward and it is a time."""
    if "keys" not in where[:-1]:
        return
    holder = data
    for step in where[: where.index("keys")]:
        holder = holder[step]
    clock, _ = read_clock(Source(source.path, data, {}))
    times = {key: clock.seconds(key) if clock else None for key in holder["keys"]}
    *before, _ = known = [time for time in times.values() if time is not None]
    if len(known) == len(times) and before == sorted(before):
        holder["keys"] = dict(sorted(holder["keys"].items(), key=lambda item: times[item[0]] or 0.0))
