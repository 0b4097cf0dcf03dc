"""Values and paths as text: as messages show them, and as a shot file has them in one line."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from typing import Any

from pipeline.errors import brief, shortened
from pipeline.shot.yaml.yaml_source import Where

MOST_CHARACTERS = 100
"""Longest value that a message writes out."""

_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_./-]*( [A-Za-z0-9_./+*-]+)*|\d+(\.\d+)?s")
_WORDS = ("true", "false", "null", "True", "False", "Null", "TRUE", "FALSE", "NULL")


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


def flow_style(value: Any, quote: str = '"') -> str:
    """Return plain data as one line that reads back as the same values, YAML's flow style: `{axis: y}`.

    quote  the quotation mark around a text that needs one, where the text allows it

    Numbers are written in the fewest digits that read back as the same double.
    """
    if isinstance(value, dict):
        return (
            "{" + ", ".join(f"{flow_style(name)}: {flow_style(item)}" for name, item in value.items()) + "}"
        )
    if isinstance(value, list):
        return "[" + ", ".join(map(flow_style, value)) + "]"
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return str(int(value))
    if isinstance(value, int | float):
        return repr(value)
    text = str(value)
    if quote == "'" and "'" not in text and text.isprintable():
        return f"'{text}'"
    return text if _PLAIN.fullmatch(text) and text not in _WORDS else json.dumps(text, ensure_ascii=False)
