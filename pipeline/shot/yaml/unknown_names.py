"""Messages about unknown names: what is meant, where it belongs, or which names there are."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel, ValidationError

from pipeline.errors import MOST_QUOTED, suggestion
from pipeline.shot.yaml.plain_text import dotted, in_yaml, listed
from pipeline.shot.yaml.schema_walk import (
    Models,
    choices,
    field_names,
    fitting,
    members,
    models_at,
    models_in,
    needed_names,
    paths_to,
    types_at,
    types_in_list,
    without_tags,
)
from pipeline.shot.yaml.source import Problem, Where, YamlSource
from pipeline.shot.yaml.synonyms import FLOW_REMEDIES, REMEDIES, RENAMED, VALUES, as_name, synonym

SPELT_OUT = {"look": "material", "lights": "rig", "stage": "kind"}
"""Entries that are a name or a mapping, and what the name is called in the mapping."""

_NAMED_BY = ("type", "name", "flow", "kind")
"""Words under which other formats have the name of a thing that a shot has as a key."""

MOST_LISTED, MOST_BRIEF = 20, 8
"""Most names in one message; and most of all forms of a mapping together."""


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
    by_mapping: dict[Where, list[Where]] = {}
    for loc in locs:
        by_mapping.setdefault(loc[:-1], []).append(loc)
    for mapping, inside in by_mapping.items():
        kinds = types_at(document, mapping)
        every = models_in(types_at(document, without_tags(mapping)))
        _Mapping(document, source, without_tags(mapping), models_in(kinds), every, found).explain(
            [loc[-1] for loc in inside]
        )
    return found


@dataclass(frozen=True)
class _Mapping:
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

    def explain(self, unknown: list[Any]) -> None:
        told: set[str] = set()
        if self._is_named_by_value(unknown):
            return
        beside: dict[Any, list[Any]] = {}
        for name in unknown:
            owner = self._owner(name, unknown)
            if owner is None:
                message = self._message(name)
                if message.partition(".")[2] not in told or "Rename" in message:
                    self._tell(name, message)
                told.add(message.partition(".")[2])
            else:
                beside.setdefault(owner, []).append(name)
        for owner, names in beside.items():
            self._tell_beside(owner, names)

    def _tell(self, name: Any, message: str) -> None:
        self.found.problems.append(((*self.where, name), message))

    @property
    def _name(self) -> str:
        """The path of the mapping, as the file writes it."""
        return dotted(self.source.written_path(self.where))

    @property
    def _fields(self) -> dict[str, Any]:
        return field_names(self.models)

    @property
    def _values(self) -> dict[Any, Any]:
        value = self.source.get(*self.where)
        return value if isinstance(value, dict) else {}

    def _beside(self, name: Any) -> dict[Any, Any]:
        """Return the known values beside a name in the same file; for a setting, those of all files."""
        values, file = self._values, self._file(name)
        known = [other for other in self._fields if other in values]
        return {other: values[other] for other in known if self._is_set(name) or self._file(other) == file}

    def _file(self, *names: Any) -> str:
        return self.source.spot_of((*self.where, *names))[0]

    def _is_named_by_value(self, unknown: list[Any]) -> bool:
        """Report `{type: twist, amount: 80}`, which is `twist: {amount: 80}`."""
        for name in unknown:
            value = self._values[name]
            if name not in _NAMED_BY or not isinstance(value, str) or not self._is_entry:
                continue
            if value not in self._fields:
                continue
            rest = {key: item for key, item in self._values.items() if key != name}
            self._tell(name, f"a flow stands under its name. Write {value}: {in_yaml(rest)}.")
            self.found.covered.add(self.where)
            return True
        return False

    @property
    def _is_entry(self) -> bool:
        """Tell whether the mapping is an entry of flows, which has one name."""
        return len(self._fields) > MOST_LISTED and bool(self.where)

    def _owner(self, name: Any, unknown: list[Any]) -> Any:
        """Return the name beside this one under which it belongs; None if there is none."""
        for other, value in self._beside(name).items():
            inner = models_in([self._fields[other]]) if other in self._fields else []
            if (value is None or isinstance(value, dict)) and name in field_names(fitting(inner, value)):
                return other
        return None

    def _tell_beside(self, owner: Any, names: list[Any]) -> None:
        below = self._values[owner]
        what = f"{listed(names)} {'belongs' if len(names) == 1 else 'belong'} to {owner}"
        it = "it" if len(names) == 1 else "them"
        if self._is_set(names[0]):
            remedy = f"Set {dotted((*self.where, owner, names[0]))}."
        elif isinstance(below, dict) and below and self._is_in_braces(owner, below):
            whole = {**below, **{name: self._values[name] for name in names}}
            remedy = f"Write {owner}: {in_yaml(whole)}."
        else:
            remedy = f"Indent {it} under {owner}."
        self._tell(names[0], f"{what} and {'stands' if len(names) == 1 else 'stand'} beside it. {remedy}")
        self.found.covered.add((*self.where, owner))
        self.found.supplied.update((*self.where, owner, name) for name in names)

    def _is_set(self, name: Any) -> bool:
        """Tell whether an option of the command line sets a value."""
        return self.source.spot_of((*self.where, name))[1] == 0

    def _is_in_braces(self, owner: Any, below: dict[Any, Any]) -> bool:
        first = (*self.where, owner, next(iter(below)))
        lines = [self.source.spot_of(where)[1] for where in ((*self.where, owner), first)]
        return lines[0] == lines[1]

    def _message(self, name: Any) -> str:
        under = f" under {self._name}" if self.where else ""
        if (new := RENAMED.get(name)) in self._fields:
            self.found.supplied.add((*self.where, new))
            return f"{name} is called {new} now{under}. Rename it."
        for explain in (
            self._misspelt,
            self._other_form,
            self._synonym,
            self._chosen,
            self._lower,
            self._higher,
        ):
            if (message := explain(name)) is not None:
                return message
        return f"{name} is not known{under}. {self._remedy(name)}"

    def _misspelt(self, name: Any) -> str | None:
        """Return the message about marks and capitals that are no part of the name."""
        text = str(name)[:MOST_QUOTED]
        if text.startswith("-") and as_name(text[1:]) in self._fields:
            return f"a space is missing after the dash. Write - {text[1:]}: …"
        for mark, fact in ((":", "a space is missing after the colon"), ("=", "a colon ends a name, not =")):
            first = text.partition(mark)[0].strip()
            if mark in text and as_name(first) in self._fields:
                self.found.supplied.add((*self.where, first))
                return f"{fact}. Write {first}: …"
        brace = re.fullmatch(r"([\w ]+?)\s*(\{.*)", text)
        if brace and as_name(brace[1]) in self._fields:
            self.found.covered.add(self.where)
            dash = "- " if self._is_entry else ""
            rest = f"{brace[2]}: {in_yaml(self._values[name])}"
            return f"a colon is missing after {brace[1]}. Write {dash}{as_name(brace[1])}: {rest}."
        spelt = as_name(name)
        if spelt in self._fields and spelt != name:
            self.found.supplied.add((*self.where, spelt))
            return f"{name} is written {spelt}. Rename it."
        return None

    def _other_form(self, name: Any) -> str | None:
        """Return the message about a name that another form of this mapping has: size beside a model."""
        others = [model for model in self.every if name in field_names([model])]
        if not others or not self.where:
            return None
        mine, theirs = needed_names(self.models), needed_names(others[:1])
        if name in theirs:
            return f"{self._name} has {listed([*mine, name])}; it is one of them. Remove the others."
        kind = "subject" if self.where[0] == "subjects" else self.where[-1]
        return f"{name} is for a {kind} with {listed(theirs)}, not with {listed(mine)}. Remove it."

    def _higher(self, name: Any) -> str | None:
        """Return the message about a name that belongs further up."""
        for length in range(len(self.where) - 1, -1, -1):
            above = self.where[:length]
            if name in field_names(models_at(self.document, above)) and not isinstance(above[-1:], int):
                owner, inner = dotted(above) or "the top of the file", self._name
                block = next(step for step in reversed(self.where) if isinstance(step, str))
                return f"{name} belongs to {owner}, not to {inner}. Move it out of {block}."
        return None

    def _synonym(self, name: Any) -> str | None:
        new = synonym(name, [each for each in self._fields if each not in self._beside(name)])
        if new is None:
            new = synonym(name, field_names(self.every))
            if new is None:
                return None
            if new in self._beside(name):
                remedy = f"Set {dotted((*self.where, new))}" if self._is_set(name) else "Remove one of them"
                return f"{name} is called {new} in {self._here}, which is there. {remedy}."
            self.found.covered.add(self.where)
        self.found.supplied.add((*self.where, new))
        return f"{name} is called {new} in {self._here}. {self._rename(name, new)}"

    @property
    def _here(self) -> str:
        return self._name or str(getattr(self.document, "what", "a shot"))

    def _rename(self, name: Any, new: str) -> str:
        """Return the remedy for another name; if its value does not fit there, with one that does."""
        for model in self.models:
            try:
                model.model_validate({new: self._values[name]})
            except ValidationError as error:
                for each in error.errors():
                    proposed = re.search(r"Write (\[.*?\])\.", str(each["msg"]))
                    if proposed and each["loc"][0] == new:
                        inner = [step for step in each["loc"] if not str(step).startswith("form ")]
                        text = proposed[1]
                        for step in reversed(inner[1:]):
                            text = f"{{{step}: {text}}}"
                        return f"Write {new}: {text}."
        return "Rename it."

    def _chosen(self, name: Any) -> str | None:
        """Return the message about a value that stands as a name: `{box: {size: …}}`."""
        for owner, kind in field_names(self.every).items():
            if name in choices(kind) and owner not in self._values:
                self.found.covered.add(self.where)
                below = self._values[name]
                rest = {owner: name, **(below if isinstance(below, dict) else {})}
                return f"{name} is a value of {owner}. Write {in_yaml(rest)}."
        return None

    def _lower(self, name: Any) -> str | None:
        """Return the message about a name that belongs one or two levels further down."""
        if self._is_entry:
            return None
        value = self._values[name]
        for own, kind in self._fields.items():
            if self._values.get(own) and own in SPELT_OUT and name in field_names(models_in([kind])):
                whole = {SPELT_OUT[own]: self._values[own], name: value}
                return f"{name} belongs to {own}. Write {own}: {in_yaml(whole)}."
            if name in field_names(models_in(types_in_list(kind))):
                self.found.supplied.add((*self.where, own))
                if isinstance(value, list):
                    return f"{name} is called {own} in {self._here}. Rename it."
                return f"{name} belongs under {own}. Write {own}: [{in_yaml({name: value})}]."
        beside = self._beside(name)
        every = list(paths_to(name, self.models, 2))
        paths = [path for path in every if path[0] not in beside]
        paths = [path for path in paths if len(path) == len(paths[0])]
        if not paths:
            return self._into(name, [path for path in every if isinstance(beside[path[0]], dict)])
        self.found.supplied.update((*self.where, *path[:1]) for path in paths)
        value = self._fitting(_proposed(paths), value)
        if self._is_set(name):
            return f"{name} belongs further down. Set {dotted((*self.where, *_proposed(paths)))}."
        owners = listed([".".join(path[:-1]) for path in paths[:4]], "or")
        return f"{name} belongs under {owners}. Write {_nested(_proposed(paths), value)}."

    def _fitting(self, path: tuple[str, ...], value: Any) -> Any:
        """Return a value; for true and false where a word must stand the last or the first of them."""
        steps = tuple(step for step in self.where if isinstance(step, str))
        kinds = [member for kind in types_at(self.document, (*steps, *path)) for member in members(kind)]
        words = [word for kind in kinds if get_origin(kind) is Literal for word in get_args(kind)]
        return words[-1 if value else 0] if words and isinstance(value, bool) else value

    def _into(self, name: Any, paths: list[tuple[str, ...]]) -> str | None:
        """Return the message about a name that belongs into a mapping which is there."""
        paths = [path for path in paths if len(path) == len(paths[0]) and len(path) > 2]
        if not paths:
            return None
        owners = listed([".".join(path[:-1]) for path in paths[:4]], "or")
        path = _proposed(paths)
        if self._is_set(name):
            return f"{name} belongs under {owners}. Set {dotted((*self.where, *path))}."
        below = self._values[path[0]].get(path[1])
        depth = 2 if isinstance(below, dict) and self._file(*path[:2]) == self._file(name) else 1
        entry = _nested(path[depth:], self._values[name])
        return f"{name} belongs under {owners}. Write {entry} under {'.'.join(path[:depth])}."

    def _remedy(self, name: Any) -> str:
        in_flows = FLOW_REMEDIES if "flows" in self.where[:3] else {}
        if (remedy := in_flows.get(as_name(name)) or REMEDIES.get(as_name(name))) is not None:
            self.found.covered.add(self.where)
            return f"{remedy}."
        every = field_names(self.every)
        names = sorted(every if len(every) <= MOST_BRIEF else self._fields)
        if (meant := VALUES.get(as_name(name))) in names:
            return f"Did you mean {meant!r}?"
        listing = ""
        if self._is_entry:
            listing = "`flowsculpt flows` lists all of them."
        elif not self.where:
            listing = "docs/shot-files.md explains all of them."
        hint = suggestion(name, names, listing=listing)
        self.found.supplied.update((*self.where, each) for each in names if hint == f"Did you mean {each!r}?")
        return hint


def _proposed(paths: list[tuple[str, ...]]) -> tuple[str, ...]:
    """Return the path that a message proposes: of the best quality, or the first."""
    return next((path for path in paths if "final" in path), paths[0])


def _nested(path: tuple[str, ...], value: Any) -> str:
    """Return `quality: {final: {samples: 64}}` for the path to samples."""
    for step in reversed(path[1:]):
        value = {step: value}
    return f"{path[0]}: {in_yaml(value)}"
