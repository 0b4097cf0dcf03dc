"""Values as one line of YAML that reads back as the same values."""

from __future__ import annotations

import json
import re
from typing import Any

_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_./-]*( [A-Za-z0-9_./+*-]+)*|\d+(\.\d+)?s")
_WORDS = ("true", "false", "null", "True", "False", "Null", "TRUE", "FALSE", "NULL")


def flow_style(value: Any, quote: str = '"') -> str:
    """Return a value of plain data in YAML's flow style: `{axis: y, amount: [1, 2.5]}`.

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
