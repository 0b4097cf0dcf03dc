"""Parameters that are formulas over time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pipeline.arrays import Floats
from pipeline.flow.keyframes import Curve, Values
from pipeline.formula import TIME, Expression
from pipeline.formula.words import time_values

FRAME_DECIMALS = 9
"""Decimals of the frame number, so that `floor(frame)` is the number of the frame."""


def frame_at(seconds: Any, fps: float, first: int) -> Any:
    """Return the frame number at seconds (…), with a fraction between frames."""
    return first + np.round(np.multiply(seconds, fps), FRAME_DECIMALS)


@dataclass(frozen=True)
class FormulaCurve(Curve):
    """One formula a value: `FormulaCurve(("4 * sin(2 * pi * t)",), fps=24.0, first=1)`.

    fps    frames per second
    first  the number of the frame at 0 seconds
    unit   the factor from each value to the code's unit

    Raises FormulaError for invalid formulas.
    """

    texts: tuple[str, ...]
    fps: float
    first: int
    unit: float = 1.0
    _expressions: tuple[Expression, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        expressions = tuple(Expression(text, TIME) for text in self.texts)
        object.__setattr__(self, "_expressions", expressions)

    def at(self, time: float) -> Values:
        """Return the values at a time. Raises UsageError where a formula is not finite."""
        return tuple(self.over([time])[0].tolist())

    def over(self, times: Iterable[float]) -> Floats:
        """Return the values (T, K) at many times. Raises UsageError with the first that is not finite."""
        seconds = np.fromiter(times, np.float64)
        now = time_values(frame_at(seconds, self.fps, self.first), seconds)
        columns = [formula(**now) for formula in self._expressions]
        return self.unit * np.stack(columns, axis=1)
