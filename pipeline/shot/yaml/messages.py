"""Messages about values that a document refuses: where they stand, what they must be, and what is meant."""

from __future__ import annotations

import math
import re
import types
import typing
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cache
from typing import Annotated, Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from flowsculpt.pipeline.errors import suggest
from flowsculpt.pipeline.formula import FormulaError
from flowsculpt.pipeline.plugin import plugins
from flowsculpt.pipeline.shot.yaml.synonyms import synonym, value_meant
from flowsculpt.pipeline.shot.yaml.yaml_source import Problem, Where, YamlSource, dotted_path, shown
from flowsculpt.render.base.foreign_code import located_reason
from flowsculpt.render.base.plural import plural

Models = list[type[BaseModel]]

_FORM = "form "
"""How the members of a union with a discriminator are tagged in pydantic's paths: form 0, form 1, …"""


def types_at(document: type[BaseModel], loc: Where) -> list[Any]:
    """Return the annotations that the value at a path of pydantic's can have; unknown steps are skipped."""
    kinds: list[Any] = [document]
    for step in loc:
        kinds = [inner for kind in kinds for inner in _step(kind, step)] or kinds
    return kinds


def models_at(document: type[BaseModel], loc: Where) -> Models:
    """Return the documents that the mapping at a path of pydantic's can be."""
    return models_in(types_at(document, loc))


def models_in(kinds: list[Any]) -> Models:
    """Return the documents among annotations, in their order."""
    kinds = [member for kind in kinds for member in members(kind)]
    return [member for member in kinds if isinstance(member, type) and issubclass(member, BaseModel)]


def field_names(models: Models) -> dict[str, Any]:
    """Return the annotations of the fields of documents, by the names that a file has for them."""
    return {name: kind for model in models for name, kind in _fields_of(model).items()}


@cache
def _fields_of(model: type[BaseModel]) -> dict[str, Any]:
    return {
        info.alias or name: Annotated[(info.annotation, *info.metadata)] if info.metadata else info.annotation
        for name, info in model.model_fields.items()
    }


def needed_names(models: Models) -> list[str]:
    """Return the names that the first of some documents must have."""
    return [
        info.alias or name
        for model in models[:1]
        for name, info in model.model_fields.items()
        if info.is_required()
    ]


def choices(kind: Any) -> tuple[str, ...]:
    """Return the names that a value can be, if it is a name out of a registry."""
    if typing.get_origin(kind) is Annotated:
        own = next((part.names for part in kind.__metadata__ if hasattr(part, "names")), ())
        return tuple(own) or choices(kind.__origin__)
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        return next((names for member in typing.get_args(kind) if (names := choices(member))), ())
    return ()


def types_in_list(kind: Any) -> list[Any]:
    """Return the types of the items of a list; none for other types."""
    return [typing.get_args(member)[0] for member in members(kind) if typing.get_origin(member) is list]


def paths_to(name: Any, models: Models, depth: int) -> Iterator[tuple[str, ...]]:
    """Yield the paths to a name below documents, the shortest first; lists are left out."""
    inner = {own: models_in([kind]) for own, kind in field_names(models).items()}
    for own, below in inner.items():
        if name in field_names(below):
            yield own, name
    if depth > 1:
        for own, below in inner.items():
            yield from ((own, *path) for path in paths_to(name, below, 1))


def without_tags(loc: Where) -> Where:
    return tuple(step for step in loc if not _is_tag(step))


def _is_tag(step: Any) -> bool:
    return isinstance(step, str) and step.startswith(_FORM) and step[len(_FORM) :].isdigit()


def _step(kind: Any, step: Any) -> Iterator[Any]:
    if _is_tag(step):
        index = int(step[len(_FORM) :])
        yield from list(members(kind))[index : index + 1]
        return
    for member in members(kind):
        origin, arguments = typing.get_origin(member), typing.get_args(member)
        if isinstance(member, type) and issubclass(member, BaseModel):
            fields = field_names([member])
            if step in fields:
                yield fields[step]
        elif origin is list and isinstance(step, int):
            yield arguments[0]
        elif origin is dict:
            yield arguments[1]


def members(kind: Any) -> Iterator[Any]:
    """Yield the members of a union in their order, or the type itself; without annotations."""
    origin = typing.get_origin(kind)
    if origin is Annotated:
        yield from members(kind.__origin__)
    elif origin in (typing.Union, types.UnionType):
        for member in typing.get_args(kind):
            yield from members(member)
    elif kind is not type(None):
        yield kind


_MANY_NAMES = 20
"""A mapping that may have at least so many names is an entry of flows: no other has so many."""


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
            ((*where, name), f"{dotted_path((*where, name))}: unknown name. {_hint(mapping, name, found)}")
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
    if (sentence := plugins().lacking(str(name))) is not None:
        found.covered.update({mapping.where} - {()})
        found.supplied.add(("resample",))  # points need none
        return sentence
    fields = field_names(mapping.models)
    if owners := [own for m in mapping.models if (own := getattr(m, "names_within", {}).get(name))]:
        return f"Did you mean {dotted_path((*mapping.where, owners[0], name))!r}?"
    spelt = re.split(r"[:={]|\s+(?=[-\d{])", str(name).lstrip("- "))[0]
    if (meant := synonym(spelt, fields)) is not None:
        found.supplied.add((*mapping.where, meant))
        if meant in mapping.values and not mapping.source.place((*mapping.where, name)).startswith("--set "):
            return f"Did you mean {meant!r}? It is there already."
        return f"Did you mean {meant!r}{', with a space after its colon' if ':' in str(name) else ''}?"
    if (meant := _as_value(mapping, name)) is not None:
        found.covered.add(mapping.where)
        return f"Did you mean {meant}?"
    if (meant := synonym(spelt, field_names(mapping.every))) is not None and mapping.where:
        found.covered.add(mapping.where)
        if meant == name:
            others = [needed_names([model]) for model in mapping.every if name in field_names([model])]
            own, other = needed_names(mapping.models), others[0]
            if name in other:
                return f"Write {' or '.join([*own, *other])}, not both."
            own = own or [key for key in mapping.values if "." in str(key)]  # a subject of a plug-in
            kinds = [needed[-1] for needed in others if needed] if others[1:] else other
            return f"It is for {' and '.join(dict.fromkeys(kinds))}, not for {' and '.join(own)}."
        return f"Did you mean {meant!r}?"
    for path in (*_below(mapping, name), *_above(mapping, spelt)):
        found.supplied.update(path[:length] for length in range(len(mapping.where) + 1, len(path) + 1))
        if path[:-1] != mapping.where:
            found.covered.add(path[:-1])
        top = " at the top of the file" if len(path) == 1 else ""
        return f"Did you mean {dotted_path(path)!r}{top}?"
    return _closest(mapping, name, found)


def _closest(mapping: _Mapping, name: Any, found: UnknownNames) -> str:
    names = sorted(field_names(mapping.every if len(field_names(mapping.every)) <= 8 else mapping.models))
    if (meant := value_meant(name, names)) is not None:
        return f"Did you mean {meant!r}?"
    listing = "`flowsculpt flows` lists all of them." if mapping.is_entry else ""
    hint = suggest(name, names, listing=listing or "docs/shot-files.md explains all of them.")
    found.supplied.update((*mapping.where, each) for each in names if hint == f"Did you mean {each!r}?")
    if not mapping.where and isinstance(mapping.values.get(name), dict) and not hint.startswith("Did"):
        return plugins().lacking(f"{name}.entries") or hint
    return hint


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


_BOUNDS = {
    "greater_than": "above",
    "greater_than_equal": "at least",
    "less_than": "below",
    "less_than_equal": "at most",
}

_WANTED = {
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "text",
    "bool_type": "true or false",
    "list_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "model_attributes_type": "a mapping",
    "finite_number": "a finite number",
}

MOST_ERRORS = 200
"""Most errors of one file that are explained, the first ones; an alias can repeat one many thousand times."""

_NUMBER = re.compile(
    r"\s*(?:f/)?([-+]?(?:\d[\d_]*(?:[.,]\d*)?|[.,]\d+)(?:[eE][-+]?\d+)?)\s*([^\W\d][\w/²³]*|%|°)?,?\s*"
)

_MOST_READ = 500
"""Characters of a text that are searched for what it means: patterns take long on more."""

_FACTORS = {"%": 0.01, "k": 1e3, "K": 1e3, "M": 1e6}
"""Endings of numbers that change their value; others are units."""


def problems_of(
    error: ValidationError, source: YamlSource, document: type[BaseModel]
) -> tuple[list[Problem], set[Where]]:
    """Return the problems of a ValidationError, each its path in the file and its message; and paths.

    Problems that follow from another one are left out, such as a missing value whose name is misspelt. The
    paths are those of such values. Of more errors than MOST_ERRORS the first are explained.
    """
    errors = error.errors(include_url=False)
    if len(errors) > MOST_ERRORS:
        errors.sort(key=lambda details: source.order(_in_file(source, details["loc"])))
        del errors[MOST_ERRORS:]
    unknown = unknown_names(
        document, source, [details["loc"] for details in errors if details["type"] == "extra_forbidden"]
    )
    problems = list(unknown.problems)
    for details in errors:
        where = _in_file(source, details["loc"])
        if details["type"] == "extra_forbidden" or where in unknown.covered:
            continue
        if details["type"] == "missing" and (*where, details["loc"][-1]) in unknown.supplied:
            continue
        if isinstance(fault := details.get("ctx", {}).get("error"), FormulaError):
            spot = source.spot(where, fault.column)
            message = fault.message if spot else f"column {fault.column} of the formula: {fault.message}"
            problems.append((spot or where, message))
        else:
            written = source.spot_of(where).written
            problems.append((where, _message(details, where, document, written)))
    return list(dict.fromkeys(problems)), unknown.supplied


def number_in(text: str) -> float | int | None:
    """Return the number in a text with a unit, a percent sign or a decimal comma; None if there is none."""
    match = _NUMBER.fullmatch(text) if len(text) <= _MOST_READ else None
    if not match:
        return None
    value = float(match[1].replace(",", ".").replace("_", "")) * _FACTORS.get(match[2] or "", 1.0)
    if not math.isfinite(value):
        return None
    return int(value) if value == int(value) and "." not in match[1] else round(value, 12)


def _in_file(source: YamlSource, loc: Where) -> Where:
    """Return a pydantic location without the tags of unions, which the file does not have."""
    where: Where = ()
    for step in loc:
        if (*where, step) in source.places:
            where = (*where, step)
    return where


def _message(details: ErrorDetails, where: Where, document: type[BaseModel], written: str) -> str:
    kind, value, context = details["type"], details["input"], details.get("ctx", {})
    value = value[:_MOST_READ] if isinstance(value, str) else value
    name = dotted_path(where) or "the file"
    if kind == "finding":
        return str(context["text"])
    if kind in ("value_error", "assertion_error"):  # the latter in the code of a plug-in
        return f"{name}: {context['error'] if kind == 'value_error' else located_reason(context['error'])}"
    if kind == "string_pattern_mismatch" and "%" in context["pattern"]:
        return f"{name}: {shown(value)} is not a percentage from 0% to 100%, such as 2%"
    if kind == "missing":
        return f"{dotted_path((*where, details['loc'][-1]))}: missing; it has no default"
    if kind in _BOUNDS:
        return f"{name}: {value} is out of range; it must be {_BOUNDS[kind]} {next(iter(context.values())):g}"
    if kind.endswith(("too_short", "too_long")):
        each, given = "character" if "string" in kind else "item", details["input"]
        count = plural(len(given), each) if given else "empty"
        bound = plural(int(context.get("min_length", context.get("max_length", 0))), each)
        return f"{name}: {count}; it must have at {'least' if 'short' in kind else 'most'} {bound}"
    if kind == "literal_error":
        return f"{name}: {_wrong_word(value, context['expected'], _other_forms(details['loc'], document))}"
    if kind in _WANTED:
        return f"{name}: {_wrong_type(kind, value, details['loc'], document, written)}"
    if kind == "invalid_key":
        also = "; a decimal has a point, as in 0.5" if isinstance(value, int) else ""
        return f"{name}: a name must be text{also}"
    return f"{name}: {details['msg']}"


def _wrong_word(value: Any, expected: str, mappings: list[type[BaseModel]]) -> str:
    """Return what is wrong with a value that is none of a few words, or of those and a mapping."""
    words = re.findall(r"'([^']*)'", expected)
    hint = suggest("off" if value in (False, "no", "none") else value, words)
    also = f" or a mapping, such as {example_of(mappings)}" if mappings else ""
    fact = "empty" if value is None else f"{shown(value)} is not allowed"
    rule = f"{fact}; it must be {expected}{also}"
    return f"{rule}. {hint}" if hint.startswith("Did") else rule


def _wrong_type(kind: str, value: Any, loc: Where, document: type[BaseModel], written: str) -> str:
    """Return fact and rule for a value of the wrong type, and the number in a text that means one.

    written  the value as the file has it without quotes; empty for others
    """
    wanted, models = _WANTED[kind], []
    if kind.startswith("model"):
        models = models_in(types_at(document, loc))
    elif kind == "string_type":
        models = _other_forms(loc, document)
    if models:
        wanted += f"{' or a mapping' if kind == 'string_type' else ''}, such as {example_of(models)}"
    is_meant = value is not None or _is_required(loc, document)
    if kind == "string_type" and written and is_meant and not isinstance(value, str):
        read = "empty" if value is None else "yes or no" if isinstance(value, bool) else "a number"
        return f"YAML reads {written} as {read}; it must be {wanted}. Did you mean '{written}', in quotes?"
    if value is None:
        also = "" if _is_required(loc, document) else ", or leave the name out for the default"
        return f"empty; it must be {wanted}{also}"
    fact = f"{shown(value)} is not {wanted}"
    if isinstance(value, str) and wanted.endswith("number") and (number := number_in(value)) is not None:
        return f"{fact}. Did you mean {number}?"
    if isinstance(value, float) and kind.startswith("int") and math.isfinite(value):
        return f"{fact}. Did you mean {math.ceil(value)}?"
    return fact


def example_of(models: list[type[BaseModel]]) -> str:
    """Return a mapping that can stand in place of a wrong value: an example of the document, or its names."""
    names = needed_names(models) or list(models[0].model_fields)[:1]
    return str(getattr(models[0], "example", "")) or "{" + ", ".join(f"{name}: …" for name in names) + "}"


def _other_forms(loc: Where, document: type[BaseModel]) -> list[type[BaseModel]]:
    """Return the mappings that can stand in place of a bare value."""
    return models_at(document, loc[:-1]) if loc and _is_tag(loc[-1]) else []


def _is_required(loc: Where, document: type[BaseModel]) -> bool:
    steps = without_tags(loc)
    for model in models_at(document, loc[: loc.index(steps[-1])]) if steps else []:
        if steps[-1] in field_names([model]):
            return steps[-1] in needed_names([model])
    return True
