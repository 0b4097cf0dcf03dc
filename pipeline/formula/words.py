"""The vocabulary of formulas: constants, names, functions and operators."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

CONSTANTS = {"pi": np.pi, "e": np.e}

PLACE = ("x", "y", "z")
"""The names of a position: scene units."""

TIME = ("t", "time", "frame")
"""The names of a time: seconds since the first frame, short and long, and the frame number, with a fraction
between frames."""

MEANT = {"seconds": "t", "sec": "t", "f": "frame"}
"""Words that users write for names they do not resemble."""


def time_values(frame: Any, seconds: Any) -> dict[str, Any]:
    """Return the values of the names in TIME."""
    return {"t": seconds, "time": seconds, "frame": frame}


def _smoothstep(low: Any, high: Any, x: Any) -> Any:
    """Return 0 below low, 1 above high, and a cubic with level ends between."""
    share = np.clip((x - low) / (high - low), 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


FUNCTIONS: Mapping[str, tuple[Callable[..., Any], int]] = {
    "sin": (np.sin, 1),
    "cos": (np.cos, 1),
    "tan": (np.tan, 1),
    "asin": (np.arcsin, 1),
    "acos": (np.arccos, 1),
    "atan": (np.arctan, 1),
    "atan2": (np.arctan2, 2),
    "sqrt": (np.sqrt, 1),
    "exp": (np.exp, 1),
    "log": (np.log, 1),
    "abs": (np.abs, 1),
    "min": (np.minimum, 2),
    "max": (np.maximum, 2),
    "floor": (np.floor, 1),
    "ceil": (np.ceil, 1),
    "clamp": (lambda x, low, high: np.minimum(np.maximum(x, low), high), 3),
    "smoothstep": (_smoothstep, 3),
}
"""By name, with the number of arguments (min and max take two or more). Angles are radians."""

OPERATORS: Mapping[type[ast.AST], Callable[..., Any]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Mod: np.mod,
    ast.Pow: np.power,
    ast.UAdd: np.positive,
    ast.USub: np.negative,
    ast.Not: np.logical_not,
    ast.And: np.logical_and,
    ast.Or: np.logical_or,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
"""By node of the syntax tree."""
