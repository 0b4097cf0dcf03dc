"""A formula as a value, and what it comes to, by numpy."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from pipeline.errors import UsageError
from pipeline.formula.syntax import FormulaError, checked, shown
from pipeline.formula.words import CONSTANTS, FUNCTIONS, OPERATORS


@dataclass(frozen=True)
class Expression:
    """A formula over named values; true is 1 and false 0.

    text   what is written
    names  the values it may speak of, such as ("x", "y", "z", "time")
    tree   its syntax, in which everything is allowed

    Raises FormulaError, with the column, for anything that is no number, name, operator or function of ours,
    and for what is not finite whatever the values are.
    """

    text: str
    names: tuple[str, ...]
    tree: ast.expr = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "tree", checked(self.text, self.names))
        for part in constant_parts(self.tree):
            if (found := guilty(part, CONSTANTS)) is not None:
                node, value = found
                raise FormulaError(
                    self.text,
                    column_of(self.text, node),
                    f"{shown(ast.unparse(node))} is {value:g}; a formula must be finite. Write another.",
                )

    @cached_property
    def uses(self) -> frozenset[str]:
        """The names that it speaks of."""
        inner = ast.walk(self.tree)
        return frozenset(n.id for n in inner if isinstance(n, ast.Name)) & frozenset(self.names)

    @property
    def told(self) -> tuple[str, ...]:
        """The names whose values a message tells: of two for the same the one that is spoken of."""
        spare = "t" if "time" in self.uses and "t" not in self.uses else "time"
        both = {"t", "time"} <= set(self.names)
        return tuple(name for name in self.names if not (both and name == spare))

    def __call__(self, **values: ArrayLike) -> Floats:
        """The formula's value, one for each row of the values, which are numbers or arrays of one length.

        Raises UsageError where a value is not finite, with the first place where that is so.
        """
        known = {name: np.asarray(values[name], np.float64) for name in self.uses}
        with np.errstate(all="ignore"):  # what is not finite is told below, where it comes out
            found = np.asarray(value_of(self.tree, {**CONSTANTS, **known}), np.float64)
        everything = np.broadcast_shapes(found.shape, *(np.shape(value) for value in values.values()))
        result = np.array(np.broadcast_to(found, everything))
        bad = np.flatnonzero(~np.isfinite(result))
        if bad.size:
            raise UsageError(self._not_finite(result, int(bad[0]), values))
        return result

    def _not_finite(self, result: Floats, row: int, values: Mapping[str, ArrayLike]) -> str:
        rows = {name: np.broadcast_to(value, result.shape).ravel()[row] for name, value in values.items()}
        place = ", ".join(f"{name} {float(rows[name]):g}" for name in self.told if name in rows)
        return (
            f"formula {shown(self.text)!r} is {result.ravel()[row]:g} at {place}; "
            "it must be finite everywhere. Guard it with max, clamp or `… if … else …`."
        )


def value_of(node: ast.expr, known: Mapping[str, Any]) -> Any:
    """The value of a checked tree. Both sides of a condition are evaluated, and one is taken at each row."""
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


def guilty(node: ast.expr, known: Mapping[str, Any]) -> tuple[ast.expr, float] | None:
    """The first innermost part of a tree that is not finite, and what it is, if the whole is not finite."""
    with np.errstate(all="ignore"):
        found = float(value_of(node, known))
    if np.isfinite(found):
        return None
    return next(filter(None, (guilty(part, known) for part in _parts(node))), (node, found))


def constant_parts(node: ast.expr) -> list[ast.expr]:
    """The largest parts of a tree that are the same whatever the values are."""
    names = {inner.id for inner in ast.walk(node) if isinstance(inner, ast.Name)}
    if names <= {*CONSTANTS, *FUNCTIONS}:
        return [node]
    return [inner for part in _parts(node) for inner in constant_parts(part)]


def column_of(text: str, part: ast.expr) -> int:
    """Where a part of its tree begins in a text, from 1; the tree counts the bytes after its first word."""
    line = text.lstrip()
    return len(text) - len(line) + len(line.encode()[: part.col_offset].decode(errors="ignore")) + 1


def _parts(node: ast.expr) -> list[ast.expr]:
    inside = node.args if isinstance(node, ast.Call) else ast.iter_child_nodes(node)
    return [part for part in inside if isinstance(part, ast.expr)]


def _number(value: Any) -> Any:
    """What is true as 1 and what is false as 0, so that it can be computed with."""
    return np.asarray(value, np.float64)


def _folded(function: Callable[..., Any], values: list[Any]) -> Any:
    first, *others = values
    for value in others:
        first = function(first, value)
    return first


def trouble(formula: Expression, values: Mapping[str, float]) -> str | None:
    """One line with the column and the values; None where the formula is finite."""
    known = {name: np.float64(value) for name, value in {**CONSTANTS, **values}.items()}
    told = guilty(formula.tree, known)
    if told is None:
        return None
    part, found = told
    column = column_of(formula.text, part)
    place = ", ".join(f"{name} {values[name]:.4g}" for name in formula.told if name in values)
    return (
        f"formula {shown(formula.text)!r}, column {column}: {shown(ast.unparse(part))} "
        f"is {found:g} at {place}; it must be finite. Guard it with max, clamp or `… if … else …`."
    )
