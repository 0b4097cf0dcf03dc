"""A mapping with unknown names, and messages about those that belong elsewhere: beside, above or below."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel

from pipeline.shot.yaml.plain_text import dotted, in_yaml, listed
from pipeline.shot.yaml.schema_walk import (
    Models,
    field_names,
    fitting,
    members,
    models_at,
    models_in,
    paths_to,
    types_at,
    types_in_list,
)
from pipeline.shot.yaml.yaml_source import Problem, Where, YamlSource

SPELT_OUT = {"look": "material", "lights": "rig", "stage": "kind"}
"""Entries that are a name or a mapping, and what the name is called in the mapping."""

_MANY_NAMES = 20
"""Names from which on a mapping is an entry of flows: no other has so many."""


@dataclass
class UnknownNames:
    """The messages about unknown names, and what they explain: problems there need no message of their own.

    supplied  paths of values that are missing only because their names are wrong
    covered   paths of mappings whose other problems follow from the same mistake
    """

    problems: list[Problem] = field(default_factory=list)
    supplied: set[Where] = field(default_factory=set)
    covered: set[Where] = field(default_factory=set)


@dataclass(frozen=True)
class CheckedMapping:
    """One mapping with unknown names.

    models  documents that it can be, by its form
    every   documents that could stand at its place
    """

    document: type[BaseModel]
    source: YamlSource
    where: Where
    models: Models
    every: Models
    found: UnknownNames

    def tell(self, name: Any, message: str) -> None:
        self.found.problems.append(((*self.where, name), message))

    @property
    def name(self) -> str:
        """The path of the mapping, as the file writes it."""
        return dotted(self.source.written_path(self.where))

    @property
    def fields(self) -> dict[str, Any]:
        return field_names(self.models)

    @property
    def values(self) -> dict[Any, Any]:
        value = self.source.get(*self.where)
        return value if isinstance(value, dict) else {}

    def beside(self, name: Any) -> dict[Any, Any]:
        """Return the known values beside a name in the same file; for a setting, those of all files."""
        values, file = self.values, self.file(name)
        known = [other for other in self.fields if other in values]
        return {other: values[other] for other in known if self.is_set(name) or self.file(other) == file}

    def file(self, *names: Any) -> str:
        return self.source.spot_of((*self.where, *names))[0]

    @property
    def here(self) -> str:
        return self.name or str(getattr(self.document, "what", "a shot"))

    @property
    def is_entry(self) -> bool:
        """Tell whether the mapping is an entry of flows, which has one name."""
        return len(self.fields) > _MANY_NAMES and bool(self.where)

    def is_set(self, name: Any) -> bool:
        """Tell whether an option of the command line sets a value."""
        return self.source.spot_of((*self.where, name))[1] == 0


def owner_beside(mapping: CheckedMapping, name: Any) -> Any:
    """Return the name beside this one under which it belongs; None if there is none."""
    for other, value in mapping.beside(name).items():
        inner = models_in([mapping.fields[other]]) if other in mapping.fields else []
        if (value is None or isinstance(value, dict)) and name in field_names(fitting(inner, value)):
            return other
    return None


def tell_beside(mapping: CheckedMapping, owner: Any, names: list[Any]) -> None:
    """Report names that belong under a name beside them."""
    below = mapping.values[owner]
    what = f"{listed(names)} {'belongs' if len(names) == 1 else 'belong'} to {owner}"
    it = "it" if len(names) == 1 else "them"
    if mapping.is_set(names[0]):
        remedy = f"Set {dotted((*mapping.where, owner, names[0]))}."
    elif isinstance(below, dict) and below and _is_in_braces(mapping, owner, below):
        whole = {**below, **{name: mapping.values[name] for name in names}}
        remedy = f"Write {owner}: {in_yaml(whole)}."
    else:
        remedy = f"Indent {it} under {owner}."
    mapping.tell(names[0], f"{what} and {'stands' if len(names) == 1 else 'stand'} beside it. {remedy}")
    mapping.found.covered.add((*mapping.where, owner))
    mapping.found.supplied.update((*mapping.where, owner, name) for name in names)


def _is_in_braces(mapping: CheckedMapping, owner: Any, below: dict[Any, Any]) -> bool:
    first = (*mapping.where, owner, next(iter(below)))
    lines = [mapping.source.spot_of(where)[1] for where in ((*mapping.where, owner), first)]
    return lines[0] == lines[1]


def further_up(mapping: CheckedMapping, name: Any) -> str | None:
    """Return the message about a name that belongs further up."""
    for length in range(len(mapping.where) - 1, -1, -1):
        above = mapping.where[:length]
        if name in field_names(models_at(mapping.document, above)) and not isinstance(above[-1:], int):
            owner, inner = dotted(above) or "the top of the file", mapping.name
            block = next(step for step in reversed(mapping.where) if isinstance(step, str))
            return f"{name} belongs to {owner}, not to {inner}. Move it out of {block}."
    return None


def further_down(mapping: CheckedMapping, name: Any) -> str | None:
    """Return the message about a name that belongs one or two levels further down."""
    if mapping.is_entry:
        return None
    value = mapping.values[name]
    for own, kind in mapping.fields.items():
        if mapping.values.get(own) and own in SPELT_OUT and name in field_names(models_in([kind])):
            whole = {SPELT_OUT[own]: mapping.values[own], name: value}
            return f"{name} belongs to {own}. Write {own}: {in_yaml(whole)}."
        if name in field_names(models_in(types_in_list(kind))):
            mapping.found.supplied.add((*mapping.where, own))
            if isinstance(value, list):
                return f"{name} is called {own} in {mapping.here}. Rename it."
            return f"{name} belongs under {own}. Write {own}: [{in_yaml({name: value})}]."
    beside = mapping.beside(name)
    every = list(paths_to(name, mapping.models, 2))
    paths = [path for path in every if path[0] not in beside]
    paths = [path for path in paths if len(path) == len(paths[0])]
    if not paths:
        return _into(mapping, name, [path for path in every if isinstance(beside[path[0]], dict)])
    mapping.found.supplied.update((*mapping.where, *path[:1]) for path in paths)
    value = _fitting(mapping, _proposed(paths), value)
    if mapping.is_set(name):
        return f"{name} belongs further down. Set {dotted((*mapping.where, *_proposed(paths)))}."
    owners = listed([".".join(path[:-1]) for path in paths[:4]], "or")
    return f"{name} belongs under {owners}. Write {_nested(_proposed(paths), value)}."


def _fitting(mapping: CheckedMapping, path: tuple[str, ...], value: Any) -> Any:
    """Return a value; for true and false where a word must stand the last or the first of them."""
    steps = tuple(step for step in mapping.where if isinstance(step, str))
    kinds = [member for kind in types_at(mapping.document, (*steps, *path)) for member in members(kind)]
    words = [word for kind in kinds if get_origin(kind) is Literal for word in get_args(kind)]
    return words[-1 if value else 0] if words and isinstance(value, bool) else value


def _into(mapping: CheckedMapping, name: Any, paths: list[tuple[str, ...]]) -> str | None:
    """Return the message about a name that belongs into a mapping which is there."""
    paths = [path for path in paths if len(path) == len(paths[0]) and len(path) > 2]
    if not paths:
        return None
    owners = listed([".".join(path[:-1]) for path in paths[:4]], "or")
    path = _proposed(paths)
    if mapping.is_set(name):
        return f"{name} belongs under {owners}. Set {dotted((*mapping.where, *path))}."
    below = mapping.values[path[0]].get(path[1])
    depth = 2 if isinstance(below, dict) and mapping.file(*path[:2]) == mapping.file(name) else 1
    entry = _nested(path[depth:], mapping.values[name])
    return f"{name} belongs under {owners}. Write {entry} under {'.'.join(path[:depth])}."


def _proposed(paths: list[tuple[str, ...]]) -> tuple[str, ...]:
    """Return the path that a message proposes: of the best quality, or the first."""
    return next((path for path in paths if "final" in path), paths[0])


def _nested(path: tuple[str, ...], value: Any) -> str:
    """Return `quality: {final: {samples: 64}}` for the path to samples."""
    for step in reversed(path[1:]):
        value = {step: value}
    return f"{path[0]}: {in_yaml(value)}"
