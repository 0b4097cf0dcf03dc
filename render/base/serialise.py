"""Pictures' settings as plain values and back: what is hashed into keys and written into headers.

`to_plain` turns a frozen dataclass into dicts, lists, numbers and strings that JSON can hold; `from_plain`
builds it again from the class and those values, so that nothing about a picture lives outside of them.
"""

from __future__ import annotations

import dataclasses
import types
import typing
from functools import cache
from typing import Any, TypeVar

from render.base.errors import BadInputError

T = TypeVar("T")

Triple = tuple[float, float, float]
"""A point, a direction or a linear Rec.709 colour."""

NOT_PLAIN = {"plain": False}
"""`field(metadata=NOT_PLAIN)`: something that decides nothing, such as where a file of known content lies."""


def to_plain(value: Any) -> Any:
    """Dataclasses as dicts by field name, tuples as lists; anything else unchanged."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = [field for field in dataclasses.fields(value) if field.metadata.get("plain", True)]
        return {field.name: to_plain(getattr(value, field.name)) for field in fields}
    if isinstance(value, list | tuple):
        return [to_plain(item) for item in value]
    if isinstance(value, dict):
        return {str(key): to_plain(item) for key, item in value.items()}
    return value


def from_plain(kind: type[T], values: Any) -> T:
    """The dataclass `kind` from what `to_plain` made of it. Fields left out take their defaults.

    Raises BadInputError for a field that `kind` does not have, or one that it needs and is missing.
    """
    return typing.cast(T, _build(kind, values, kind.__name__))


def _build(kind: Any, values: Any, place: str) -> Any:
    origin = typing.get_origin(kind)
    if dataclasses.is_dataclass(kind):
        return _build_dataclass(kind, values, place)
    if origin in (types.UnionType, typing.Union):
        return None if values is None else _build(typing.get_args(kind)[0], values, place)
    if origin is tuple:
        item, *rest = typing.get_args(kind)
        if rest != [Ellipsis] and len(values) != 1 + len(rest):
            raise BadInputError(f"{place} has {len(values)} values; it needs {1 + len(rest)}")
        return tuple(_build(item, each, f"{place}[{index}]") for index, each in enumerate(values))
    return float(values) if kind is float else values


@cache
def _hints_of(kind: type) -> dict[str, Any]:
    return typing.get_type_hints(kind)


def _build_dataclass(kind: Any, values: Any, place: str) -> Any:
    if isinstance(values, kind):
        return values
    hints = _hints_of(kind)
    names = [field.name for field in dataclasses.fields(kind)]
    strangers = [name for name in values if name not in names]
    if strangers:
        raise BadInputError(f"{place} has no {strangers[0]!r}; it has {', '.join(names)}")
    try:
        return kind(**{name: _build(hints[name], item, f"{place}.{name}") for name, item in values.items()})
    except TypeError as error:
        raise BadInputError(f"{place}: {error}") from None
