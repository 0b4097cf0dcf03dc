"""Why a formula is not finite at a place: the part of it where that begins."""

from __future__ import annotations

import ast
from collections.abc import Mapping

import numpy as np

from pipeline.formula.expression import Expression, column_of, guilty
from pipeline.formula.syntax import shown
from pipeline.formula.words import CONSTANTS


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
