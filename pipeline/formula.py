"""Formulas as artists write them, `0.02 + 0.01 * abs(y)`: parsed and checked, then evaluated by numpy.

A formula cannot run code: its syntax tree may hold numbers, the names that the caller gives, arithmetic,
comparisons, `and`, `or`, `not`, `a if b else c`, and FUNCTIONS. Anything else is refused.
"""

from __future__ import annotations

import ast
import operator
import re
import threading
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flowsculpt.pipeline.arrays import Floats
from flowsculpt.pipeline.errors import UsageError, quote, shorten, suggest
from flowsculpt.render.base.plural import plural

_PARSING = threading.Lock()  # whoever ends last would put back the filters of another thread

CONSTANTS = {"pi": np.pi, "e": np.e}

PLACE = ("x", "y", "z")  # the names of a position: scene units

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

FRAME_DECIMALS = 9  # decimals of the frame number, so that `floor(frame)` is the number of the frame


class FormulaError(UsageError, ValueError):
    """An invalid formula, a ValueError for validators; `column` counts its characters from 1."""

    def __init__(self, text: str, column: int, message: str) -> None:
        super().__init__(f"formula {quote(text)}, column {column}: {message}")
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
        with _PARSING, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the parser's advice on parts that are refused anyway
            tree = ast.parse(line.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        column, message = _other_notation(line) or (
            min(indent + (getattr(error, "offset", None) or len(line.strip()) + 1), len(text) + 1),
            "this is not arithmetic. Look for a missing operator or bracket.",
        )
        raise FormulaError(text, column, message) from None
    _Check(text, line.strip().encode(), indent, names).check_parts(tree)
    return tree


class _Check:
    """Walks a syntax tree and raises at the first invalid part."""

    def __init__(self, text: str, line: bytes, indent: int, names: tuple[str, ...]) -> None:
        self.text, self.line, self.indent, self.names = text, line, indent, names
        self.parts = 0

    def check_parts(self, node: ast.expr, depth: int = 0) -> None:
        self.parts += 1
        if self.parts > MOST_PARTS or depth > DEEPEST:
            raise self.error(
                node, f"it is too involved; {MOST_PARTS} parts, nested {DEEPEST} deep, are the most"
            )
        for inner in self.inner(node):
            self.check_parts(inner, depth + 1)

    def inner(self, node: ast.expr) -> list[ast.expr]:
        """Return the parts of a node, which itself is valid."""
        match node:
            case ast.Constant():
                self.check_number(node)
                return []
            case ast.Name():
                self.check_name(node)
                return []
            case ast.UnaryOp() if type(node.op) in OPERATORS:
                return [node.operand]
            case ast.BinOp() if type(node.op) in OPERATORS:
                self.check_exponent(node)
                return [node.left, node.right]
            case ast.BoolOp():
                return node.values
            case ast.Compare() if all(type(op) in OPERATORS for op in node.ops):
                return [node.left, *node.comparators]
            case ast.IfExp():
                return [node.test, node.body, node.orelse]
            case ast.Call():
                self.check_call(node)
                return node.args
        raise self.error(node, _refusal(node))

    def check_number(self, node: ast.Constant) -> None:
        if isinstance(node.value, bool) or not isinstance(node.value, int | float):
            raise self.error(node, f"{quote(node.value)} is not a number; write one plainly, such as 0.05")
        if not abs(node.value) <= 1e100:
            raise self.error(node, "this number is too large; 1e100 is the largest")

    def check_name(self, node: ast.Name) -> None:
        if node.id == "nan":
            raise self.error(node, "this is not a number; write one plainly, such as 0.05")
        if node.id in FUNCTIONS:
            raise self.error(node, f"{node.id} is a function; write {node.id}(…)")
        if node.id not in self.names and node.id not in CONSTANTS:
            words = (*self.names, *CONSTANTS, *FUNCTIONS)
            meant = _OTHER_NAMES.get(node.id)
            hint = f"Write {meant}." if meant in words else suggest(node.id, words)
            if hint.startswith("There"):
                hint = f"There are: {', '.join((*self.names, *CONSTANTS))}, and functions such as sin(x)."
            raise self.error(node, f"{shorten(node.id)} is not known here. {hint}")

    def check_exponent(self, node: ast.BinOp) -> None:
        power = node.right.operand if isinstance(node.right, ast.UnaryOp) else node.right
        if not isinstance(node.op, ast.Pow) or not isinstance(power, ast.Constant):
            return
        if isinstance(power.value, int | float) and abs(power.value) > LARGEST_EXPONENT:
            raise self.error(power, f"the exponent is too large; {LARGEST_EXPONENT} is the largest")

    def check_call(self, node: ast.Call) -> None:
        if isinstance(node.func, ast.Attribute) and node.func.attr in FUNCTIONS:
            raise self.error(node.func, f"functions stand alone. Write {node.func.attr}(…).")
        if not isinstance(node.func, ast.Name):
            raise self.error(node.func, "only functions by their name can be called, such as sin(x)")
        name = node.func.id
        if name not in FUNCTIONS:
            hint = _OTHER_FUNCTIONS.get(name) or suggest(name, FUNCTIONS)
            raise self.error(node.func, f"{shorten(name)} is not a function here. {hint}")
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


_OTHER_NAMES = {"seconds": "t", "f": "frame", "$F": "frame", "$T": "t", "@Frame": "frame", "@Time": "t"} | {
    f"@P.{axis}": axis for axis in "xyz"
}
"""Names of other programs, and those that formulas have for them."""

_OTHER_FUNCTIONS = {
    "pow": "Write a ** b.",
    "mod": "Write a % b.",
    "fmod": "Write a % b.",
    "lerp": "Write a + (b - a) * w.",
    "mix": "Write a + (b - a) * w.",
    "round": "Write floor(x + 0.5).",
    "sign": "Write 1 if x > 0 else -1.",
    "where": "Write a if condition else b.",
    "noise": "The flow curl_noise is noise; formulas have none.",
}
"""Functions of other languages, and what to write."""

_OTHER_OPERATORS = {
    "?": "Write a if condition else b.",
    "&&": "Write and.",
    "||": "Write or.",
    ";": "Remove it.",
    "°": "Angles are radians. Write * pi / 180.",
}

_PRODUCT = re.compile(
    r"(?<![\w.])(\d+(?:\.\d*)?)\s*((?!e[-+]?\d)[A-Za-z_]\w*|\()|([A-Za-z_]\w*)\s+([A-Za-z_]\w*)"
)
"""A number or name with another one after it, and no operator between."""


def _other_notation(line: str) -> tuple[int, str] | None:
    """Return column and message of a notation of other languages that keeps a formula from being parsed."""
    if match := re.search(r"[$@]\w+(?:\.\w+)?", line):
        meant = _OTHER_NAMES.get(match[0])
        remedy = f"Write {meant}." if meant else "Names have no $ or @ here."
        return match.start() + 1, f"{match[0]} is not known here. {remedy}"
    for mark, remedy in _OTHER_OPERATORS.items():
        if mark in line:
            return line.index(mark) + 1, f"{mark} is not known here. {remedy}"
    for match in _PRODUCT.finditer(line):
        left, right = match[1] or match[3], match[2] or match[4]
        if not {left, right} & {"and", "or", "not", "if", "else"}:
            return match.start(2 if match[2] else 4) + 1, f"an operator is missing. Write {left} * {right}."
    return None


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


@dataclass(frozen=True)
class Expression:
    """A formula over named values; true is 1 and false 0.

    text   as the user writes it
    names  the values it may use, such as ("x", "y", "z", "time")
    tree   its syntax tree, checked

    Raises FormulaError, with the column, for anything that is not a number, name, operator or function of
    ours, and for constant parts that are not finite.
    """

    text: str
    names: tuple[str, ...]
    tree: ast.expr = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "tree", parse(self.text, self.names))
        for part in constant_parts(self.tree):
            if (culprit := not_finite_part(part, CONSTANTS)) is not None:
                node, value = culprit
                raise FormulaError(
                    self.text,
                    column_of(self.text, node),
                    f"{shorten(ast.unparse(node))} is {value:g}; a formula must be finite. Write another.",
                )

    RESERVED: ClassVar[frozenset[str]] = frozenset({*CONSTANTS, *FUNCTIONS})
    """Words with a meaning, which cannot name values."""

    @staticmethod
    def number_text(value: Any) -> Any:
        """Return the text of a number as formulas have it; anything else unchanged."""
        if not isinstance(value, int | float) or isinstance(value, bool):
            return value
        text = repr(value)
        return "1e999" if text.endswith("inf") else text  # which is refused as too large

    @staticmethod
    def frame_at(seconds: Any, fps: float, first: int) -> Any:
        """Return the values of `frame` at seconds (…), where the frame `first` is at 0 seconds."""
        return first + np.round(np.multiply(seconds, fps), FRAME_DECIMALS)

    @cached_property
    def uses(self) -> frozenset[str]:
        """The names it uses."""
        inner = ast.walk(self.tree)
        return frozenset(n.id for n in inner if isinstance(n, ast.Name)) & frozenset(self.names)

    @property
    def reported_names(self) -> tuple[str, ...]:
        """The names whose values a message reports: of `t` and `time` only one, the one it uses."""
        unused = "t" if "time" in self.uses and "t" not in self.uses else "time"
        both = {"t", "time"} <= set(self.names)
        return tuple(name for name in self.names if not (both and name == unused))

    def __call__(self, **values: ArrayLike) -> Floats:
        """Return the formula's values, one for each row of the arguments: numbers or arrays of one length.

        Raises UsageError where a value is not finite, with the first such row.
        """
        known = {name: np.asarray(values[name], np.float64) for name in self.uses}
        with np.errstate(all="ignore"):  # values that are not finite raise below
            evaluated = np.asarray(value_of(self.tree, {**CONSTANTS, **known}), np.float64)
        shape = np.broadcast_shapes(evaluated.shape, *(np.shape(value) for value in values.values()))
        result = np.array(np.broadcast_to(evaluated, shape))
        bad = np.flatnonzero(~np.isfinite(result))
        if bad.size:
            raise UsageError(self._not_finite(result, int(bad[0]), values))
        return result

    def diagnose(self, values: Mapping[str, float]) -> str | None:
        """Return the part that is not finite for these values, with its column; None where all is finite."""
        known = {name: np.float64(value) for name, value in {**CONSTANTS, **values}.items()}
        culprit = not_finite_part(self.tree, known)
        if culprit is None:
            return None
        part, value = culprit
        column = column_of(self.text, part)
        place = ", ".join(f"{name} {values[name]:.4g}" for name in self.reported_names if name in values)
        return (
            f"formula {quote(self.text)}, column {column}: {shorten(ast.unparse(part))} "
            f"is {value:g} at {place}; it must be finite. Guard it with max, clamp or `… if … else …`."
        )

    def _not_finite(self, result: Floats, row: int, values: Mapping[str, ArrayLike]) -> str:
        rows = {name: np.broadcast_to(value, result.shape).ravel()[row] for name, value in values.items()}
        place = ", ".join(f"{name} {float(rows[name]):g}" for name in self.reported_names if name in rows)
        return (
            f"formula {quote(self.text)} is {result.ravel()[row]:g} at {place}; "
            "it must be finite everywhere. Guard it with max, clamp or `… if … else …`."
        )


def value_of(node: ast.expr, known: Mapping[str, Any]) -> Any:
    """Return the value of a checked tree. Both branches of a condition are evaluated, each row takes one."""
    match node:
        case ast.Constant(value=int() | float() as number):
            return np.float64(number)
        case ast.Name():
            return known[node.id]
        case ast.UnaryOp():
            return _number(OPERATORS[type(node.op)](value_of(node.operand, known)))
        case ast.BinOp():
            return OPERATORS[type(node.op)](value_of(node.left, known), value_of(node.right, known))
        case ast.BoolOp():
            return _number(_folded(OPERATORS[type(node.op)], [value_of(part, known) for part in node.values]))
        case ast.Compare():
            sides = [value_of(side, known) for side in (node.left, *node.comparators)]
            pairs = zip(node.ops, sides, sides[1:], strict=False)
            return _number(_folded(np.logical_and, [OPERATORS[type(op)](a, b) for op, a, b in pairs]))
        case ast.IfExp():
            return np.where(*(value_of(part, known) for part in (node.test, node.body, node.orelse)))
        case ast.Call(func=ast.Name(id=name)):
            function, arguments = FUNCTIONS[name][0], [value_of(part, known) for part in node.args]
            return _folded(function, arguments) if name in ("min", "max") else function(*arguments)
    raise AssertionError(f"{ast.dump(node)} was checked and is known")


def not_finite_part(node: ast.expr, known: Mapping[str, Any]) -> tuple[ast.expr, float] | None:
    """Return the first innermost part of a tree that is not finite, and its value; None if the whole is."""
    with np.errstate(all="ignore"):
        value = float(value_of(node, known))
    if np.isfinite(value):
        return None
    return next(filter(None, (not_finite_part(part, known) for part in _parts(node))), (node, value))


def constant_parts(node: ast.expr) -> list[ast.expr]:
    """Return the largest parts of a tree that use no values."""
    names = {inner.id for inner in ast.walk(node) if isinstance(inner, ast.Name)}
    if names <= {*CONSTANTS, *FUNCTIONS}:
        return [node]
    return [inner for part in _parts(node) for inner in constant_parts(part)]


def column_of(text: str, part: ast.expr) -> int:
    """Return the column of a part of a text's tree, from 1; the tree counts bytes from the first word on."""
    line = text.lstrip()
    return len(text) - len(line) + len(line.encode()[: part.col_offset].decode(errors="ignore")) + 1


def _parts(node: ast.expr) -> list[ast.expr]:
    inside = node.args if isinstance(node, ast.Call) else ast.iter_child_nodes(node)
    return [part for part in inside if isinstance(part, ast.expr)]


def _number(value: Any) -> Any:
    """Return true as 1 and false as 0."""
    return np.asarray(value, np.float64)


def _folded(function: Callable[..., Any], values: list[Any]) -> Any:
    first, *others = values
    for value in others:
        first = function(first, value)
    return first
