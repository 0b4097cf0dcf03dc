"""Turn settings into plain values and back: what is hashed into keys, written to headers and sent to jobs.

`to_plain` turns a frozen dataclass into dicts, lists, numbers and strings that JSON can hold; `from_plain`
builds it again from its class and those values. Neither needs a word in the class itself.
"""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, TypeVar

from render.base.errors import BadInputError

T = TypeVar("T")

Triple = tuple[float, float, float]
"""A point or a direction."""

Colour = Annotated[Triple, "linear Rec.709"]
"""A reflectance or radiance, which `render.scene.working_space` converts to the space of a frame."""

NOT_PLAIN = {"plain": False}
"""`field(metadata=NOT_PLAIN)`: a field to leave out, such as where a file of known content lies, or a cache.
It needs a default."""


def to_plain(value: Any) -> Any:
    """Return a value that `json.dumps` takes and `from_plain` turns back.

    A dataclass becomes a dict by field name, without its NOT_PLAIN fields; a mapping, a dict whose keys are
    strings; a tuple, a list; a path, a string. Anything else is returned unchanged.
    """
    if isinstance(value, str | int | float):
        return value
    kind: Any = type(value)
    if _is_record(kind):
        return {name: to_plain(getattr(value, name)) for name in _plain_names(kind)}
    if isinstance(value, list | tuple):
        return [to_plain(item) for item in value]
    if isinstance(value, Mapping):
        return {str(key): to_plain(item) for key, item in value.items()}
    return str(value) if isinstance(value, Path) else value


def from_plain(kind: type[T], values: Any) -> T:
    """Return the dataclass `kind` from what `to_plain` made of one. Fields left out take their defaults.

    The annotations of fields decide: dataclasses, tuples, lists and mappings of any depth, `X | None`, paths,
    mappings by int and floats are built again; values of other types are taken as they are. `kind` may be a
    union of dataclasses that differ in the default of a field with init=False.

    Raises BadInputError for a field that `kind` does not have, one that it needs and is missing, or a value
    of another shape; the message names the field.
    """
    return typing.cast(T, _build(kind, values, getattr(kind, "__name__", str(kind))))


@cache
def _is_record(kind: Any) -> bool:
    return isinstance(kind, type) and dataclasses.is_dataclass(kind)


@cache
def _plain_names(kind: type) -> list[str]:
    return [field.name for field in dataclasses.fields(kind) if field.metadata.get("plain", True)]


@cache
def _is_taken_unchanged(kind: Any) -> bool:
    return typing.get_origin(kind) is None and not _is_record(kind) and kind not in (float, Path)


def _build(kind: Any, values: Any, place: str) -> Any:
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin in (types.UnionType, typing.Union):
        return None if values is None else _build(_member(arguments, values), values, place)
    try:
        if _is_record(kind):
            return _build_dataclass(kind, values, place)
        if origin is tuple and arguments[-1] is not Ellipsis:
            if len(values) != len(arguments):
                raise BadInputError(f"{place} has {len(values)} values; it needs {len(arguments)}")
            parts = zip(arguments, values, strict=True)
            return tuple(_build(part, item, f"{place}[{i}]") for i, (part, item) in enumerate(parts))
        if origin in (tuple, list):
            if _is_taken_unchanged(arguments[0]):
                return origin(values)
            return origin(_build(arguments[0], item, f"{place}[{i}]") for i, item in enumerate(values))
        if isinstance(origin, type) and issubclass(origin, Mapping):
            key_kind = int if arguments[0] is int else str
            items = values.items()
            if _is_taken_unchanged(arguments[1]):
                return {key_kind(key): item for key, item in items}
            return {key_kind(key): _build(arguments[1], item, f"{place}.{key}") for key, item in items}
        return kind(values) if kind in (float, Path) else values
    except (TypeError, ValueError, AttributeError) as error:
        raise BadInputError(f"{place}: {error}") from None


def _member(kinds: tuple[Any, ...], values: Any) -> Any:
    """Return the first of a union's types, or the dataclass whose fixed fields (init=False) `values` has."""
    for kind in kinds:
        fixed = [field for field in dataclasses.fields(kind) if not field.init] if _is_record(kind) else []
        if fixed and all(values.get(field.name) == field.default for field in fixed):
            return kind
    return kinds[0]


@cache
def _hints_of(kind: type) -> dict[str, Any]:
    return typing.get_type_hints(kind)


def _build_dataclass(kind: Any, values: Any, place: str) -> Any:
    if isinstance(values, kind):
        return values
    hints = _hints_of(kind)
    fixed = {field.name for field in dataclasses.fields(kind) if not field.init}
    names = [field.name for field in dataclasses.fields(kind) if field.name not in fixed]
    unknown = [name for name in values if name not in fixed and name not in names]
    if unknown:
        raise BadInputError(f"{place} has no {unknown[0]!r}; it has {', '.join(names)}")
    given = {name: values[name] for name in names if name in values}
    return kind(**{name: _build(hints[name], item, f"{place}.{name}") for name, item in given.items()})
