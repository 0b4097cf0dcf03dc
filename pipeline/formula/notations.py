"""Notations of other languages in formulas, and the ones that stand for them here."""

from __future__ import annotations

import re

MEANT = {"seconds": "t", "sec": "t", "f": "frame", "Time": "t", "Frame": "frame", "PI": "pi", "tau": "2 * pi"}
"""Words that users write for names they do not resemble."""

_VARIABLES = {
    "$F": "frame",
    "$FF": "frame",
    "$T": "t",
    "@Frame": "frame",
    "@frame": "frame",
    "@Time": "t",
    "@time": "t",
    "@P.x": "x",
    "@P.y": "y",
    "@P.z": "z",
}
"""Variables of other programs."""

WRITTEN_AS = {
    "pow": "Write a ** b.",
    "mod": "Write a % b.",
    "fmod": "Write a % b.",
    "lerp": "Write a + (b - a) * w.",
    "mix": "Write a + (b - a) * w.",
    "round": "Write floor(x + 0.5).",
    "sign": "Write 1 if x > 0 else -1.",
    "where": "Write a if condition else b.",
    "radians": "Write x * pi / 180.",
    "fit": "Write c + (d - c) * clamp((x - a) / (b - a), 0, 1).",
    "ch": "Write the number, or name it under with: {amp: 2}.",
    "noise": "The flow curl_noise is noise; formulas have none.",
    "rand": "Formulas have no chance. The flow curl_noise has a seed.",
    "random": "Formulas have no chance. The flow curl_noise has a seed.",
}
"""Functions of other languages, and what to write."""

_OPERATORS = {
    "?": "a choice is written a if condition else b.",
    "&&": "&& is written and.",
    "||": "|| is written or.",
    "!": "! is written not.",
    ";": "a formula ends without ;. Remove it.",
    "°": "angles in formulas are radians. Write * pi / 180.",
}

_WORDS = {"and", "or", "not", "if", "else"}

_PRODUCT = re.compile(
    r"(?<![\w.])(\d+(?:\.\d*)?)\s*((?!e[-+]?\d)[A-Za-z_]\w*|\()|([A-Za-z_]\w*)\s+([A-Za-z_]\w*)"
)
"""A number or name with another one after it, and no operator between."""

Fault = tuple[int, str]
"""A column, from 1, and the message."""


def syntax_fault(line: str) -> Fault | None:
    """Return the mistake that keeps a formula from being parsed, if it is one that people often make."""
    for find in (_variable, _operator, _bracket, _product, _equals):
        if (fault := find(line)) is not None:
            return fault
    return None


def _variable(line: str) -> Fault | None:
    match = re.search(r"[$@]\w+(?:\.\w+)?", line)
    if not match:
        return None
    meant = _VARIABLES.get(match[0])
    remedy = f"Write {meant}." if meant else "Names have no $ or @ here."
    return match.start() + 1, f"{match[0]} is not known here. {remedy}"


def _operator(line: str) -> Fault | None:
    for mark, message in _OPERATORS.items():
        column = line.find(mark)
        if column >= 0 and line[column : column + 2] != "!=":
            return column + 1, message
    return None


def _bracket(line: str) -> Fault | None:
    opened: list[int] = []
    for column, character in enumerate(line, 1):
        if character == "(":
            opened.append(column)
        elif character == ")":
            if not opened:
                return column, "this ) closes nothing. Remove it."
            opened.pop()
    return (opened[-1], "this ( is never closed. Add ).") if opened else None


def _product(line: str) -> Fault | None:
    for match in _PRODUCT.finditer(line):
        left, right = match[1] or match[3], match[2] or match[4]
        if not {left, right} & _WORDS:
            return match.start(2 if match[2] else 4) + 1, f"an operator is missing. Write {left} * {right}."
    return None


def _equals(line: str) -> Fault | None:
    match = re.search(r"(?<![=<>!])=(?!=)", line)
    return (
        (match.start() + 1, "= sets nothing here. Write ==, or only what stands after it.") if match else None
    )
