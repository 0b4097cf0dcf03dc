"""Curves in time: keyframes as in Blender, formulas, curves that follow a sound, and their integrals.

From a key to the next a value follows an easing (see `easings`), or a Bézier segment with handles.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import ClassVar, Literal

import numpy as np

from flowsculpt.pipeline.arrays import Floats
from flowsculpt.pipeline.flow.easings import EASINGS, easing, kinks
from flowsculpt.pipeline.flow.parameters import Curve, Number, Values, Vector, number_at
from flowsculpt.pipeline.formula import TIME, Expression, time_values
from flowsculpt.render.base.serialise import NOT_PLAIN, OMIT_DEFAULT

BEZIER = "bezier"  # the easing whose curve is drawn by handles
BISECTIONS = 60  # after so many a number between 0 and 1 is exact to the last bit


@dataclass(frozen=True)
class Handle:
    """The control point of a key, relative to it.

    seconds  0 or more right of the key, 0 or less left of it
    values   as many as the key has
    """

    seconds: float
    values: Values


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
        first, second = self.right.seconds * factor / self.length, self.left.seconds * factor / self.length
        s = _parameter(passed / self.length, first, 1.0 + second)
        rows = zip(self.start, self.end, self.right.values, self.left.values, strict=True)
        return tuple(_cubic(s, a, a + out * factor, b + back * factor, b) for a, b, out, back in rows)


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


Normalisation = Literal["loudest", "full_scale"]

SILENT = 1e-4  # the highest level (−80 dB) of a band that counts as silent: it is not raised to 1
DECIMALS = 6  # decimals of an envelope
_FADED = 14.0  # release times after which nothing is left of a level, to DECIMALS


@dataclass(frozen=True)
class Envelope:
    """The level of a band of a sound over time, which rises by `attack` and falls by `release`.

    Equal contents of sound files and equal settings are equal envelopes, wherever the file lies.

    digest     SHA-256 of the sound file
    band       from and to, Hz
    attack     seconds in which it rises by 63 % of a step; 0 at once
    release    seconds in which it falls by 63 % of a step; 0 at once
    normalise  loudest: its highest value is 1; full_scale: 1 is a sine of full scale
    interval   seconds between levels
    levels     from the beginning of the sound on, at least 0
    silence    seconds that timestamps in the file leave empty
    """

    digest: str
    band: tuple[float, float]
    attack: float
    release: float
    normalise: Normalisation
    interval: float = field(compare=False, repr=False, metadata=NOT_PLAIN)
    levels: tuple[float, ...] = field(compare=False, repr=False, metadata=NOT_PLAIN)
    silence: float = field(default=0.0, repr=False, metadata=OMIT_DEFAULT)

    @property
    def is_silent(self) -> bool:
        """True if the band never exceeds SILENT."""
        return max(self.levels, default=0.0) <= SILENT

    @cached_property
    def values(self) -> tuple[float, ...]:
        """The values at multiples of the interval; 0 before and after."""
        rise, fall = (_share(self.interval, seconds) for seconds in (self.attack, self.release))
        value, found = 0.0, []
        for level in (*self.levels, *[0.0] * math.ceil(_FADED * self.release / self.interval), 0.0):
            value += (level - value) * (rise if level > value else fall)
            found.append(value)
        highest = 1.0 if self.normalise == "full_scale" else max(found)
        if self.is_silent and self.normalise == "loudest":
            return (0.0,) * len(found)
        return tuple(round(value / highest, DECIMALS) for value in found)

    @cached_property
    def _integrals(self) -> Floats:
        """The integral (N,) from the beginning of the sound up to each value, seconds."""
        values = np.array(self.values)
        return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1])) * self.interval])

    def at(self, seconds: float) -> float:
        """Return the value at a time of the sound, between values linearly."""
        place = seconds / self.interval
        i = math.floor(place)
        if not 0 <= i < len(self.values) - 1:
            return 0.0
        share = place - i
        return self.values[i] * (1.0 - share) + self.values[i + 1] * share

    def integral(self, seconds: float) -> float:
        """Return the integral from the beginning of the sound up to a time, in seconds."""
        place = seconds / self.interval
        i = math.floor(place)
        if i < 0:
            return 0.0
        if i >= len(self.values) - 1:
            return float(self._integrals[-1])
        part = 0.5 * (self.values[i] + self.at(seconds)) * (place - i) * self.interval
        return float(self._integrals[i]) + part


def _share(interval: float, seconds: float) -> float:
    """Return the share of a step that is made in an interval, of an exponential of `seconds`."""
    return 1.0 if seconds <= 0 else -math.expm1(-interval / seconds)


@dataclass(frozen=True)
class SoundCurve(Curve):
    """Values that follow an envelope: base + gain × envelope.

    start       seconds of the shot at which the sound begins; below 0, so much of its beginning is left out
    base, gain  as many as values
    """

    envelope: Envelope
    start: float
    base: Values
    gain: Values

    def at(self, time: float) -> Values:
        level = self.envelope.at(time - self.start)
        return tuple(base + gain * level for base, gain in zip(self.base, self.gain, strict=True))

    def over(self, times: Iterable[float]) -> Floats:
        """Return the values (T, K) at many times."""
        return np.array([self.at(time) for time in times])

    def times(self, last: float) -> list[float]:
        """Return the times, from 0 to `last` seconds, between which the values change linearly."""
        interval, count = self.envelope.interval, len(self.envelope.values)
        first = max(0, math.ceil(-self.start / interval))
        end = min(count, math.floor((last - self.start) / interval) + 1)
        return [0.0, *(self.start + i * interval for i in range(first, end)), last]

    def integral(self, time: float) -> float:
        """Return the integral of the first value from 0 to a time, exact to rounding."""
        heard = self.envelope.integral(time - self.start) - self.envelope.integral(-self.start)
        return self.base[0] * time + self.gain[0] * heard


SAME_TIME = 1e-9  # seconds by which a sum of steps may miss the time of a key

Extrapolation = Literal["hold", "loop", "ping_pong", "offset", "continue"]


@dataclass(frozen=True)
class Keyframes(Curve):
    """Values at times, with an easing from each to the next.

    times   seconds from the start of the shot, ascending
    values  one a time: numbers or vectors (all of one length)
    eases   one a time, some of EASE_NAMES: how the value leaves that key; the last is unused
    left    handles left of the keys, for bezier; None is automatic (see `automatic_slope`)
    right   handles right of the keys, likewise
    before  the extrapolation before the first key:
            hold, the first value; continue, on along the last chord (for bezier along the handle);
            loop, all keys again, the last key at the time of the first; ping_pong, forwards and backwards;
            offset, again, each round starting at the value where the last one ended
    after   the extrapolation after the last key
    """

    EASE_NAMES: ClassVar[tuple[str, ...]] = (*EASINGS, BEZIER)
    """The names of easings; a `bezier` is drawn by handles."""

    times: tuple[float, ...]
    values: tuple[Values, ...]
    eases: tuple[str, ...]
    left: tuple[Handle | None, ...] = ()
    right: tuple[Handle | None, ...] = ()
    before: Extrapolation = "hold"
    after: Extrapolation = "hold"

    def __hash__(self) -> int:
        return self._hash  # computed once: integrals are cached by their curve

    @cached_property
    def _hash(self) -> int:
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
        share = easing(self.eases[i])(passed / length)
        if len(start) == 1:  # as below, but faster
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
    """Return keyframes with one easing throughout, such as `keyed((0, 1, 3), (0, 4, 4))`.

    times   seconds from the start, ascending
    values  one a time: numbers, or vectors as tuples; a parameter of a flow takes them in place of a number
    ease    a name of EASINGS, such as "linear", "cubic_in" or "sine_in_out"
    """
    rows = tuple(v if isinstance(v, tuple) else (float(v),) for v in values)
    return Keyframes(tuple(times), rows, (ease,) * len(rows))


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

    def __post_init__(self) -> None:
        assert self._expressions, "they are checked now, not when the first frame is made"

    @cached_property
    def _expressions(self) -> tuple[Expression, ...]:
        return tuple(Expression(text, TIME) for text in self.texts)

    def at(self, time: float) -> Values:
        """Return the values at a time. Raises UsageError where a formula is not finite."""
        return tuple(self.over([time])[0].tolist())

    def over(self, times: Iterable[float]) -> Floats:
        """Return the values (T, K) at many times. Raises UsageError with the first that is not finite."""
        seconds = np.fromiter(times, np.float64)
        now = time_values(Expression.frame_at(seconds, self.fps, self.first), seconds)
        columns = [formula(**now) for formula in self._expressions]
        return self.unit * np.stack(columns, axis=1)


PIECE = 0.5  # seconds: the longest interval that is integrated at once
INTEGRATION_NODES = 40  # nodes of the rule on each side of the middle of an interval
MARGIN = 2 * SAME_TIME  # seconds from the ends of an interval within which a key would count as reached


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
