"""Values in drawings: lengths, and transforms in the notations of SVG and of CSS."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

from fontTools.misc.transform import Transform

from flowsculpt import UsageError
from flowsculpt.api import quote

LARGEST = 1e12
"""Largest number of units in a drawing."""

UNITS = {"": 1.0, "px": 1.0, "pt": 96 / 72, "pc": 16.0, "mm": 96 / 25.4, "cm": 96 / 2.54, "in": 96.0}
ANGLES = {"": 1.0, "deg": 1.0, "grad": 0.9, "turn": 360.0, "rad": 180.0 / math.pi}

PLACES = {"left": "0%", "top": "0%", "center": "50%", "right": "100%", "bottom": "100%"}
"""Keywords of `transform-origin`."""

TURNING = ("translate", "rotate", "scale")
"""Properties of CSS that come before `transform`, in this order."""

DECIMAL = r"[-+]?(?:\d++\.?\d*+|\.\d++)(?:[eE][-+]?\d++)?"
_LENGTH = re.compile(rf"\s*+({DECIMAL})\s*+([a-z%]*+)\s*+")
_ARGUMENT = re.compile(rf"[\s,]*+({DECIMAL})([a-z%]*+)[\s,]*+")
_FUNCTION = re.compile(r"[\s,]*+(\w++)\s*+\(([^()]*+)\)[\s,]*+")

Box = tuple[float, float, float, float]
"""Left, top, width and height."""


def length(text: str, name: str, whole: float | None = None) -> float:
    """Return a length in units of the drawing; `whole` is what 100% is.

    Raises UsageError for one in other units, or too large.
    """
    match = _LENGTH.fullmatch(text.lower())
    units = UNITS if whole is None else UNITS | {"%": 0.01 * whole}
    if match is None or match[2] not in units:
        raise UsageError(f"{name} has a length of {quote(text)}. Write a number, or one with px or mm.")
    value = float(match[1]) * units[match[2]]
    if not abs(value) <= LARGEST:
        raise UsageError(f"{name} has a length of {quote(text)}; the most is {LARGEST:g}. Scale it down.")
    return value


def matrix_of(properties: Mapping[str, str], name: str, box: Box | None, default: str) -> Transform:
    """Return the matrix of the properties that transform an element, about their origin.

    box      that percentages are of
    default  the origin where none is given

    Raises UsageError for what is not valid, and for percentages where the box is not known.
    """
    steps = [f"{key}({properties[key]})" for key in TURNING if properties.get(key, "none") != "none"]
    text = " ".join([*steps, properties.get("transform", "").replace("none", "")])
    inner = _product(text, name, box)
    given = properties.get("transform-origin", default)
    if inner == Transform() or given == "0 0":
        return inner
    x, y = _origin(given.split(), name, box)
    return Transform().translate(x, y).transform(inner).translate(-x, -y)


def _origin(words: Sequence[str], name: str, box: Box | None) -> tuple[float, float]:
    """Return the point of `right 5px`, or of `top`."""
    first, second = (*words, "center")[:2] if len(words) in (1, 2, 3) else ("", "")
    if first in ("top", "bottom") or second in ("left", "right"):
        first, second = second, first
    left, top, width, height = box or (0.0, 0.0, None, None)
    x = length(PLACES.get(first, first), name, width)
    return left + x, top + length(PLACES.get(second, second), name, height)


def _product(text: str, name: str, box: Box | None) -> Transform:
    """Return the matrix of `translate(10, 0) rotate(30)`."""
    matrix, at = Transform(), 0
    while at < len(text.rstrip()):
        match = _FUNCTION.match(text, at)
        values = _arguments(match[1], match[2], name, box) if match else None
        step = _step(match[1].lower(), values) if match and values is not None else None
        if match is None or step is None or not all(abs(value) <= LARGEST for value in step):
            fact = f"a transform {quote(text.strip())} that is not valid"
            raise UsageError(f"{name} has {fact}. Export the drawing again.")
        matrix, at = matrix.transform(step), match.end()
    return matrix


def _arguments(function: str, text: str, name: str, box: Box | None) -> list[float] | None:
    """Return the numbers in the brackets of a function: lengths in px, angles in degrees."""
    found: list[float] = []
    at, text = 0, text.strip().lower()
    while at < len(text):
        match = _ARGUMENT.match(text, at)
        if match is None:
            return None
        units, at = ANGLES if function.startswith(("rotate", "skew")) else {"": 1.0}, match.end()
        if function.startswith("translate"):
            whole = None if box is None else box[3 if function == "translatey" or found else 2]
            found.append(length(match[1] + match[2], name, whole))
        elif match[2] in units:
            found.append(float(match[1]) * units[match[2]])
        else:
            return None
    return found


def _step(function: str, values: list[float]) -> Transform | None:
    """Return the matrix of one function of a transform; None for one that is not valid."""
    plain, degree = Transform(), math.radians(1.0)
    match function, values:
        case "matrix", [_, _, _, _, _, _]:
            return Transform(*values)
        case "translate", [x, *rest] if len(rest) < 2:
            return plain.translate(x, *rest)
        case "translatex", [x]:
            return plain.translate(x, 0.0)
        case "translatey", [y]:
            return plain.translate(0.0, y)
        case "scale", [x, *rest] if len(rest) < 2:
            return plain.scale(x, *(rest or [x]))
        case "scalex", [x]:
            return plain.scale(x, 1.0)
        case "scaley", [y]:
            return plain.scale(1.0, y)
        case "rotate", [angle]:
            return plain.rotate(degree * angle)
        case "rotate", [angle, x, y]:
            return plain.translate(x, y).rotate(degree * angle).translate(-x, -y)
        case "skewx", [angle]:
            return plain.skew(degree * angle, 0.0)
        case "skewy", [angle]:
            return plain.skew(0.0, degree * angle)
        case "skew", [angle, *rest] if len(rest) < 2:
            return plain.skew(degree * angle, degree * rest[0] if rest else 0.0)
    return None
