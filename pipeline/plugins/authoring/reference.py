"""What follows from the code and the plug-ins alone, kept in the user's cache until one of them changes."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

from flowsculpt.api import plugins
from flowsculpt.api.files import CachedAnswer

T = TypeVar("T")

Schema = dict[str, Any]


def kept(name: str, find: Callable[[], T]) -> T:
    """Return JSON-able data of a name as `find` returns them, or did when they were last needed.

    What is found while parts of plug-ins are left out is not kept: whoever asks again is warned again.
    """
    answer = CachedAnswer.of("reference", [plugins().code, *plugins().packages, name])
    known = answer.load(lambda found: found["data"])
    if known is None:
        known = json.loads(json.dumps(find()))
        if not plugins().left_out:
            answer.store_alone({"data": known})
    return known


def definition_name(reference: str) -> str:
    """Return the name of the definition that a `$ref` leads to."""
    return reference.removeprefix("#/$defs/")


def mappings(value: Any) -> Iterator[Schema]:
    """Yield all mappings in a schema, the outer ones first."""
    if isinstance(value, dict):
        yield value
        value = list(value.values())
    for inner in value if isinstance(value, list) else ():
        yield from mappings(inner)
