"""Messages about names that a file may not have: what is meant, or which names there are."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from pydantic import BaseModel

from pipeline.errors import suggestion
from pipeline.shot.yaml.plain_text import dotted
from pipeline.shot.yaml.schema_walk import (
    Models,
    choices,
    field_names,
    models_at,
    models_in,
    needed_names,
    paths_to,
    types_at,
    types_in_list,
    without_tags,
)
from pipeline.shot.yaml.synonyms import synonym, value_meant
from pipeline.shot.yaml.yaml_source import Problem, Where, YamlSource

_MANY_NAMES = 20
"""Names from which on a mapping is an entry of flows: no other has so many."""


_TOP_NAMES = ("picture", "resample", "shutter")
"""Names at the top of a shot for what other programs set in cameras, qualities and subjects."""


@dataclass
class UnknownNames:
    """The messages about unknown names, and what they explain: problems there need no message of their own.

    supplied  paths of values that are missing only because their names are wrong
    covered   paths of mappings whose other problems follow from the same mistake
    """

    problems: list[Problem] = field(default_factory=list)
    supplied: set[Where] = field(default_factory=set)
    covered: set[Where] = field(default_factory=set)


def unknown_names(document: type[BaseModel], source: YamlSource, locs: Iterable[Where]) -> UnknownNames:
    """Return the messages about names that pydantic does not know, by their paths there."""
    found = UnknownNames()
    for loc in locs:
        where, name = without_tags(loc[:-1]), loc[-1]
        if where in found.covered:
            continue
        mapping = _Mapping(document, source, where, models_in(types_at(document, loc[:-1])))
        found.problems.append(
            ((*where, name), f"{dotted((*where, name))}: unknown name. {_hint(mapping, name, found)}")
        )
    return found


@dataclass(frozen=True)
class _Mapping:
    """A mapping with an unknown name, and the documents that it can be by its form."""

    document: type[BaseModel]
    source: YamlSource
    where: Where
    models: Models

    @property
    def values(self) -> dict[Any, Any]:
        value = self.source.get(*self.where)
        return value if isinstance(value, dict) else {}

    @property
    def every(self) -> Models:
        """The documents of all forms that could stand here."""
        return models_in(types_at(self.document, self.where))

    @property
    def is_entry(self) -> bool:
        """True for an entry of flows, which has one name."""
        return len(field_names(self.models)) > _MANY_NAMES and bool(self.where)


def _hint(mapping: _Mapping, name: Any, found: UnknownNames) -> str:
    """Return a did-you-mean, or the names there are; note what it explains."""
    fields = field_names(mapping.models)
    spelt = re.split(r"[:={]|\s+(?=[-\d{])", str(name).lstrip("- "))[0]
    if (meant := synonym(spelt, fields)) is not None:
        found.supplied.add((*mapping.where, meant))
        if meant in mapping.values:
            return f"Did you mean {meant!r}? It is there already."
        return f"Did you mean {meant!r}{', with a space after its colon' if ':' in str(name) else ''}?"
    if (meant := _as_value(mapping, name)) is not None:
        found.covered.add(mapping.where)
        return f"Did you mean {meant}?"
    if (meant := synonym(spelt, field_names(mapping.every))) is not None and mapping.where:
        found.covered.add(mapping.where)
        if meant == name:
            own, other = needed_names(mapping.models), needed_names([_with_name(mapping.every, name)])
            if name in other:
                return f"Write {' or '.join([*own, *other])}, not both."
            return f"It is for {' and '.join(other)}, not for {' and '.join(own)}."
        return f"Did you mean {meant!r}?"
    for path in (*_below(mapping, name), *_above(mapping, spelt)):
        found.supplied.update(path[:length] for length in range(len(mapping.where) + 1, len(path) + 1))
        if path[:-1] != mapping.where:
            found.covered.add(path[:-1])
        top = " at the top of the file" if len(path) == 1 else ""
        return f"Did you mean {dotted(path)!r}{top}?"
    return _closest(mapping, name, found)


def _closest(mapping: _Mapping, name: Any, found: UnknownNames) -> str:
    names = sorted(field_names(mapping.every if len(field_names(mapping.every)) <= 8 else mapping.models))
    if (meant := value_meant(name, names)) is not None:
        return f"Did you mean {meant!r}?"
    listing = "`flowsculpt flows` lists all of them." if mapping.is_entry else ""
    hint = suggestion(name, names, listing=listing or "docs/shot-files.md explains all of them.")
    found.supplied.update((*mapping.where, each) for each in names if hint == f"Did you mean {each!r}?")
    return hint


def _with_name(models: Models, name: Any) -> type[BaseModel]:
    return next(model for model in models if name in field_names([model]))


def _as_value(mapping: _Mapping, name: Any) -> str | None:
    """Return the entry that is meant by `{type: twist}` or `{box: {size: …}}`."""
    value = mapping.values.get(name)
    if (
        isinstance(value, str)
        and value in field_names(mapping.models)
        and name in ("type", "name", "flow", "kind")
    ):
        return f"'{value}: {{…}}'"
    for owner, kind in field_names(mapping.every).items():
        if name in choices(kind) and owner not in mapping.values:
            return f"'{owner}: {name}'"
    return None


def _below(mapping: _Mapping, name: Any) -> Iterator[Where]:
    """Yield paths to a name one or two levels further down: first below mappings that are there or empty."""
    fields, values = field_names(mapping.models), mapping.values
    if mapping.is_entry:
        fields = {own: kind for own, kind in fields.items() if own in values}
    for own, kind in fields.items():
        is_mapping = own in values and (values[own] is None or isinstance(values[own], dict))
        if is_mapping and name in field_names(models_in([kind])):
            yield *mapping.where, own, name
    if mapping.is_entry:
        return
    for own, kind in fields.items():
        if name in field_names(models_in(types_in_list(kind))):
            yield *mapping.where, own, 0, name
    paths = [path for path in paths_to(name, mapping.models, 2) if isinstance(values.get(path[0], {}), dict)]
    for path in sorted(paths, key=lambda path: "final" not in path):
        yield *mapping.where, *path


def _above(mapping: _Mapping, name: Any) -> Iterator[Where]:
    """Yield the paths at which mappings further up have a name."""
    for length in range(len(mapping.where) - 1, -1, -1):
        above = mapping.where[:length]
        if name in field_names(models_at(mapping.document, above)):
            yield *above, name
    if mapping.where and (meant := synonym(name, _TOP_NAMES)) is not None:
        yield (meant,)
