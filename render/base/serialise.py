"""Turn settings into plain values and back: what is hashed into keys, written to headers and sent to jobs.

`to_plain` turns a frozen dataclass into dicts, lists, numbers and strings that JSON can hold; `from_plain`
builds it again from its class and those values. Neither needs a word in the class itself.
"""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any, TypeVar

from flowsculpt.render.base.render_errors import BadInputError

T = TypeVar("T")

Triple = tuple[float, float, float]
"""A point or a direction."""

Colour = Annotated[Triple, "linear Rec.709"]
"""A reflectance or radiance, which `flowsculpt.render.scene.rgb_spaces` converts to the space of a frame."""

NOT_PLAIN = {"plain": False}
"""`field(metadata=NOT_PLAIN)`: a field to leave out, such as where a file of known content lies, or a cache.
It needs a default."""

OMIT_DEFAULT = {"omit_default": True}
"""`field(metadata=OMIT_DEFAULT)`: a field to leave out at its default, so that keys stay what they were
before there was such a field."""


def named_by_kind(class_of: Callable[[str], type | None]) -> dict[str, Any]:
    """Return the metadata of a field that holds a dataclass of one of several kinds, by default none of them.

    In plain values it has the name of its class's `kind` in place of the field's, or is left out if that is
    empty. `class_of` returns the class of a kind, None for what is not a kind.
    """
    return {"class_of": class_of}


_LEAVES = frozenset({str, int, float, bool, type(None)})
"""Types that JSON holds as they are: most of what is turned into plain values."""


def to_plain(value: Any) -> Any:
    """Return a value that `json.dumps` takes and `from_plain` turns back.

    A dataclass becomes a dict by field name, without its NOT_PLAIN fields, and OMIT_DEFAULT fields at their
    default; a mapping, a dict whose keys are strings; a tuple, a list; a path, a string. Anything else is
    returned unchanged.
    """
    kind: Any = type(value)
    if kind in _LEAVES:
        return value
    if _is_record(kind):
        names, optional, by_kind = _plain_names(kind)
        set_names = [name for name, default in optional if getattr(value, name) != default]
        plain = {name: to_plain(getattr(value, name)) for name in (*names, *set_names)}
        held = [getattr(value, name) for name in by_kind]
        return plain | {each.kind: to_plain(each) for each in held if each.kind}
    if isinstance(value, list | tuple):
        return [item if type(item) in _LEAVES else to_plain(item) for item in value]
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
    build: Builder = _builder(typing.cast(Any, kind))
    try:
        return typing.cast(T, build(values))
    except _REFUSALS as error:
        misfit = _misfit(getattr(kind, "__name__", str(kind)), error)
    raise BadInputError(f"{misfit.place}{misfit.fact}")


@cache
def _is_record(kind: Any) -> bool:
    return isinstance(kind, type) and dataclasses.is_dataclass(kind)


@cache
def _plain_names(kind: type) -> tuple[list[str], list[tuple[str, Any]], list[str]]:
    """Return the fields that are always plain, those that are if they differ from a default, and those that
    `named_by_kind` describes."""
    plain = [field for field in dataclasses.fields(kind) if field.metadata.get("plain", True)]
    by_kind = [field.name for field in plain if "class_of" in field.metadata]
    optional = [(field.name, field.default) for field in plain if field.metadata.get("omit_default")]
    conditional = {*by_kind, *(name for name, _ in optional)}
    return [field.name for field in plain if field.name not in conditional], optional, by_kind


class _MisfitError(ValueError):
    """Raised for plain values that do not fit a type.

    fact   what does not fit
    place  the path to them, such as `.clips[0].path`; it grows while the error passes through containers
    """

    def __init__(self, fact: str) -> None:
        self.fact, self.place = fact, ""


_REFUSALS = (TypeError, ValueError, AttributeError)
"""Errors that values of another shape raise, by Python or by a builder."""


def _misfit(part: str, error: Exception) -> _MisfitError:
    """Return the error of the container in which values that raised `error` have the place `part`."""
    misfit = error if isinstance(error, _MisfitError) else _MisfitError(f": {error}")
    misfit.place = part + misfit.place
    return misfit


Builder = Callable[[Any], Any]
"""Builds a value of one type from plain values. Raises one of _REFUSALS."""


def _unchanged(value: Any) -> Any:
    """Return a value as it is: the builder of types that plain values have."""
    return value


@cache
def _builder(kind: Any) -> Builder:
    """Return the builder of a type. Made once: planning builds a value a frame, and annotations are slow."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin in (types.UnionType, typing.Union):
        return _union_builder(arguments)
    if _is_record(kind):
        return _record_builder(kind)
    if origin is tuple and arguments[-1] is not Ellipsis:
        return _fixed_tuple_builder(arguments)
    if origin in (tuple, list):
        return _sequence_builder(origin, arguments[0])
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return _mapping_builder(int if arguments[0] is int else str, arguments[1])
    is_numbers = isinstance(kind, type) and issubclass(kind, tuple) and not hasattr(kind, "_fields")
    return kind if is_numbers or kind in (float, Path) else _unchanged


def _union_builder(kinds: tuple[Any, ...]) -> Builder:
    """Build the first of the types, or the dataclass whose fixed fields (init=False) the values have."""
    fixed = {kind: _fixed_fields(kind) for kind in kinds if _is_record(kind) and _fixed_fields(kind)}

    def build(values: Any) -> Any:
        if values is None:
            return None
        for kind, defaults in fixed.items():
            if all(values.get(name) == default for name, default in defaults.items()):
                return _builder(kind)(values)
        return _builder(kinds[0])(values)

    return build


def _fixed_fields(kind: Any) -> dict[str, Any]:
    return {field.name: field.default for field in dataclasses.fields(kind) if not field.init}


def _fixed_tuple_builder(kinds: tuple[Any, ...]) -> Builder:
    builders = [_builder(kind) for kind in kinds]

    def build(values: Any) -> tuple[Any, ...]:
        if len(values) != len(builders):
            raise _MisfitError(f" has {len(values)} values; it needs {len(builders)}")
        return tuple(_items(builders, values))

    return build


def _sequence_builder(sequence: Callable[[Any], Any], kind: Any) -> Builder:
    item = _builder(kind)
    if item is _unchanged:
        return sequence
    return lambda values: sequence(_items([item] * len(values), values))


def _items(builders: Sequence[Builder], values: Any) -> list[Any]:
    """Build the items of a sequence, each by its own builder."""
    items: list[Any] = []
    for build, value in zip(builders, values, strict=True):
        try:
            items.append(build(value))
        except _REFUSALS as error:
            raise _misfit(f"[{len(items)}]", error) from None
    return items


def _mapping_builder(key: Builder, kind: Any) -> Builder:
    item = _builder(kind)
    if item is _unchanged:
        return lambda values: {key(name): value for name, value in values.items()}
    return lambda values: {key(name): _field(item, name, value) for name, value in values.items()}


def _field(build: Builder, name: Any, value: Any) -> Any:
    """Build what has a name in a mapping or a dataclass."""
    try:
        return build(value)
    except _REFUSALS as error:
        raise _misfit(f".{name}", error) from None


def _record_builder(kind: Any) -> Builder:
    fixed = _fixed_fields(kind)

    def build(values: Any) -> Any:
        if isinstance(values, kind):
            return values
        builders, given = _field_builders(kind), {}
        for name, value in values.items():
            if name in builders:
                given[name] = _field(builders[name], name, value)
            elif name not in fixed:
                given |= _held_by_kind(kind, name, value)
        return kind(**given)

    return build


def _held_by_kind(kind: Any, name: str, value: Any) -> dict[str, Any]:
    """Return the field, see `named_by_kind`, that holds a value of the kind `name`; none for None.

    Raises _MisfitError for what is not a kind.
    """
    for field in filter(lambda field: "class_of" in field.metadata, dataclasses.fields(kind)):
        if value is None:
            return {}
        if (held := field.metadata["class_of"](name)) is not None:
            return {field.name: _field(_builder(held), name, value)}
    raise _MisfitError(f" has no {name!r}; it has {', '.join(_field_builders(kind))}")


@cache
def _field_builders(kind: Any) -> dict[str, Builder]:
    """Return the builders of the fields of a dataclass; made late, since a field may hold the same type."""
    hints = typing.get_type_hints(kind)
    return {field.name: _builder(hints[field.name]) for field in dataclasses.fields(kind) if field.init}
