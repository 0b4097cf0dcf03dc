"""Velocities as the artist writes them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Annotated, Any

import numpy as np

from pipeline.arrays import Points
from pipeline.errors import UsageError
from pipeline.flow.formula_curve import frame_at
from pipeline.flow.keyframes import Number, number_at
from pipeline.flow.parameters import PositiveConstant, Sense
from pipeline.flow.velocity import External
from pipeline.formula import Expression
from pipeline.formula.compiled import FRAME, KNOWN, compiled
from pipeline.formula.expression import trouble
from pipeline.formula.words import moment
from pipeline.kernels import BlockKernel

MOST_NUMBERS = 10

SAMPLES = 8
"""Along each side of the cube in which the steepness is looked for; even, so that none lies on an axis."""


@dataclass(frozen=True)
class Formula(External):
    """The velocity by three formulas over x, y, z, t and frame.

        Formula(("-y", "x", "0.3 * sin(t)"))

    texts  along x, y and z, units per second; see `pipeline.formula`
    words  further words and their values, constant or keyed: changing these compiles nothing
    fps    frames per second, for what is said of `frame`
    first  the number of the frame at 0 seconds

    No bound of an arbitrary formula's gradient is known. It is differenced at 8³ places of the cube, and the
    steepest of them decides the sub-steps: what is steeper in between, or outside, is followed less closely.

    Raises FormulaError, with the column, for what is no formula, and UsageError for too many numbers.
    """

    texts: tuple[str, str, str]
    words: tuple[tuple[str, Number], ...] = ()
    extent: Annotated[PositiveConstant, Sense("half the side of the cube sampled for steepness", "units")] = (
        2.0
    )
    fps: float = 24.0
    first: int = 1

    def __post_init__(self) -> None:
        assert self.expressions, "they are checked now, not when the first frame is made"
        if len(self._names) > MOST_NUMBERS:
            beside = f" beside {FRAME}" if FRAME in self._names else ""
            raise UsageError(
                f"a formula has {len(self.words)} numbers of its own{beside}; "
                f"{MOST_NUMBERS - bool(beside)} are the most. Write some of them into the formula."
            )

    @cached_property
    def expressions(self) -> tuple[Expression, Expression, Expression]:
        u, v, w = (Expression(text, (*KNOWN, *(name for name, _ in self.words))) for text in self.texts)
        return u, v, w

    @cached_property
    def _names(self) -> tuple[str, ...]:
        """Of the numbers that its function is given."""
        named = tuple(name for name, _ in self.words)
        return (*named, FRAME) if self._speaks_of(FRAME) else named

    @cached_property
    def block(self) -> BlockKernel:
        return compiled(self.expressions, self._names)

    @cached_property
    def timed(self) -> bool:
        """Whether it speaks of seconds."""
        return self._speaks_of("t") or self._speaks_of("time")

    @cached_property
    def _words_used(self) -> frozenset[str]:
        return frozenset().union(*(expression.uses for expression in self.expressions))

    def _speaks_of(self, word: str) -> bool:
        return word in self._words_used

    def numbers(self, time: float) -> tuple[float, ...]:
        given = tuple(number_at(value, time) for _, value in self.words)
        return (*given, float(frame_at(time, self.fps, self.first))) if self._speaks_of(FRAME) else given

    def identity(self, time: float) -> Any:
        named = zip(self._names, self.numbers(time), strict=True)
        numbers = {name: number for name, number in named if self._speaks_of(name)}
        return {"formula": list(self.texts), "numbers": numbers, **({"t": time} if self.timed else {})}

    def gradient_bound(self, time: float) -> float:
        return _steepest(self, self.numbers(time), time if self.timed else 0.0)

    def trouble(self, place: Points, time: float) -> str | None:
        """What is not finite at a place (3,), and where in the formula that begins; None if nothing."""
        x, y, z = place.tolist()
        words = {name: number_at(value, time) for name, value in self.words}
        now = moment(float(frame_at(time, self.fps, self.first)), time)
        values = {"x": x, "y": y, "z": z, **now, **words}
        return next(filter(None, (trouble(expression, values) for expression in self.expressions)), None)


@lru_cache(maxsize=4096)
def _steepest(field: Formula, numbers: tuple[float, ...], time: float) -> float:
    """The largest norm of the gradient at the samples, as far as it is finite there."""
    side = field.extent * (2.0 * np.arange(SAMPLES) - SAMPLES + 1) / SAMPLES
    places = np.stack(np.meshgrid(side, side, side), axis=-1).reshape(-1, 3)
    step = 1e-5 * field.extent
    beside = np.concatenate([places + sign * step * axis for axis in np.eye(3) for sign in (1.0, -1.0)])
    columns = np.ascontiguousarray(beside.T)
    out = np.zeros_like(columns)
    field.block(np.array(numbers or (0.0,)), columns, time, out)
    velocity = out.T.reshape(3, 2, len(places), 3)
    with np.errstate(all="ignore"):
        gradient = ((velocity[:, 0] - velocity[:, 1]) / (2.0 * step)).transpose(1, 2, 0)
    finite = gradient[np.isfinite(gradient).all(axis=(1, 2))]
    return float(np.linalg.norm(finite, ord=2, axis=(1, 2)).max(initial=0.0))
