"""Formulas compiled to functions that add a velocity to each point of a block.

A formula becomes Python source of plain arithmetic, one line an operation. Infinities and NaN come out as in
numpy (see `Expression`): tests compare the two. The source is compiled on first use and cached with the
kernels. The values of names are arguments: changing them compiles nothing.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Any

from flowsculpt.api.flows import Expression, generated_kernel

_MATH = ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sqrt", "exp", "log")
_NUMPY = ("floor", "ceil")
_SYMBOLS: dict[type[ast.AST], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.Mod: "%",
    ast.Pow: "**",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
}


class ScalarCode:
    """Lines of code that compute checked formulas; common subexpressions are computed once.

    words    the code's name for each name of a formula
    varying  the code's names whose values differ from point to point

    once, each  the lines without varying names, and those with
    """

    def __init__(self, words: Mapping[str, str], varying: Iterable[str]) -> None:
        self.once: list[str] = []
        self.each: list[str] = []
        self._words = {"pi": "math.pi", "e": "math.e", **words}
        self._varying = set(varying)
        self._known: dict[str, str] = {}

    def value(self, node: ast.expr) -> str:
        """Add lines that compute a checked tree; return the name or number of its value."""
        match node:
            case ast.Constant(value=int() | float() as number):
                return repr(float(number))
            case ast.Name():
                return self._words[node.id]
            case ast.UnaryOp(op=ast.Not()):
                return self._line("1.0 if {} == 0.0 else 0.0", self.value(node.operand))
            case ast.UnaryOp():
                sign = "-" if isinstance(node.op, ast.USub) else "+"
                return self._line(sign + "{}", self.value(node.operand))
            case ast.BinOp():
                return self._binary(node)
            case ast.BoolOp():
                sides = [self.value(part) for part in node.values]
                word = " and " if isinstance(node.op, ast.And) else " or "
                return self._line(f"1.0 if {word.join(['{} != 0.0'] * len(sides))} else 0.0", *sides)
            case ast.Compare():
                return self._comparison(node)
            case ast.IfExp():
                test, body, otherwise = (self.value(part) for part in (node.test, node.body, node.orelse))
                return self._line("{} if {} != 0.0 else {}", body, test, otherwise)
            case ast.Call(func=ast.Name(id=name)):
                return self._call(name, [self.value(part) for part in node.args])
        raise AssertionError(f"{ast.dump(node)} was checked and is known")

    def _line(self, form: str, *parts: str) -> str:
        """Add a line for an operation on names and numbers, unless it exists; return its name."""
        text = form.format(*parts)
        if text not in self._known:
            name = f"r{len(self._known)}"
            varies = not self._varying.isdisjoint(parts)
            self._known[text] = name
            (self.each if varies else self.once).append(f"{name} = {text}")
            if varies:
                self._varying.add(name)
        return self._known[text]

    def _binary(self, node: ast.BinOp) -> str:
        left, right = self.value(node.left), node.right
        power = right.value if isinstance(node.op, ast.Pow) and isinstance(right, ast.Constant) else None
        if isinstance(power, int | float) and power == int(power):
            return self._line(f"{{}} ** {int(power)}", left)  # compiled to a product
        return self._line(f"{{}} {_SYMBOLS[type(node.op)]} {{}}", left, self.value(right))

    def _comparison(self, node: ast.Compare) -> str:
        sides = [self.value(side) for side in (node.left, *node.comparators)]
        tests = " and ".join(f"{{}} {_SYMBOLS[type(op)]} {{}}" for op in node.ops)
        pairs = [side for pair in pairwise(sides) for side in pair]
        return self._line(f"1.0 if {tests} else 0.0", *pairs)

    def _call(self, name: str, given: list[str]) -> str:
        if name in _MATH:
            return self._line(f"math.{name}({', '.join(['{}'] * len(given))})", *given)
        if name in _NUMPY:
            return self._line(f"np.{name}({{}})", *given)
        if name == "abs":
            return self._line("abs({})", *given)
        if name in ("min", "max"):
            first, *others = given
            for other in others:
                first = self._lesser(first, other) if name == "min" else self._greater(first, other)
            return first
        if name == "clamp":
            return self._lesser(self._greater(given[0], given[1]), given[2])
        if name == "smoothstep":
            low, high, x = given
            above, width = self._line("{} - {}", x, low), self._line("{} - {}", high, low)
            share = self._lesser(self._greater(self._line("{} / {}", above, width), "0.0"), "1.0")
            return self._line("{0} * {0} * (3.0 - 2.0 * {0})", share)
        raise AssertionError(f"{name} was checked and is known")

    def _lesser(self, a: str, b: str) -> str:
        return self._line("{0} if {0} <= {1} or {0} != {0} else {1}", a, b)

    def _greater(self, a: str, b: str) -> str:
        return self._line("{0} if {0} >= {1} or {0} != {0} else {1}", a, b)


NAMES = ("x", "y", "z", "t", "time", "frame")  # that such formulas may always use
FRAME = "frame"  # the name whose value is an argument: formulas that use it have it among their numbers

_MODULE = """\
def formula(numbers, count, xs, ys, zs, t, us, vs, ws):
    {once}
    for i in range(count):
        x, y, z = xs[i], ys[i], zs[i]
        {each}
        us[i] += {u}
        vs[i] += {v}
        ws[i] += {w}
"""


def compile_formulas(
    formulas: tuple[Expression, Expression, Expression], numbers: tuple[str, ...] = ()
) -> Any:
    """Return the block function of three formulas over x, y, z, t and `numbers`, its first argument."""
    return generated_kernel("formula", source(formulas, numbers))


def source(formulas: tuple[Expression, Expression, Expression], numbers: tuple[str, ...] = ()) -> str:
    """Return the Python source of the function."""
    words = {name: f"number{k}" for k, name in enumerate(numbers)}
    code = ScalarCode({"x": "x", "y": "y", "z": "z", "t": "t", "time": "t", **words}, NAMES[:3])
    u, v, w = (code.value(formula.tree) for formula in formulas)
    once = [f"{word} = numbers[{k}]" for k, word in enumerate(words.values())] + code.once
    return _MODULE.format(
        once="\n    ".join(once or ["pass"]), each="\n        ".join(code.each or ["pass"]), u=u, v=v, w=w
    )
