"""Formulas as values, evaluated by numpy."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from pipeline.errors import UsageError, brief, shortened
from pipeline.formula.syntax import CONSTANTS, FUNCTIONS, OPERATORS, FormulaError, parse


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
                    f"{brief(ast.unparse(node))} is {value:g}; a formula must be finite. Write another.",
                )

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
            f"formula {shortened(self.text)}, column {column}: {brief(ast.unparse(part))} "
            f"is {value:g} at {place}; it must be finite. Guard it with max, clamp or `… if … else …`."
        )

    def _not_finite(self, result: Floats, row: int, values: Mapping[str, ArrayLike]) -> str:
        rows = {name: np.broadcast_to(value, result.shape).ravel()[row] for name, value in values.items()}
        place = ", ".join(f"{name} {float(rows[name]):g}" for name in self.reported_names if name in rows)
        return (
            f"formula {shortened(self.text)} is {result.ravel()[row]:g} at {place}; "
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
