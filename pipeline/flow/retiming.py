"""Time that runs at a speed of its own: how much of it has passed is the integral of the speed."""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise

from pipeline.flow.choreography import SAME_MOMENT, Curve, Keyframes, Number, number_at
from pipeline.flow.easing import kinks

PIECE = 0.5
"""Seconds: the longest piece that is integrated at once."""

HALF = 40
"""Nodes of the rule on each side of the middle of a piece."""


def elapsed(speed: Number, time: float) -> float:
    """Seconds that have passed by `time` at a speed: its integral from 0.

    Between keys it errs by about 1e-13 of the result. A formula is integrated by pieces of PIECE seconds, and
    errs more where it has kinks within one. A key changes nothing before the key before it.
    """
    if not isinstance(speed, Curve):
        return speed * time
    if time < 0:
        return time * number_at(speed, 0.0)
    marks = [0.0, *(mark for mark in _marks(speed, time) if 0.0 < mark < time), time]
    return math.fsum(_piece(speed, start, end) for start, end in pairwise(marks))


def _marks(speed: Curve, until: float) -> list[float]:
    """Where the speed may not be smooth, and enough of others that pieces are short; ascending."""
    marks = {PIECE * i for i in range(1, int(until / PIECE) + 1)}
    if isinstance(speed, Keyframes):
        within = set(speed.times)
        for (a, b), ease in zip(pairwise(speed.times), speed.eases, strict=False):
            within |= {a + share * (b - a) for share in kinks(ease)}
        marks |= _in_all_rounds(within, speed.times[0], speed.times[-1], until)
    return sorted(marks)


def _in_all_rounds(marks: set[float], start: float, end: float, until: float) -> set[float]:
    """The marks between two times, and where they come again in rounds there and back after these."""
    length = end - start
    if length <= 0:
        return marks
    rounds = range(-math.ceil(start / length), math.ceil((until - start) / length) + 1)
    there = {mark + n * length for mark in marks for n in rounds}
    return there | {start + end - mark + n * length for mark in marks for n in rounds}


ASIDE = 2 * SAME_MOMENT
"""Seconds from the ends of a piece: nearer, a key would be taken for reached."""


@lru_cache(maxsize=4096)
def _piece(speed: Curve, start: float, end: float) -> float:
    """The integral over a piece that is smooth within.

    The rule does not mind infinite slopes at the ends. Source: Takahasi, Mori, *Double exponential formulas
    for numerical integration*, Publ. RIMS 9 (1974).
    """
    middle, half, step = 0.5 * (start + end), 0.5 * (end - start), 3.2 / HALF
    parts = []
    for i in range(-HALF, HALF + 1):
        s = 0.5 * math.pi * math.sinh(i * step)
        weight = 0.5 * math.pi * math.cosh(i * step) / math.cosh(s) ** 2
        time = middle + half * math.tanh(s)
        parts.append(weight * number_at(speed, min(max(time, start + ASIDE), end - ASIDE)))
    return half * step * math.fsum(parts)
