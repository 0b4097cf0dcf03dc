"""Parameters that are formulas over time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pipeline.arrays import Floats
from pipeline.flow.keyframes import Curve, Values
from pipeline.formula import TIME, Expression
from pipeline.formula.words import moment

SAME_FRAME = 9
"""Decimals to which the number of a frame is rounded, so that `floor(frame)` is that of the frame."""


def frame_at(seconds: Any, fps: float, first: int) -> Any:
    """The number of the frame at seconds (…), with a fraction between frames."""
    return first + np.round(np.multiply(seconds, fps), SAME_FRAME)


@dataclass(frozen=True)
class Formulated(Curve):
    """One formula a value: `Formulated(("4 * sin(2 * pi * t)",), fps=24.0, first=1)`.

    fps    frames per second
    first  the number of the frame at 0 seconds
    unit   what each value is multiplied by, to become the code's unit

    Raises FormulaError for what cannot stand in a formula.
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
        """Raises UsageError where a formula is not finite."""
        return tuple(self.over([time])[0].tolist())

    def over(self, times: Iterable[float]) -> Floats:
        """The values (T, K) at many times. Raises UsageError with the first at which one is not finite."""
        seconds = np.fromiter(times, np.float64)
        now = moment(frame_at(seconds, self.fps, self.first), seconds)
        found = [formula(**now) for formula in self._expressions]
        return self.unit * np.stack(found, axis=1)
