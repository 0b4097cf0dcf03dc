"""Curves from a key to the next: easings by name, and Bézier segments with handles.

An easing maps the share of the time between two keys to the share of the change.

The names are Blender's interpolation and easing types joined: `sine_in_out`. `in` starts slowly, `out`
ends slowly, `in_out` does both. Each maps 0 to 0 and 1 to 1. The formulas are Robert Penner's
(*Programming Macromedia Flash MX*, 2002, chapter 7). Blender's `bezier` has handles and
is a `BezierSegment`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pipeline.flow.parameters import Values

Ease = Callable[[float], float]

BEZIER = "bezier"
"""The easing whose curve is drawn by handles."""

BISECTIONS = 60
"""After so many a number between 0 and 1 is exact to the last bit."""


def _power(exponent: int) -> Ease:
    return lambda s: math.pow(s, exponent)


def _sine(s: float) -> float:
    return 1.0 - math.cos(s * math.pi / 2)


def _expo(s: float) -> float:
    """Return 2^(10 (s − 1)), shifted and scaled so that it starts at 0 and ends at 1 exactly."""
    return (math.exp2(10.0 * s) - 1.0) / 1023.0


def _circ(s: float) -> float:
    return 1.0 - math.sqrt(max(0.0, 1.0 - s * s))


def _back(s: float) -> float:
    """Swing back by a tenth first."""
    overshoot = 1.70158
    return s * s * ((overshoot + 1.0) * s - overshoot)


def _bounce(s: float) -> float:
    """Bounce like a dropped ball seen backwards: four parabolas, the last hop the highest."""
    left = (1.0 - s) * 2.75
    for start, middle, height in _HOPS:
        if left >= start:
            return height - (left - middle) ** 2
    raise AssertionError("the hops begin at 0")


_HOPS = ((2.5, 2.625, 1 / 64), (2.0, 2.25, 1 / 16), (1.0, 1.5, 1 / 4), (0.0, 0.0, 1.0))
"""The start, middle and height of each hop of a bounce that lasts 2.75."""


def _elastic(s: float) -> float:
    """Swing with growing amplitude, three and a third times, like a released spring seen backwards.

    The amplitude is that of `_expo`, which starts at 0; Penner's starts a two-thousandth off.
    """
    return _expo(s) * math.cos((s - 1.0) * 2 * math.pi / 0.3)


def _reversed(ease: Ease) -> Ease:
    return lambda s: 1.0 - ease(1.0 - s)


def _both(ease: Ease) -> Ease:
    return lambda s: 0.5 * ease(2.0 * s) if s < 0.5 else 1.0 - 0.5 * ease(2.0 - 2.0 * s)


_STARTS: dict[str, Ease] = {
    "sine": _sine,
    "quad": _power(2),
    "cubic": _power(3),
    "quart": _power(4),
    "quint": _power(5),
    "expo": _expo,
    "circ": _circ,
    "back": _back,
    "bounce": _bounce,
    "elastic": _elastic,
}

EASINGS: dict[str, Ease] = {
    "constant": lambda s: 1.0 if s >= 1.0 else 0.0,
    "linear": lambda s: s,
    **{f"{name}_in": ease for name, ease in _STARTS.items()},
    **{f"{name}_out": _reversed(ease) for name, ease in _STARTS.items()},
    **{f"{name}_in_out": _both(ease) for name, ease in _STARTS.items()},
}


def kinks(name: str) -> tuple[float, ...]:
    """Return the shares of time between 0 and 1 at which an easing is not smooth, ascending."""
    family, _, direction = name.partition("_")
    hops = [1.0 - start / 2.75 for start, _, _ in _HOPS[:3]] if family == "bounce" else []
    if direction == "out":
        hops = [1.0 - s for s in hops]
    if direction == "in_out":
        hops = [0.5, *(0.5 * s for s in hops), *(1.0 - 0.5 * s for s in hops)]
    return tuple(sorted(hops))


@dataclass(frozen=True)
class Handle:
    """The control point of a key, relative to it.

    seconds  0 or more right of the key, 0 or less left of it
    values   as many as the key has
    """

    seconds: float
    values: Values

    def scaled(self, factor: float) -> Handle:
        return Handle(self.seconds * factor, tuple(value * factor for value in self.values))


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
