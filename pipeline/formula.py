"""Formulas as artists write them: `0.02 + 0.01 * abs(y)`, checked word by word, evaluated by numpy.

Nothing in a formula can reach beyond it: its syntax tree may hold numbers, the names that the caller gives,
arithmetic, comparisons, `and`, `or`, `not`, `a if b else c`, and the functions listed here. Anything else is
refused when the formula is read.
"""

from __future__ import annotations

import ast
import operator
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from pipeline.errors import UsageError, suggestion

MOST_CHARACTERS, MOST_PARTS, DEEPEST = 1000, 300, 40
"""Beyond what anybody writes by hand, and far below what could exhaust a machine."""

LARGEST_EXPONENT = 64

CONSTANTS = {"pi": np.pi, "e": np.e}


def _smoothstep(low: Any, high: Any, x: Any) -> Any:
    """0 below low, 1 above high, a cubic with level ends between."""
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

_OPERATORS: Mapping[type[ast.AST], Callable[..., Any]] = {
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


class FormulaError(UsageError):
    """What cannot stand in a formula, and where: `column` counts its characters from 1."""

    def __init__(self, text: str, column: int, message: str) -> None:
        super().__init__(f"formula {_shown(text)!r}, column {column}: {message}")
        self.column = column
        self.message = message


@dataclass(frozen=True)
class Expression:
    """A formula over named values; true is 1 and false 0.

    text   what is written
    names  the values it may speak of, such as ("x", "y", "z", "time")

    Raises FormulaError, with the column, for anything that is no number, name, operator or function of ours.
    """

    text: str
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "_tree", _checked(self.text, self.names))

    @property
    def uses(self) -> frozenset[str]:
        """The names that it speaks of."""
        inner = ast.walk(self._syntax)
        return frozenset(n.id for n in inner if isinstance(n, ast.Name)) & frozenset(self.names)

    def __call__(self, **values: ArrayLike) -> Floats:
        """The formula's value, one for each row of the values, which are numbers or arrays of one length.

        Raises UsageError where a value is not finite, with the first place where that is so.
        """
        known = {name: np.asarray(values[name], np.float64) for name in self.uses}
        with np.errstate(all="ignore"):  # what is not finite is told below, where it comes out
            found = np.asarray(_value(self._syntax, {**CONSTANTS, **known}), np.float64)
        everything = np.broadcast_shapes(found.shape, *(np.shape(value) for value in values.values()))
        result = np.array(np.broadcast_to(found, everything))
        bad = np.flatnonzero(~np.isfinite(result))
        if bad.size:
            raise UsageError(self._not_finite(result, int(bad[0]), values))
        return result

    @property
    def _syntax(self) -> ast.expr:
        tree: ast.expr = self._tree  # type: ignore[attr-defined]
        return tree

    def _not_finite(self, result: Floats, row: int, values: Mapping[str, ArrayLike]) -> str:
        rows = {name: np.broadcast_to(value, result.shape).ravel()[row] for name, value in values.items()}
        place = ", ".join(f"{name} {float(rows[name]):g}" for name in self.names if name in rows)
        return (
            f"formula {_shown(self.text)!r} is {result.ravel()[row]:g} at {place}; "
            "it must be finite everywhere. Guard it with max, clamp or `… if … else …`."
        )


def _value(node: ast.expr, known: Mapping[str, Any]) -> Any:
    """The value of a checked tree. Both sides of a condition are evaluated, and one is taken at each row."""
    match node:
        case ast.Constant():
            return np.float64(node.value)  # type: ignore[arg-type]
        case ast.Name():
            return known[node.id]
        case ast.UnaryOp():
            return _number(_OPERATORS[type(node.op)](_value(node.operand, known)))
        case ast.BinOp():
            return _OPERATORS[type(node.op)](_value(node.left, known), _value(node.right, known))
        case ast.BoolOp():
            return _number(_folded(_OPERATORS[type(node.op)], [_value(part, known) for part in node.values]))
        case ast.Compare():
            sides = [_value(side, known) for side in (node.left, *node.comparators)]
            pairs = zip(node.ops, sides, sides[1:], strict=False)
            return _number(_folded(np.logical_and, [_OPERATORS[type(op)](a, b) for op, a, b in pairs]))
        case ast.IfExp():
            return np.where(*(_value(part, known) for part in (node.test, node.body, node.orelse)))
        case ast.Call(func=ast.Name(id=name)):
            function, arguments = FUNCTIONS[name][0], [_value(part, known) for part in node.args]
            return _folded(function, arguments) if name in ("min", "max") else function(*arguments)
    raise AssertionError(f"{ast.dump(node)} was checked and is known")


def _number(value: Any) -> Any:
    """What is true as 1 and what is false as 0, so that it can be computed with."""
    return np.asarray(value, np.float64)


def _folded(function: Callable[..., Any], values: list[Any]) -> Any:
    first, *others = values
    for value in others:
        first = function(first, value)
    return first


def _checked(text: str, names: tuple[str, ...]) -> ast.expr:
    """The syntax tree of a formula in which everything is allowed."""
    if len(text) > MOST_CHARACTERS:
        raise FormulaError(
            text, MOST_CHARACTERS, f"it is too long; {MOST_CHARACTERS} characters are the most"
        )
    line = "".join(" " if c.isspace() else c for c in text)
    indent = len(line) - len(line.lstrip())
    if not line.strip():
        raise FormulaError(text, 1, "it is empty. Write a number or a formula over " + ", ".join(names))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the parser's own advice on what is refused in any case
            tree = ast.parse(line.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        column = indent + (getattr(error, "offset", None) or len(line.strip()) + 1)
        raise FormulaError(
            text, min(column, len(text) + 1), "this is no arithmetic. Look for a missing operator or bracket."
        ) from None
    _Check(text, line.strip().encode(), indent, names).everything(tree)
    return tree


class _Check:
    """Walks a syntax tree and stops at the first thing that is not allowed."""

    def __init__(self, text: str, line: bytes, indent: int, names: tuple[str, ...]) -> None:
        self.text, self.line, self.indent, self.names = text, line, indent, names
        self.parts = 0

    def everything(self, node: ast.expr, depth: int = 0) -> None:
        self.parts += 1
        if self.parts > MOST_PARTS or depth > DEEPEST:
            raise self.error(
                node, f"it is too involved; {MOST_PARTS} parts, nested {DEEPEST} deep, are the most"
            )
        for inner in self.inner(node):
            self.everything(inner, depth + 1)

    def inner(self, node: ast.expr) -> list[ast.expr]:
        """The parts of a node, which itself is allowed."""
        match node:
            case ast.Constant():
                self.number(node)
                return []
            case ast.Name():
                self.name(node)
                return []
            case ast.UnaryOp() if type(node.op) in _OPERATORS:
                return [node.operand]
            case ast.BinOp() if type(node.op) in _OPERATORS:
                self.exponent(node)
                return [node.left, node.right]
            case ast.BoolOp():
                return node.values
            case ast.Compare() if all(type(op) in _OPERATORS for op in node.ops):
                return [node.left, *node.comparators]
            case ast.IfExp():
                return [node.test, node.body, node.orelse]
            case ast.Call():
                self.call(node)
                return node.args
        raise self.error(node, _refusal(node))

    def number(self, node: ast.Constant) -> None:
        if isinstance(node.value, bool) or not isinstance(node.value, int | float):
            raise self.error(
                node, f"{_shown(repr(node.value))} is no number; write one plainly, such as 0.05"
            )
        if not abs(node.value) <= 1e100:
            raise self.error(node, "this number is too large; 1e100 is the largest")

    def name(self, node: ast.Name) -> None:
        if node.id in FUNCTIONS:
            raise self.error(node, f"{node.id} is a function; write {node.id}(…)")
        if node.id not in self.names and node.id not in CONSTANTS:
            words = (*self.names, *CONSTANTS, *FUNCTIONS)
            raise self.error(node, f"{_shown(node.id)} is not known here. {suggestion(node.id, words)}")

    def exponent(self, node: ast.BinOp) -> None:
        power = node.right.operand if isinstance(node.right, ast.UnaryOp) else node.right
        if not isinstance(node.op, ast.Pow) or not isinstance(power, ast.Constant):
            return
        if isinstance(power.value, int | float) and abs(power.value) > LARGEST_EXPONENT:
            raise self.error(power, f"the exponent is too large; {LARGEST_EXPONENT} is the largest")

    def call(self, node: ast.Call) -> None:
        if not isinstance(node.func, ast.Name):
            raise self.error(node.func, "only functions by their name can be called, such as sin(x)")
        name = node.func.id
        if name not in FUNCTIONS:
            raise self.error(node.func, f"{_shown(name)} is no function here. {suggestion(name, FUNCTIONS)}")
        wanted, given = FUNCTIONS[name][1], len(node.args)
        if node.keywords or any(isinstance(part, ast.Starred) for part in node.args):
            raise self.error(node, f"{name} takes plain arguments, one after another")
        if given < wanted or (given > wanted and name not in ("min", "max")):
            more = " or more" if name in ("min", "max") else ""
            plural = "s" if wanted > 1 or more else ""
            raise self.error(node, f"{name} takes {wanted}{more} argument{plural}, not {given}")

    def error(self, node: ast.expr, message: str) -> FormulaError:
        before = self.line[: node.col_offset].decode(errors="ignore")
        return FormulaError(self.text, self.indent + len(before) + 1, message)


def _refusal(node: ast.expr) -> str:
    match node:
        case ast.BinOp(op=ast.FloorDiv()):
            return "// is not known here. Write floor(a / b)."
        case ast.BinOp(op=ast.BitXor()):
            return "^ is not known here. A power is written x ** 2."
        case ast.Attribute():
            return "a point cannot stand here. Names have no parts."
        case ast.UnaryOp() | ast.BinOp() | ast.Compare():
            return "this operator is not known here. There are: + - * / ** % < <= > >= == != and or not."
    return "this cannot stand in a formula; it is made of numbers, names, operators and functions"


def _shown(text: str) -> str:
    return text if len(text) <= 80 else text[:77] + "…"
