"""Values and paths as messages show them, in the words of a shot file."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pipeline.errors import brief, shortened
from pipeline.shot.yaml.source import Where

MOST_CHARACTERS = 100
"""Longest value that a message writes out."""


def dotted(where: Where) -> str:
    """Return a path as `--set` has it: flows.0.vortex."""
    return ".".join(brief(step) for step in where)


def listed(names: Iterable[Any], last: str = "and") -> str:
    """Return names as a sentence lists them: a, b and c."""
    texts = [str(name) for name in names]
    return f" {last} ".join([", ".join(texts[:-1]), texts[-1]] if len(texts) > 1 else texts)


def in_yaml(value: Any) -> str:
    """Return a value as a shot file writes it in one line: `{axis: y, amount: 80}`; long ones are cut."""
    text = _written(value)
    if len(text) <= MOST_CHARACTERS:
        return text
    if isinstance(value, dict):
        names = "{" + ", ".join(f"{name}: …" for name in value) + "}"
        return names if len(names) <= 2 * MOST_CHARACTERS else f"{names[:MOST_CHARACTERS]}…}}"
    return f"{text[:MOST_CHARACTERS]}…"


def _written(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{name}: {_written(item)}" for name, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_written, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    return "" if value is None else str(value)


def shown(value: Any) -> str:
    """Return a value for a message: mappings and long lists by their kind, texts in quotes."""
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list):
        return "a list"
    if isinstance(value, bool):
        return str(value).lower()
    return "empty" if value is None else shortened(value)
