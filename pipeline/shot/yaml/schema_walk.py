"""The documents and types that can stand at a path of a file, by the annotations of pydantic models."""

from __future__ import annotations

import types
import typing
from collections.abc import Iterator
from functools import cache
from typing import Annotated, Any

from pydantic import BaseModel

from pipeline.shot.yaml.yaml_source import Where

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
