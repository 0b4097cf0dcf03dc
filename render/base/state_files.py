"""Read back what we keep between runs, mostly JSON: what was measured, planned, noted or answered.

Such a file may be half-written, damaged, of another program or of a later version. Nothing in it is worth an
error: what cannot be used counts as none, and is found or written again.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from flowsculpt.render.base.render_errors import FlowsculptError

T = TypeVar("T")

UNUSABLE = (OSError, ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError)
"""Errors of files that cannot be read, and of content that is not what a reader of it expects."""

MOST_DIGITS = 300
"""Digits of the largest whole number that is taken: more exceed a float."""


def read_state(path: Path, reader: Callable[[Any], T]) -> T | None:
    """Return what `reader` makes of the JSON in a file; None where there is none that it can use.

    reader  takes plain data; it converts all that is used later, and raises one of UNUSABLE or a
            FlowsculptError for what it cannot use
    """
    return usable(lambda: reader(plain_data(path.read_bytes())))


def usable(read: Callable[[], T]) -> T | None:
    """Return what `read` returns; None where it raises one of UNUSABLE or a FlowsculptError."""
    try:
        return read()
    except (*UNUSABLE, FlowsculptError):
        return None


def plain_data(text: str | bytes) -> Any:
    """Return the plain data of JSON, with finite numbers. Raises ValueError or RecursionError."""
    return _DECODER.decode(text.decode("utf-8") if isinstance(text, bytes) else text)


def mapping(data: Any) -> dict[str, Any]:
    """Return a JSON object. Raises TypeError for other data."""
    if not isinstance(data, dict):
        raise TypeError("not a JSON object")
    return data


def _whole(digits: str) -> int:
    if len(digits) > MOST_DIGITS:
        raise ValueError("a number is too large")
    return int(digits)


def _finite(digits: str) -> float:
    number = float(digits)
    if not math.isfinite(number):
        raise ValueError("a number is not finite")
    return number


_DECODER = json.JSONDecoder(parse_int=_whole, parse_float=_finite, parse_constant=_finite)
