"""Shots that rest on other files: what they say over what a shot that they extend says, over the defaults.

Mappings merge; everything else replaces, and so does a mapping that says another kind of thing: other keys, a
formula, another subject. Every value keeps the place where it stands.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from pipeline.errors import MissingInputError, ShotError, suggestion
from pipeline.shot.yaml.lookup import DEFAULTS, shown
from pipeline.shot.yaml.overrides import with_settings
from pipeline.shot.yaml.source import Source, Where

ANOTHER_KIND = frozenset({"keys", "formula", "curvature", "camera", "solid", "model", "cloud", "net", "bsdf"})
"""A mapping with one of these names says what a thing is, and is not mixed with another."""

Look = Callable[[str], str | None]
"""The text of a file beside the shot, by its name; None where there is none."""


def layered(
    path: Path, text: str | None, settings: tuple[str, ...], beside: Mapping[str, str] | None
) -> Source:
    """A shot file with everything it rests on, and settings from outside on top.

    Raises ShotError and MissingInputError, with the place, where a file is no YAML or not there, where shots
    extend each other in a circle, and where a setting has no place in the shot.
    """
    look = beside.get if beside is not None else lambda name: _text(path.with_name(name))
    source = _extended(Source.read(path, text), look, (path.name,))
    defaults = look(DEFAULTS) if path.name != DEFAULTS else None
    if defaults is not None and isinstance(source.data, dict):
        source = over(source, _mapping(Source.read(path.with_name(DEFAULTS), defaults)))
    return with_settings(source, settings)


def rests_on(path: Path, text: str) -> dict[str, str]:
    """The text of all other files that a shot is made of, by their names.

    Files that are missing or no YAML end the search; `layered` tells.
    """
    found: dict[str, str] = {}

    def look(name: str) -> str | None:
        there = _text(path.with_name(name))
        if there is not None:
            found[name] = there
        return there

    look(DEFAULTS)
    try:
        _extended(Source.read(path, text), look, (path.name,))
    except (ShotError, MissingInputError):
        return found
    return found


def _extended(source: Source, look: Look, chain: tuple[str, ...]) -> Source:
    """A file over the one that it extends, and that over the next."""
    parent = source.get("extends")
    if not isinstance(parent, str):
        return source
    name, place = f"{parent}.yaml", source.place(("extends",))
    if name in chain:
        circle = " extends ".join(Path(link).stem for link in (*chain[chain.index(name) :], name))
        raise ShotError(f"{place}: {circle}; a shot cannot rest on itself. Take one of them out.")
    text = look(name) if "/" not in parent else None
    if text is None:
        known = sorted(p.stem for p in source.path.parent.glob("*.yaml") if p.name not in (*chain, DEFAULTS))
        hint = suggestion(parent, known) if known else "There are none."
        raise MissingInputError(
            f"{place}: there is no shot {shown(parent)} beside this file to extend. {hint}"
        )
    base = _mapping(Source.read(source.path.with_name(name), text))
    return over(source, _extended(base, look, (*chain, name)))


def over(source: Source, base: Source) -> Source:
    """What `source` says, and where it is silent what `base` says."""
    if not isinstance(source.data, dict):
        return source
    replaced: list[Where] = []
    data = _merged(source.data, base.data, (), replaced)

    def kept(where: Where) -> bool:
        return where not in source.places and not any(where[: len(r)] == r for r in replaced)

    others = {where: base.others.get(where, str(base.path)) for where in base.places if kept(where)}
    problems = []
    for i, (where, problem) in enumerate(
        base.problems
    ):  # they keep their places, whatever becomes of the values
        file, line, column = base.spot_of(where)
        others[base.path.name, i], source.places[base.path.name, i] = file, (line, column)
        problems.append(((base.path.name, i), problem))
    return Source(
        source.path,
        data,
        {**{where: place for where, place in base.places.items() if kept(where)}, **source.places},
        [*source.problems, *problems],
        {**{where: place for where, place in base.texts.items() if kept(where)}, **source.texts},
        {**others, **source.others},
    )


def _merged(mine: Any, theirs: Any, where: Where, replaced: list[Where]) -> Any:
    """Mine over theirs; notes where theirs are gone for good."""
    both = isinstance(mine, dict) and isinstance(theirs, dict)
    if not both or (where and ANOTHER_KIND & set(mine)):
        replaced.append(where)
        return mine
    merged = dict(theirs)
    for name, value in mine.items():
        merged[name] = _merged(value, theirs[name], (*where, name), replaced) if name in theirs else value
    return merged


def _mapping(base: Source) -> Source:
    if not isinstance(base.data, dict):
        raise ShotError(f"{base.path}:1:1: this is no mapping; a file for shots to rest on is `name: value`")
    return base


def _text(path: Path) -> str | None:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, ValueError):  # not there, no UTF-8, or a name that no file can have
        return None
