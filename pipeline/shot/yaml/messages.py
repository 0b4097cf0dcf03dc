"""Every problem that pydantic finds in a file, with its place and a message: fact, rule and remedy."""

from __future__ import annotations

import math
import re
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from pipeline.shot.yaml.plain_text import dotted, in_yaml, shown
from pipeline.shot.yaml.schema_walk import field_names, members, models_at, models_in, types_at, types_in_list
from pipeline.shot.yaml.synonyms import as_name
from pipeline.shot.yaml.unknown_names import unknown_names
from pipeline.shot.yaml.yaml_source import Problem, Where, YamlSource
from render.base.plural import plural

_BOUNDS = {
    "greater_than": "above",
    "greater_than_equal": "at least",
    "less_than": "below",
    "less_than_equal": "at most",
}

MOST_ERRORS = 200
"""Most errors of one file that are explained, the first ones; an alias can repeat one many thousand times."""

_NUMBER = re.compile(
    r"\s*(?:f/)?([-+]?(?:\d[\d_]*(?:[.,]\d*)?|[.,]\d+)(?:[eE][-+]?\d+)?)\s*([^\W\d][\w/²³]*|%|°)?\s*"
)

_MOST_READ = 500
"""Characters of a text that are searched for what it means: patterns take long on more."""

_FACTORS = {"%": 0.01, "k": 1e3, "K": 1e3, "M": 1e6}
"""Endings of numbers that change their value; others are units."""

_TRUE, _FALSE = ("yes", "on", "true", "y", "1"), ("no", "off", "false", "n", "none", "0")


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


def list_in(text: str) -> str | None:
    """Return the list that a text means, such as `(1, 2, 3)`, `1 2 3` or `x, y`; None if it means none."""
    if len(text) > _MOST_READ:
        return None
    inner = re.fullmatch(r"\s*[\[(](.*)[\])]\s*", text)
    words = text.split()
    if len(words) > 1 and all(word.isidentifier() and re.search(r"\d", word) for word in words):  # shots
        return f"[{', '.join(words)}]"
    if "," in text:
        return f"[{inner[1] if inner else text.strip()}]"
    numbers = re.findall(r"[-+]?\d*\.?\d+", text)
    return f"[{', '.join(numbers)}]" if numbers and not re.search(r"[A-Za-z]", text) else None


def example_of(document: type[BaseModel], value: Any) -> str:
    """Return how to write a mapping in place of a value: the value under the first name that takes it."""
    for name in field_names([document]):
        try:
            document.model_validate({name: value})
        except ValidationError:
            continue
        return in_yaml({name: value})
    if example := _example([document]):
        return example
    needed = [info.alias or name for name, info in document.model_fields.items() if info.is_required()]
    return in_yaml(dict.fromkeys(needed or list(field_names([document]))[:1], "…"))


def _example(documents: list[type[BaseModel]]) -> str:
    return str(getattr(documents[0], "example", "")) if documents else ""


def _problem(details: ErrorDetails, where: Where, source: YamlSource, document: type[BaseModel]) -> Problem:
    if details["type"] != "formula":
        return where, _message(details, where, source, document)
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


def _message(details: ErrorDetails, where: Where, source: YamlSource, document: type[BaseModel]) -> str:
    kind, value, context = details["type"], details["input"], details.get("ctx", {})
    value = value[:_MOST_READ] if isinstance(value, str) else value
    name = dotted(source.written_path(where))
    if kind == "finding":
        return str(context["text"])
    if kind == "bad_curve":
        return f"{name} {details['msg']}"
    if kind == "missing":
        missing = details["loc"][-1]
        under = f" under {name}" if name else ""
        return f"{missing} is missing{under}; it has no default. Add `{missing}: …`."
    if kind == "literal_error":
        mapping = _other_forms(details["loc"], document)
        return f"{name} is {shown(value)}; it must be {_words(value, context['expected'], where, mapping)}"
    if kind in _BOUNDS:
        bound = next(iter(context.values()))
        number = value if isinstance(value, int | float) else math.nan
        percent = bound <= 1 and 5 <= number <= 100 and kind.startswith("less")
        remedy = f". Write {number / 100:g} for {number:g}%." if percent else ""
        return f"{name} is {value}; it must be {_BOUNDS[kind]} {bound:g}{remedy}"
    if kind in ("too_short", "too_long"):
        bound = context.get("min_length", context.get("max_length"))
        if not context["actual_length"]:
            return f"{name} is empty; it must have {bound} or more items. Write them, or remove the name."
        least = "at least" if kind == "too_short" else "at most"
        return f"{name} has {plural(context['actual_length'], 'item')}; it must have {least} {bound}"
    if (rule := _rule(kind, value, details["loc"], document)) is not None:
        return f"{name or 'the file'} is {shown(value)}; {rule}"
    return f"{name}: {details['msg']}" if name else details["msg"]


def _rule(kind: str, value: Any, loc: Where, document: type[BaseModel]) -> str | None:
    """Return rule and remedy for a value of the wrong type; None for other errors."""
    if value is None and kind.endswith(("_type", "_parsing")):
        wanted = _WANTED.get(kind, "a mapping")
        also = ", or remove the name for the default" if not _is_required(loc, document) else ""
        if _WANTED.get(kind) is None and (example := _example(models_in(types_at(document, loc)))):
            return f"it must be {wanted}. Write {_last_name(loc)}: {example}{also}."
        return f"it must be {wanted}. Write one after the colon{also}."
    match kind:
        case "float_type" | "float_parsing" | "int_type" | "int_from_float":
            return _number(value, whole=kind.startswith("int"))
        case "string_type":
            mapping = _other_forms(loc, document)
            example = _example(mapping)
            also = f" or a mapping, such as {example}" if example else ""
            return f"it must be text{also}. {_text(value, example)}"
        case "bool_type":
            return f"it must be true or false. {_flag(value)}"
        case "list_type":
            return f"it must be a list. Write {_list(value, types_at(document, loc))}."
        case "dict_type":
            return "it must be a mapping. Write it as {name: value}."
        case "model_type" | "model_attributes_type":
            return f"it must be a mapping. Write {_mapping(value, loc, document)}."
        case "finite_number":
            return "it must be a finite number. Write its value."
        case "invalid_key":
            return "it is no name; names are text."
    return None


_WANTED = {
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "string_type": "text",
    "bool_type": "true or false",
    "list_type": "a list",
}


def _other_forms(loc: Where, document: type[BaseModel]) -> list[type[BaseModel]]:
    """Return the mappings that can stand in place of a bare value."""
    return models_in(types_at(document, loc[:-1])) if str(loc[-1]).startswith("form ") else []


def _is_required(loc: Where, document: type[BaseModel]) -> bool:
    steps = [step for step in loc if not str(step).startswith("form ")]
    for model in models_at(document, tuple(loc[: loc.index(steps[-1])])) if steps else []:
        for name, info in model.model_fields.items():
            if steps[-1] in (name, info.alias):
                return info.is_required()
    return True


def _last_name(loc: Where) -> str:
    """Return the last name of a pydantic location, without the tags of unions."""
    names = [step for step in loc if isinstance(step, str) and not step.startswith("form ")]
    return names[-1] if names else ""


def _number(value: Any, whole: bool) -> str:
    rule = "it must be a whole number" if whole else "it must be a number"
    if isinstance(value, str) and (number := number_in(value)) is not None:
        number = math.ceil(number) if whole else number
        return f"{rule}, without quotes or units. Write {number}."
    if isinstance(value, float) and whole and math.isfinite(value):
        return f"{rule}. Write {math.ceil(value)}."
    if isinstance(value, list):
        same = value and all(item == value[0] for item in value)
        return f"{rule}, not several. Write {in_yaml(value[0]) if same else 'one'}."
    if isinstance(value, dict):
        return f"{rule}, the same in every frame. Write one."
    return f"{rule}. Write it plainly, without quotes or units."


def _text(value: Any, example: str) -> str:
    """Return the remedy for a value that is no text; `example` is a mapping that can stand in its place."""
    if isinstance(value, int | float):
        return f"Put it in quotes: '{in_yaml(value)}'."
    if isinstance(value, list) and len(value) == 1 and not isinstance(value[0], dict | list):
        return f"Write {value[0]}, without brackets."
    if isinstance(value, list) and example:
        return f"Write one name, without brackets, or {example}."
    if isinstance(value, list):
        return f"Write {', '.join(map(in_yaml, value))}, without brackets."
    return "Put it in quotes."


def _flag(value: Any) -> str:
    word = str(value).lower()
    return "Write true." if word in _TRUE else "Write false." if word in _FALSE else "Write one of them."


def _list(value: Any, kinds: list[Any]) -> str:
    items = {member for kind in kinds for inner in types_in_list(kind) for member in members(inner)}
    if isinstance(value, str):
        return list_in(value) or (f"[{value}]" if str in items else "it as [a, b, c]")
    if isinstance(value, dict):
        if {"x", "y", "z"} == set(value):
            return in_yaml([value["x"], value["y"], value["z"]])
        return in_yaml(list(value)) if not any(value.values()) else "a dash before each item"
    return f"[{in_yaml(value)}]"


def _mapping(value: Any, loc: Where, document: type[BaseModel]) -> str:
    models = models_in(types_at(document, loc))
    name = _last_name(loc)
    if isinstance(value, list) and value and all(isinstance(item, dict) for item in value):
        whole = {key: item for part in value for key, item in part.items()}
        if len(whole) < sum(map(len, value)):
            return f"one of them: {in_yaml(value[0])}"
        return f"its names without dashes: {in_yaml(whole)}"
    if not models or not name:
        return "it as {name: value}"
    if isinstance(value, str) and re.fullmatch(r"\s*\{.*:.*\}\s*", value):
        return f"it without quotes: {name}: {value.strip()}"
    return f"{name}: {example_of(models[0], value)}"


def _words(value: Any, expected: str, where: Where, mappings: list[type[BaseModel]]) -> str:
    """Return rule and remedy for a value that is none of a few words, or of those and a mapping."""
    if value is not None and as_name(value) in _FALSE and "'off'" in expected:
        return f"{expected}. Write off, without quotes."
    if isinstance(value, str) and value != value.lower() and f"'{value.lower()}'" in expected:
        return f"{expected}. Write {value.lower()}."
    if not mappings:
        return expected
    return f"{expected} or a mapping. Write {where[-1]}: {example_of(mappings[0], value)}."
