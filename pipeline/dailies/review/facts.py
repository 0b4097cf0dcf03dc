"""What headers say, as a page has it: once where all frames say the same, and else by frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

_NOT_TOLD = frozenset({"frame"})
"""The page knows it."""


def tabled(headers: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """`same`: entries that are equal in all headers; `differ`: of the others, one value for each header."""
    flat = [dict(_flat("", header)) for header in headers]
    names = sorted({name for each in flat for name in each} - _NOT_TOLD)
    columns = {name: [each.get(name) for each in flat] for name in names}
    return {
        "same": {name: values[0] for name, values in columns.items() if _are_equal(values)},
        "differ": {name: values for name, values in columns.items() if not _are_equal(values)},
    }


def _are_equal(values: Sequence[Any]) -> bool:
    return all(value == values[0] for value in values)


def _flat(place: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Entries by dotted names; triples of numbers and short lists stay together, and numbers are rounded."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _flat(f"{place}.{name}" if place else str(name), inner)
    elif isinstance(value, list) and any(isinstance(inner, Mapping | list) for inner in value):
        for index, inner in enumerate(value):
            name = inner.get("name") if isinstance(inner, Mapping) else None
            yield from _flat(f"{place}.{name or index}", inner)
    else:
        yield place, _rounded(value)


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.6g}")
    return [_rounded(inner) for inner in value] if isinstance(value, list) else value
