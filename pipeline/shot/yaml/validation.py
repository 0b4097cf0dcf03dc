"""Validation of a file by a document: its context, and every problem with line and column.

A message says place, fact, rule and remedy.
"""

from __future__ import annotations

import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError, ValidationInfo
from pydantic_core import ErrorDetails, PydanticCustomError

from pipeline.errors import FlowsculptError, MissingInputError, ShotError, suggestion
from pipeline.frames import shortened
from pipeline.shot.yaml.lookup import digest_of_file, is_there, shown
from pipeline.shot.yaml.source import Problem, Where, YamlSource
from render.base.plural import plural

T = TypeVar("T")
D = TypeVar("D", bound=BaseModel)

_RENAMED = {
    "stride": "max_step",
    "renew": "rest_interval",
    "shape": "min_roundness",
    "guides": "auxiliary_samples",
    "steady": "temporal_denoise",
    "fall": "falloff_type",
}
"""Words of earlier shot files, and what they are called now."""

_EXPECTED = {
    "float_type": "a number. Write it plainly, without quotes or units",
    "float_parsing": "a number. Write it plainly, without quotes or units",
    "int_type": "a whole number. Write it without a point or quotes",
    "string_type": "text. Put it in quotes",
    "bool_type": "true or false. Write one of them",
    "list_type": "a list. Write it as [a, b, c]",
    "dict_type": "a mapping. Write it as {name: value}",
    "model_type": "a mapping. Write it as {name: value}",
    "model_attributes_type": "a mapping. Write it as {name: value}",
    "finite_number": "a finite number. Write its value",
}

_BOUNDS = {
    "greater_than": "above",
    "greater_than_equal": "at least",
    "less_than": "below",
    "less_than_equal": "at most",
}


@dataclass(frozen=True)
class ParseContext:
    """The entry `parse_context` of the context in which documents are validated.

    folder      of the shot file; files that it names are relative to it
    allow_code  True if Python files that it names may run
    digests     SHA-256 of the contents of the files that documents have opened
    """

    folder: Path = Path()
    allow_code: bool = False
    digests: dict[Path, str] = field(default_factory=dict)

    @classmethod
    def of(cls, info: ValidationInfo) -> ParseContext:
        context = (info.context or {}).get("parse_context")
        return context if isinstance(context, cls) else cls()

    def file(self, name: str) -> Path:
        """Return the path of a file, and note its digest. Raises a finding where it is not there."""
        path = self._path(name)
        self.digests[path] = as_finding(lambda: digest_of_file(path))
        return path

    def _path(self, name: str) -> Path:
        path = self.folder / name
        if not is_there(path):
            raise finding(missing_file(name, path))
        return path

    def files(self, name: str) -> tuple[Path, ...]:
        """Return the path of a file, or the sorted paths that match a name whose last part has a *.

        Whoever reads the files hashes them and notes their digests.
        """
        if "*" not in name:
            return (self._path(name),)
        folder = self.folder / Path(name).parent
        try:
            paths = sorted(path for path in folder.glob(Path(name).name) if is_there(path))
        except (OSError, ValueError):
            raise finding(
                f"file {shown(name)} is no name of a sequence; each * stands for any letters. "
                "Write one where names differ, as in wind_*.npz."
            ) from None
        if not paths:
            raise finding(f"no file matches {shown(name)} in {shown(folder)}. Correct the name.")
        return tuple(paths)


def missing_file(name: str, path: Path, kind: str = "file") -> str:
    """Return the message about a file that a shot file names and that is not there."""
    return (
        f"{kind} {shown(name)} is not there; it is looked for beside the shot file, as {shown(path)}. "
        "Put it there or correct the name."
    )


def finding(text: str) -> PydanticCustomError:
    """Return an error for pydantic with a whole message."""
    return PydanticCustomError("finding", "{text}", {"text": text})


def bad_value(text: str) -> PydanticCustomError:
    """Return an error for pydantic with a message that follows the value's path: `rate: …`."""
    return PydanticCustomError("bad_value", "{text}", {"text": text})


def bad_curve(text: str) -> PydanticCustomError:
    """Return an error for pydantic with a message that continues the value's path: `speed is …`."""
    return PydanticCustomError("bad_curve", "{text}", {"text": text})


def as_finding(make: Callable[[], T]) -> T:
    """Return what `make` returns; turn an error of ours into a finding."""
    try:
        return make()
    except FlowsculptError as error:
        raise finding(str(error)) from None


def validated(
    source: YamlSource,
    kind: type[D],
    problems: list[Problem],
    missing: list[Problem],
    failed: list[FlowsculptError] | None = None,
    context: Mapping[str, Any] | None = None,
) -> D:
    """Return the file as a document.

    problems  mistakes that checks have found
    missing   files that are named and not there
    failed    errors of other files

    Raises ShotError with all of them in the order of the file; MissingInputError if only files are missing.
    """
    wrong, document = [*source.problems, *problems], None
    try:
        document = kind.model_validate(source.data, context=dict(context or {}))
    except ValidationError as error:
        wrong += _problems_of(error, source, kind)
    reported = {where for where, _ in wrong}
    absent = [f"{source.place(where)}: {text}" for where, text in missing if where not in reported]
    others = failed or []
    absent += [str(error) for error in others if isinstance(error, MissingInputError)]
    lines = [
        f"{source.place(where)}: {text}"
        for where, text in sorted(wrong, key=lambda problem: source.order(problem[0]))
    ]
    lines += [line for error in others if isinstance(error, ShotError) for line in error.messages]
    if lines:
        raise ShotError(*dict.fromkeys([*lines, *absent]))
    if absent:
        raise MissingInputError("\n".join(absent))
    assert document is not None
    return document


def _problems_of(error: ValidationError, source: YamlSource, document: type[BaseModel]) -> list[Problem]:
    """Return every problem of a ValidationError: its path in the file and its message."""
    problems = []
    for details in error.errors(include_url=False):
        where = _in_file(source, details["loc"])
        message = _message(details, where, _models_at(document, details["loc"][:-1]))
        if details["type"] == "formula":
            column, message = details["ctx"]["column"], details["msg"]
            spot = source.spot(where, column)
            message = message if spot else f"column {column} of the formula: {message}"
            where = spot or where
        problems.append((where, message))
    return list(dict.fromkeys(problems))


def _in_file(source: YamlSource, loc: Where) -> Where:
    """Return a pydantic location without the tags of unions, which the file does not have."""
    where: Where = ()
    for step in loc:
        if (*where, step) in source.places:
            where = (*where, step)
    return where


def _models_at(document: type[BaseModel], loc: Where) -> list[type[BaseModel]]:
    """Return the models that the mapping at a location can be."""
    models = [document]
    for step in loc:
        inner = [m for model in models if step in model.model_fields for m in _models(model, step)]
        models = inner or models
    return models


def _unknown(name: Any, where: Where, models: list[type[BaseModel]]) -> str:
    """Return the message about a name that none of the models has."""
    names = sorted({field.alias or name for model in models for name, field in model.model_fields.items()})
    if (new := _RENAMED.get(name)) in names:
        return f"{name} is called {new} now{_under(where)}. Rename it."
    return f"{name} is not known{_under(where)}. {suggestion(name, names)}"


def _models(model: type[BaseModel], name: Any) -> list[type[BaseModel]]:
    """Return the documents in a field's annotation, through unions, lists and aliases."""
    waiting: list[Any] = [model.model_fields[name].annotation]
    models = []
    while waiting:
        kind = waiting.pop()
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            models.append(kind)
        else:
            waiting += typing.get_args(kind)
    return models


def _message(details: ErrorDetails, where: Where, models: list[type[BaseModel]]) -> str:
    kind, value, context = details["type"], details["input"], details.get("ctx", {})
    if kind == "finding":
        return str(context["text"])
    name = _dotted(where)
    if kind == "extra_forbidden":
        return _unknown(details["loc"][-1], where[:-1], models)
    if kind == "missing":
        missing = details["loc"][-1]
        return f"{missing} is missing{_under(where)}; it has no default. Add `{missing}: …`."
    if kind == "literal_error":
        return f"{name} is {value!r}; it must be {context['expected']}"
    if kind in ("greater_than", "greater_than_equal", "less_than", "less_than_equal"):
        bound = next(iter(context.values()))
        return f"{name} is {value}; it must be {_BOUNDS[kind]} {bound:g}"
    if kind in ("too_short", "too_long"):
        bound = context.get("min_length", context.get("max_length"))
        least = "at least" if kind == "too_short" else "at most"
        return f"{name} has {plural(context['actual_length'], 'item')}; it must have {least} {bound}"
    if kind in _EXPECTED:
        return f"{name} is {_shown(value)}; it must be {_EXPECTED[kind]}."
    if kind == "bad_curve":
        return f"{name} {details['msg']}"
    return f"{name}: {details['msg']}" if name else details["msg"]


def _under(where: Where) -> str:
    return f" under {_dotted(where)}" if where else ""


def _dotted(where: Where) -> str:
    return ".".join(str(step) for step in where)


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list):
        return "a list"
    return "empty" if value is None else shortened(value)
