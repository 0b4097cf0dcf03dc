"""The vocabulary and syntax of formulas, which are parsed and checked when they are read.

A formula cannot run code: its syntax tree may hold numbers, the names that the caller gives, arithmetic,
comparisons, `and`, `or`, `not`, `a if b else c`, and FUNCTIONS. Anything else is refused.
"""

from __future__ import annotations

import ast
import operator
import warnings
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from pipeline.errors import UsageError, brief, shortened, suggestion
from pipeline.formula.notations import MEANT, WRITTEN_AS, syntax_fault
from render.base.plural import plural

CONSTANTS = {"pi": np.pi, "e": np.e}

PLACE = ("x", "y", "z")
"""The names of a position: scene units."""

TIME = ("t", "time", "frame")
"""The names of a time: seconds since the first frame, short and long, and the frame number, with a fraction
between frames."""


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


MOST_CHARACTERS, MOST_PARTS, DEEPEST = 1000, 300, 40
"""More than anybody writes by hand, and far less than exhausts a machine."""

LARGEST_EXPONENT = 64


class FormulaError(UsageError):
    """An invalid formula; `column` counts its characters from 1."""

    def __init__(self, text: str, column: int, message: str) -> None:
        super().__init__(f"formula {shortened(text)}, column {column}: {message}")
        self.column = column
        self.message = message


def parse(text: str, names: tuple[str, ...]) -> ast.expr:
    """Return the syntax tree of a formula. Raises FormulaError, with the column, for an invalid part."""
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
            warnings.simplefilter("ignore")  # the parser's advice on parts that are refused anyway
            tree = ast.parse(line.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        column, message = syntax_fault(line) or (
            min(indent + (getattr(error, "offset", None) or len(line.strip()) + 1), len(text) + 1),
            "this is no arithmetic. Look for a missing operator or bracket.",
        )
        raise FormulaError(text, column, message) from None
    _Check(text, line.strip().encode(), indent, names).everything(tree)
    return tree


class _Check:
    """Walks a syntax tree and raises at the first invalid part."""

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
        """Return the parts of a node, which itself is valid."""
        match node:
            case ast.Constant():
                self.number(node)
                return []
            case ast.Name():
                self.name(node)
                return []
            case ast.UnaryOp() if type(node.op) in OPERATORS:
                return [node.operand]
            case ast.BinOp() if type(node.op) in OPERATORS:
                self.exponent(node)
                return [node.left, node.right]
            case ast.BoolOp():
                return node.values
            case ast.Compare() if all(type(op) in OPERATORS for op in node.ops):
                return [node.left, *node.comparators]
            case ast.IfExp():
                return [node.test, node.body, node.orelse]
            case ast.Call():
                self.call(node)
                return node.args
        raise self.error(node, _refusal(node))

    def number(self, node: ast.Constant) -> None:
        if isinstance(node.value, bool) or not isinstance(node.value, int | float):
            raise self.error(node, f"{shortened(node.value)} is no number; write one plainly, such as 0.05")
        if not abs(node.value) <= 1e100:
            raise self.error(node, "this number is too large; 1e100 is the largest")

    def name(self, node: ast.Name) -> None:
        if node.id in FUNCTIONS:
            raise self.error(node, f"{node.id} is a function; write {node.id}(…)")
        if node.id not in self.names and node.id not in CONSTANTS:
            words = (*self.names, *CONSTANTS, *FUNCTIONS)
            meant = MEANT.get(node.id)
            hint = f"Write {meant}." if meant in words else suggestion(node.id, words)
            if hint.startswith("There"):
                hint = f"There are: {', '.join((*self.names, *CONSTANTS))}, and functions such as sin(x)."
            raise self.error(node, f"{brief(node.id)} is not known here. {hint}")

    def exponent(self, node: ast.BinOp) -> None:
        power = node.right.operand if isinstance(node.right, ast.UnaryOp) else node.right
        if not isinstance(node.op, ast.Pow) or not isinstance(power, ast.Constant):
            return
        if isinstance(power.value, int | float) and abs(power.value) > LARGEST_EXPONENT:
            raise self.error(power, f"the exponent is too large; {LARGEST_EXPONENT} is the largest")

    def call(self, node: ast.Call) -> None:
        if isinstance(node.func, ast.Attribute) and node.func.attr in FUNCTIONS:
            raise self.error(node.func, f"functions stand alone. Write {node.func.attr}(…).")
        if not isinstance(node.func, ast.Name):
            raise self.error(node.func, "only functions by their name can be called, such as sin(x)")
        name = node.func.id
        if name not in FUNCTIONS:
            hint = WRITTEN_AS.get(name) or suggestion(name, FUNCTIONS)
            raise self.error(node.func, f"{brief(name)} is no function here. {hint}")
        wanted, given = FUNCTIONS[name][1], len(node.args)
        if node.keywords or any(isinstance(part, ast.Starred) for part in node.args):
            raise self.error(node, f"{name} takes plain arguments, one after another")
        if given < wanted or (given > wanted and name not in ("min", "max")):
            more = " or more" if name in ("min", "max") else ""
            arguments = f"{wanted}{more} arguments" if more else plural(wanted, "argument")
            raise self.error(node, f"{name} takes {arguments}, not {given}")

    def error(self, node: ast.expr, message: str) -> FormulaError:
        before = self.line[: node.col_offset].decode(errors="ignore")
        return FormulaError(self.text, self.indent + len(before) + 1, message)


def _refusal(node: ast.expr) -> str:
    match node:
        case ast.Tuple():
            return "a comma stands between the arguments of a function; decimals have a point, as in 0.5."
        case ast.BinOp(op=ast.FloorDiv()):
            return "// is not known here. Write floor(a / b)."
        case ast.BinOp(op=ast.BitXor()):
            return "^ is not known here. A power is written x ** 2."
        case ast.Attribute():
            return "a point cannot stand here. Names have no parts."
        case ast.UnaryOp() | ast.BinOp() | ast.Compare():
            return "this operator is not known here. There are: + - * / ** % < <= > >= == != and or not."
    return "this cannot stand in a formula; it is made of numbers, names, operators and functions"
