"""Formulas as artists write them, `0.02 + 0.01 * abs(y)`: checked, then evaluated or compiled."""

from pipeline.formula.expression import Expression
from pipeline.formula.syntax import MOST_CHARACTERS, FormulaError
from pipeline.formula.words import FUNCTIONS, PLACE, TIME

__all__ = ["FUNCTIONS", "MOST_CHARACTERS", "PLACE", "TIME", "Expression", "FormulaError"]
