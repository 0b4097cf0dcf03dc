"""Parameters that change in time: keyframes with easings or Bézier handles, as in Blender, and formulas."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from pipeline.arrays import Floats
from pipeline.errors import FrameError
from pipeline.flow.easing import EASINGS
from pipeline.flow.vectors import Vector
from pipeline.formula import TIME, Expression
from pipeline.formula.words import time_values

Values = tuple[float, ...]

SAME_TIME = 1e-9
"""Seconds by which a sum of steps may miss the time of a key."""

BEZIER = "bezier"
"""The easing whose curve is drawn by handles."""

BISECTIONS = 60
"""After so many a number between 0 and 1 is exact to the last bit."""

Extrapolation = Literal["hold", "loop", "ping_pong", "offset", "continue"]


class Curve(ABC):
    """Values that change in time. A value: the same time gives the same numbers, between frames too."""

    @abstractmethod
    def at(self, time: float) -> Values:
        """Return the values at a time, seconds from the start of the shot."""


Number = float | Curve
"""A scalar parameter: constant or changing in time."""

VectorParameter = Vector | Curve
"""A vector parameter: constant or changing in time."""


def number_at(parameter: Number, time: float) -> float:
    return parameter.at(time)[0] if isinstance(parameter, Curve) else parameter


def vector_at(parameter: VectorParameter, time: float) -> Vector:
    if isinstance(parameter, Curve):
        x, y, z = parameter.at(time)
        return x, y, z
    return parameter


def weight_at(weight: Number, time: float, name: str) -> float:
    """Return the weight of the flow `name` at a time. Raises FrameError where it is not from 0 to 1."""
    value = float(number_at(weight, time))
    if not -1e-12 <= value <= 1.0 + 1e-12:
        raise FrameError(
            f"flow {name} has the weight {value:g} at {time:g} s; a weight is from 0 to 1. "
            "Correct its keys, or choose an easing that does not overshoot."
        )
    return min(max(value, 0.0), 1.0)


@dataclass(frozen=True)
class Handle:
    """The control point beside a key, relative to it.

    seconds  0 or more right of the key, 0 or less left of it
    values   as many as the key has
    """

    seconds: float
    values: Values

    def scaled(self, factor: float) -> Handle:
        return Handle(self.seconds * factor, tuple(value * factor for value in self.values))


@dataclass(frozen=True)
class Keyframes(Curve):
    """Values at times, with an easing from each to the next.

    times   seconds from the start of the shot, ascending
    values  one a time: numbers or vectors (all of one length)
    eases   one a time, names of EASINGS or bezier: how the value leaves that key; the last is unused
    left    handles left of the keys, for bezier; None is automatic (see `automatic_slope`)
    right   handles right of the keys, likewise
    before  the extrapolation before the first key:
            hold, the first value; continue, on along the last chord (for bezier along the handle);
            loop, all keys again, the last key at the time of the first; ping_pong, forwards and backwards;
            offset, again, each round starting at the value where the last one ended
    after   the extrapolation after the last key
    """

    times: tuple[float, ...]
    values: tuple[Values, ...]
    eases: tuple[str, ...]
    left: tuple[Handle | None, ...] = ()
    right: tuple[Handle | None, ...] = ()
    before: Extrapolation = "hold"
    after: Extrapolation = "hold"

    def at(self, time: float) -> Values:
        start, length = self.times[0], self.times[-1] - self.times[0]
        mode = self.before if time < start else self.after
        if length <= 0 or mode == "hold":
            return self._interpolated(time)
        rounds = math.floor((time - start + SAME_TIME) / length)
        if mode == "continue":
            return self._interpolated(time) if rounds == 0 else self._continued(time)
        passed = time - start - rounds * length
        if mode == "ping_pong":
            return self._interpolated(start + (length - passed if rounds % 2 else passed))
        values = self._interpolated(start + passed)
        if mode == "loop":
            return values
        gains = zip(values, self.values[0], self.values[-1], strict=True)
        return tuple(value + rounds * (last - first) for value, first, last in gains)

    def _interpolated(self, time: float) -> Values:
        """Return the values between two keys, or those of the nearest key outside of all."""
        i = bisect_right(self.times, time + SAME_TIME) - 1
        if i < 0:
            return self.values[0]
        if i == len(self.times) - 1:
            return self.values[i]
        start, end = self.values[i], self.values[i + 1]
        length = self.times[i + 1] - self.times[i]
        passed = min(max(time - self.times[i], 0.0), length)
        if self.eases[i] == BEZIER:
            return BezierSegment(length, start, end, self._handle(i, 1), self._handle(i + 1, -1)).at(passed)
        share = EASINGS[self.eases[i]](passed / length)
        return tuple(a + (b - a) * share for a, b in zip(start, end, strict=True))

    def _handle(self, i: int, side: int) -> Handle:
        """Return the handle of key `i`, right of it (1) or left of it (-1)."""
        drawn = self.right if side > 0 else self.left
        if drawn and (handle := drawn[i]) is not None:
            return handle
        third = (self.times[i + side] - self.times[i]) / 3.0
        slopes = automatic_slope(self.times, self.values, i)
        return Handle(third, tuple(slope * third for slope in slopes))

    def _continued(self, time: float) -> Values:
        """Return the values beyond the keys, along the line of the outermost segment."""
        end, side = (0, 1) if time < self.times[0] else (len(self.times) - 1, -1)
        ease = self.eases[end if side > 0 else end + side]
        along = Handle(
            self.times[end + side] - self.times[end],
            tuple(b - a for a, b in zip(self.values[end], self.values[end + side], strict=True)),
        )
        if ease == BEZIER and (handle := self._handle(end, side)).seconds != 0:
            along = handle
        factor = 0.0 if ease == "constant" else (time - self.times[end]) / along.seconds
        return tuple(a + factor * v for a, v in zip(self.values[end], along.values, strict=True))


def keyed(
    times: tuple[float, ...], values: tuple[float, ...] | tuple[Vector, ...], ease: str = "sine_in_out"
) -> Keyframes:
    """Return keyframes with one easing throughout: `keyed((0, 1, 3), (0, 4, 4))`."""
    rows = tuple(v if isinstance(v, tuple) else (float(v),) for v in values)
    return Keyframes(tuple(times), rows, (ease,) * len(rows))


@dataclass(frozen=True)
class BezierSegment:
    """The cubic curve from one key to the next.

    length  seconds between them
    right   the handle of the first key
    left    that of the second key

    Handles that together are longer than the segment would turn back in time: both are scaled down alike.
    """

    length: float
    start: Values
    end: Values
    right: Handle
    left: Handle

    def at(self, passed: float) -> Values:
        """Return the values `passed` seconds after the first key."""
        both = self.right.seconds - self.left.seconds
        factor = min(1.0, self.length / both) if both > 0 else 1.0
        right, left = self.right.scaled(factor), self.left.scaled(factor)
        s = _parameter(passed / self.length, right.seconds / self.length, 1.0 + left.seconds / self.length)
        rows = zip(self.start, self.end, right.values, left.values, strict=True)
        return tuple(_cubic(s, a, a + out, b + back, b) for a, b, out, back in rows)


def automatic_slope(times: Sequence[float], values: Sequence[Values], i: int) -> Values:
    """Return the slope per second at key `i` where no handle is given: Blender's *auto clamped*.

    It is level at the first key, the last, and at peaks and troughs; elsewhere along the line through both
    neighbours, but never so steep that the curve would pass one of them. With handles a third of the segment
    long, slopes up to three times those of the chords keep the curve monotone.

    Source: Fritsch, Carlson, *Monotone Piecewise Cubic Interpolation*, SIAM Journal on Numerical
    Analysis 17 (1980).
    """
    if i in (0, len(times) - 1):
        return (0.0,) * len(values[i])
    before, after = times[i] - times[i - 1], times[i + 1] - times[i]
    slopes = []
    for a, b, c in zip(values[i - 1], values[i], values[i + 1], strict=True):
        arriving, leaving = (b - a) / before, (c - b) / after
        if arriving * leaving <= 0:
            slopes.append(0.0)
            continue
        steepest = 3.0 * min(abs(arriving), abs(leaving))
        slopes.append(max(-steepest, min(steepest, (c - a) / (before + after))))
    return tuple(slopes)


def _parameter(share: float, first: float, second: float) -> float:
    """Return the parameter at which a cubic from 0 by two control points to 1 reaches `share`."""
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if _cubic(middle, 0.0, first, second, 1.0) < share:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def _cubic(s: float, a: float, b: float, c: float, d: float) -> float:
    """Evaluate a cubic in Bernstein's form."""
    r = 1.0 - s
    return r * r * r * a + 3.0 * s * r * (r * b + s * c) + s * s * s * d


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
