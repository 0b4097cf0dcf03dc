"""Curves in time: keyframes with easings or Bézier handles, as in Blender, formulas, and their integrals."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from pipeline.arrays import Floats
from pipeline.flow.easing import BEZIER, EASINGS, BezierSegment, Handle, automatic_slope, kinks
from pipeline.flow.parameters import Curve, Number, Values, Vector, number_at
from pipeline.flow.sound_curve import SoundCurve
from pipeline.formula import TIME, Expression
from pipeline.formula.syntax import time_values

SAME_TIME = 1e-9
"""Seconds by which a sum of steps may miss the time of a key."""

Extrapolation = Literal["hold", "loop", "ping_pong", "offset", "continue"]


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

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:
        """The hash of all keys, computed once: integrals are cached by their curve."""
        return hash((self.times, self.values, self.eases, self.left, self.right, self.before, self.after))

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
        times = self.times
        i = bisect_right(times, time + SAME_TIME) - 1
        if i < 0:
            return self.values[0]
        if i == len(times) - 1:
            return self.values[i]
        start, end = self.values[i], self.values[i + 1]
        length = times[i + 1] - times[i]
        passed = min(max(time - times[i], 0.0), length)
        if self.eases[i] == BEZIER:
            return BezierSegment(length, start, end, self._handle(i, 1), self._handle(i + 1, -1)).at(passed)
        share = EASINGS[self.eases[i]](passed / length)
        if len(start) == 1:  # as below, without what takes longer than one number
            return (start[0] + (end[0] - start[0]) * share,)
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


PIECE = 0.5
"""Seconds: the longest interval that is integrated at once."""

INTEGRATION_NODES = 40
"""Nodes of the rule on each side of the middle of an interval."""

MARGIN = 2 * SAME_TIME
"""Seconds from the ends of an interval within which a key would count as reached."""


def elapsed(speed: Number, time: float) -> float:
    """Return the seconds that pass by `time` at a speed: its integral from 0.

    Between keys the error is about 1e-13 of the result. A formula is integrated by intervals of PIECE
    seconds, with a larger error where it has kinks within one. A key changes nothing before the previous key,
    unless the keys are repeated before the first. NaN where a key is at infinity, which no shot allows.
    """
    if not isinstance(speed, Curve):
        return speed * time
    if time < 0:
        return time * number_at(speed, 0.0)
    if isinstance(speed, SoundCurve):
        return speed.integral(time)
    if not isinstance(speed, Keyframes):
        return math.fsum(_integrals(speed, 0.0, time))
    first, last = speed.times[0], speed.times[-1]
    if not math.isfinite(last - first):
        return math.nan
    return math.fsum(
        [
            *_extrapolated(speed, speed.before, 0.0, min(first, time)),
            *_integrals(speed, max(first, 0.0), min(last, time)),
            *_extrapolated(speed, speed.after, max(last, 0.0), time),
        ]
    )


def _extrapolated(speed: Keyframes, mode: Extrapolation, start: float, end: float) -> list[float]:
    """Return summands of the integral from `start` to `end`, both before the first key or after the last.

    Whole rounds of the keys are integrated once, however many there are.
    """
    if not start < end:
        return []
    first, length = speed.times[0], speed.times[-1] - speed.times[0]
    if mode in ("hold", "continue") or not length > 0:  # the speed is a straight line
        return [(end - start) * number_at(speed, 0.5 * (start + end))]
    (n, since), (last, until) = (divmod(time - first, length) for time in (start, end))
    if n == last:
        return _round_integrals(speed, mode, n, since, until)
    parts = _round_integrals(speed, mode, n, since, length) + _round_integrals(speed, mode, last, 0.0, until)
    if (whole := last - n - 1) > 0:
        parts.append(whole * math.fsum(_round_integrals(speed, mode, 0.5 * (n + last), 0.0, length)))
    return parts


def _round_integrals(
    speed: Keyframes, mode: Extrapolation, n: float, since: float, until: float
) -> list[float]:
    """Return summands of the integral over the `n`th round, from `since` to `until` seconds into it.

    An offset grows by the same amount each round, so that the mean of several rounds is the middle one.
    """
    first, last = speed.times[0], speed.times[-1]
    if mode == "ping_pong" and n % 2:
        return _integrals(speed, last - until, last - since)
    gained = speed.values[-1][0] - speed.values[0][0] if mode == "offset" else 0.0
    return [*_integrals(speed, first + since, first + until), n * gained * (until - since)]


def _integrals(speed: Curve, start: float, end: float) -> list[float]:
    """Return integrals over smooth intervals between two times where keys are not repeated."""
    if not start < end:
        return []
    marks = {PIECE * i for i in range(math.ceil(start / PIECE), math.ceil(end / PIECE))}
    if isinstance(speed, Keyframes):
        inside = slice(max(0, bisect_right(speed.times, start) - 1), bisect_right(speed.times, end) + 1)
        marks |= set(speed.times[inside])
        for (a, b), ease in zip(pairwise(speed.times[inside]), speed.eases[inside], strict=False):
            marks |= {a + share * (b - a) for share in kinks(ease)}
    within = sorted(mark for mark in marks if start < mark < end)
    return [_integral(speed, a, b) for a, b in pairwise([start, *within, end])]


@lru_cache(maxsize=32768)
def _integral(speed: Curve, start: float, end: float) -> float:
    """Return the integral over one smooth interval, by a rule that tolerates infinite slopes at its ends.

    Source: Takahasi, Mori, *Double exponential formulas for numerical integration*, Publ. RIMS 9 (1974).
    """
    middle, half = 0.5 * (start + end), 0.5 * (end - start)
    margin = min(MARGIN, half)
    first, last = start + margin, end - margin
    speeds = [speed.at(min(max(middle + half * place, first), last))[0] for place, _ in _NODES]
    return half * _NODE_STEP * math.fsum(w * v for (_, w), v in zip(_NODES, speeds, strict=True))


def _nodes() -> Iterator[tuple[float, float]]:
    """Yield the places from −1 to 1, and the weights, of the rule's nodes."""
    for i in range(-INTEGRATION_NODES, INTEGRATION_NODES + 1):
        s = 0.5 * math.pi * math.sinh(i * _NODE_STEP)
        yield math.tanh(s), 0.5 * math.pi * math.cosh(i * _NODE_STEP) / math.cosh(s) ** 2


_NODE_STEP = 3.2 / INTEGRATION_NODES
_NODES = tuple(_nodes())
