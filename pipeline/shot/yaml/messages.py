"""Every problem that pydantic finds in a file: `key: what is wrong; what is allowed. Did you mean …?`."""

from __future__ import annotations

import math
import re
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from pipeline.errors import suggestion
from pipeline.shot.yaml.plain_text import dotted, shown
from pipeline.shot.yaml.schema_walk import models_at, models_in, needed_names, types_at
from pipeline.shot.yaml.unknown_names import unknown_names
from pipeline.shot.yaml.yaml_source import Problem, Where, YamlSource
from render.base.plural import plural

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
        problems.append(_problem(details, where, source, document))
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


def _problem(details: ErrorDetails, where: Where, source: YamlSource, document: type[BaseModel]) -> Problem:
    if details["type"] != "formula":
        return where, _message(details, where, document)
    column, message = details["ctx"]["column"], details["msg"]
    spot = source.spot(where, column)
    return spot or where, message if spot else f"column {column} of the formula: {message}"


def _in_file(source: YamlSource, loc: Where) -> Where:
    """Return a pydantic location without the tags of unions, which the file does not have."""
    where: Where = ()
    for step in loc:
        if (*where, step) in source.places:
            where = (*where, step)
    return where


def _message(details: ErrorDetails, where: Where, document: type[BaseModel]) -> str:
    kind, value, context = details["type"], details["input"], details.get("ctx", {})
    value = value[:_MOST_READ] if isinstance(value, str) else value
    name = dotted(where) or "the file"
    if kind == "finding":
        return str(context["text"])
    if kind == "missing":
        return f"{dotted((*where, details['loc'][-1]))}: missing; it has no default"
    if kind in _BOUNDS:
        return f"{name}: {value} is out of range; it must be {_BOUNDS[kind]} {next(iter(context.values())):g}"
    if kind in ("too_short", "too_long"):
        least = "at least" if kind == "too_short" else "at most"
        count = plural(context["actual_length"], "item") if context["actual_length"] else "empty"
        bound = int(context.get("min_length", context.get("max_length", 0)))
        return f"{name}: {count}; it must have {least} {plural(bound, 'item')}"
    if kind == "literal_error":
        return f"{name}: {_wrong_word(value, context['expected'], _other_forms(details['loc'], document))}"
    if kind in _WANTED:
        return f"{name}: {_wrong_type(kind, value, details['loc'], document)}"
    if kind == "invalid_key":
        also = "; a decimal has a point, as in 0.5" if isinstance(value, int) else ""
        return f"{name}: a name must be text{also}"
    return f"{name}: {details['msg']}"


def _wrong_word(value: Any, expected: str, mappings: list[type[BaseModel]]) -> str:
    """Return what is wrong with a value that is none of a few words, or of those and a mapping."""
    words = re.findall(r"'([^']*)'", expected)
    hint = suggestion("off" if value in (False, "no", "none") else value, words)
    also = f" or a mapping, such as {example_of(mappings)}" if mappings else ""
    fact = "empty" if value is None else f"{shown(value)} is not allowed"
    rule = f"{fact}; it must be {expected}{also}"
    return f"{rule}. {hint}" if hint.startswith("Did") else rule


def _wrong_type(kind: str, value: Any, loc: Where, document: type[BaseModel]) -> str:
    """Return fact and rule for a value of the wrong type, and the number in a text that means one."""
    wanted, models = _WANTED[kind], []
    if kind.startswith("model"):
        models = models_in(types_at(document, loc))
    elif kind == "string_type":
        models = _other_forms(loc, document)
    if models:
        wanted += f"{' or a mapping' if kind == 'string_type' else ''}, such as {example_of(models)}"
    if value is None:
        also = "" if _is_required(loc, document) else ", or leave the name out for the default"
        return f"empty; it must be {wanted}{also}"
    fact = f"{shown(value)} is not {wanted}"
    if isinstance(value, str) and wanted.endswith("number") and (number := number_in(value)) is not None:
        return f"{fact}. Did you mean {number}?"
    if isinstance(value, float) and kind.startswith("int") and math.isfinite(value):
        return f"{fact}. Did you mean {math.ceil(value)}?"
    if isinstance(value, int | float) and kind == "string_type" and not models:
        return f"{fact}. Did you mean '{str(value).lower()}'?"
    return fact


def example_of(models: list[type[BaseModel]]) -> str:
    """Return a mapping that can stand in place of a wrong value: an example of the document, or its names."""
    names = needed_names(models) or list(models[0].model_fields)[:1]
    return str(getattr(models[0], "example", "")) or "{" + ", ".join(f"{name}: …" for name in names) + "}"


def _other_forms(loc: Where, document: type[BaseModel]) -> list[type[BaseModel]]:
    """Return the mappings that can stand in place of a bare value."""
    return models_in(types_at(document, loc[:-1])) if str(loc[-1:]).startswith("('form ") else []


def _is_required(loc: Where, document: type[BaseModel]) -> bool:
    steps = [step for step in loc if not str(step).startswith("form ")]
    for model in models_at(document, tuple(loc[: loc.index(steps[-1])])) if steps else []:
        for name, info in model.model_fields.items():
            if steps[-1] in (name, info.alias):
                return info.is_required()
    return True
