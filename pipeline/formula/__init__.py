"""Formulas as artists write them, `0.02 + 0.01 * abs(y)`: checked, then evaluated or compiled."""

from pipeline.formula.expression import Expression
from pipeline.formula.syntax import FUNCTIONS, MOST_CHARACTERS, PLACE, TIME, FormulaError

__all__ = ["FUNCTIONS", "MOST_CHARACTERS", "PLACE", "TIME", "Expression", "FormulaError"]
