"""Parameters that are formulas over time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from pipeline.arrays import Floats
from pipeline.flow.bezier import Values
from pipeline.flow.choreography import Curve
from pipeline.formula import Expression

TIME_NAMES = ("frame", "seconds")
"""What a formula over time may speak of: the frame's number, with a fraction between frames, and seconds from
the first frame."""

SAME_FRAME = 9
"""Decimals to which the number of a frame is rounded, so that `floor(frame)` is that of the frame."""


@dataclass(frozen=True)
class Formulated(Curve):
    """One formula a value: `Formulated(("4 * sin(2 * pi * seconds)",), fps=24.0, first=1)`.

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
        expressions = tuple(Expression(text, TIME_NAMES) for text in self.texts)
        object.__setattr__(self, "_expressions", expressions)

    def at(self, time: float) -> Values:
        """Raises UsageError where a formula is not finite."""
        return tuple(self.over([time])[0].tolist())

    def over(self, times: Iterable[float]) -> Floats:
        """The values (T, K) at many times. Raises UsageError with the first at which one is not finite."""
        seconds = np.fromiter(times, np.float64)
        frames = self.first + np.round(seconds * self.fps, SAME_FRAME)
        found = [formula(frame=frames, seconds=seconds) for formula in self._expressions]
        return self.unit * np.stack(found, axis=1)
