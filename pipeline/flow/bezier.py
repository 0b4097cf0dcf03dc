"""Bézier ways between keys, drawn by handles as in Blender's graph editor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

BEZIER = "bezier"
"""The easing whose way is drawn by handles."""

Values = tuple[float, ...]

HALVINGS = 60
"""After so many a share of time between 0 and 1 is known to its last bit."""


@dataclass(frozen=True)
class Handle:
    """The control point beside a key, as seen from it.

    seconds  0 or more right of the key, 0 or less left of it
    values   as many as the key has
    """

    seconds: float
    values: Values

    def shortened(self, factor: float) -> Handle:
        return Handle(self.seconds * factor, tuple(value * factor for value in self.values))


@dataclass(frozen=True)
class Way:
    """The cubic curve from one key to the next.

    length    seconds between them
    right     the handle of the first key
    left      that of the second

    Handles that together are longer than the way would turn back in time: both are shortened in proportion.
    """

    length: float
    start: Values
    end: Values
    right: Handle
    left: Handle

    def at(self, passed: float) -> Values:
        """The values `passed` seconds after the first key."""
        both = self.right.seconds - self.left.seconds
        factor = min(1.0, self.length / both) if both > 0 else 1.0
        right, left = self.right.shortened(factor), self.left.shortened(factor)
        s = _parameter(passed / self.length, right.seconds / self.length, 1.0 + left.seconds / self.length)
        rows = zip(self.start, self.end, right.values, left.values, strict=True)
        return tuple(_cubic(s, a, a + out, b + back, b) for a, b, out, back in rows)


def automatic(times: Sequence[float], values: Sequence[Values], i: int) -> Values:
    """The slope at key `i` where no handle is given, per second.

    It is level at the first key, the last, and at peaks and troughs; elsewhere along the line through both
    neighbours, but never so steep that the way would pass one of them (Blender's *auto clamped*).

    With handles a third of the way long, slopes up to three times those of the chords keep the way monotone.
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
    """Where a cubic over time, from 0 by two control points to 1, has come to that share."""
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if _cubic(middle, 0.0, first, second, 1.0) < share:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def _cubic(s: float, a: float, b: float, c: float, d: float) -> float:
    """Bernstein's cubic."""
    r = 1.0 - s
    return r * r * r * a + 3.0 * s * r * (r * b + s * c) + s * s * s * d
