"""Why a formula is not finite at a place: the part of it where that begins."""

from __future__ import annotations

import ast
from collections.abc import Mapping

import numpy as np

from pipeline.formula.expression import Expression, value_of
from pipeline.formula.syntax import shown
from pipeline.formula.words import CONSTANTS


def trouble(formula: Expression, values: Mapping[str, float]) -> str | None:
    """One line with the column and the values; None where the formula is finite."""
    known = {name: np.float64(value) for name, value in {**CONSTANTS, **values}.items()}
    guilty = _guilty(formula.tree, known)
    if guilty is None:
        return None
    part, found = guilty
    place = ", ".join(f"{name} {values[name]:.4g}" for name in formula.told if name in values)
    return (
        f"formula {shown(formula.text)!r}, column {_column(formula.text, part)}: {shown(ast.unparse(part))} "
        f"is {found:g} at {place}; it must be finite. Guard it with max, clamp or `… if … else …`."
    )


def _guilty(node: ast.expr, known: Mapping[str, np.float64]) -> tuple[ast.expr, float] | None:
    """The first innermost part that is not finite, if the whole is not."""
    with np.errstate(all="ignore"):
        found = float(value_of(node, known))
    if np.isfinite(found):
        return None
    return next(filter(None, (_guilty(part, known) for part in _parts(node))), (node, found))


def _parts(node: ast.expr) -> list[ast.expr]:
    inside = node.args if isinstance(node, ast.Call) else ast.iter_child_nodes(node)
    return [part for part in inside if isinstance(part, ast.expr)]


def _column(text: str, part: ast.expr) -> int:
    """Of a text, from 1; the tree counts the bytes after its first word."""
    line = text.lstrip()
    return len(text) - len(line) + len(line.encode()[: part.col_offset].decode(errors="ignore")) + 1
