"""Time that runs at a speed of its own: how much of it has passed is the integral of the speed."""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise

from pipeline.flow.easing import kinks
from pipeline.flow.keyframes import SAME_MOMENT, Beyond, Curve, Keyframes, Number, number_at

PIECE = 0.5
"""Seconds: the longest piece that is integrated at once."""

HALF = 40
"""Nodes of the rule on each side of the middle of a piece."""


def elapsed(speed: Number, time: float) -> float:
    """Seconds that have passed by `time` at a speed: its integral from 0.

    Between keys it errs by about 1e-13 of the result. A formula is integrated by pieces of PIECE seconds, and
    errs more where it has kinks within one. A key changes nothing before the key before it, save where the
    keys are repeated before the first of them. NaN where a key is at infinity: no shot lets it be.
    """
    if not isinstance(speed, Curve):
        return speed * time
    if time < 0:
        return time * number_at(speed, 0.0)
    if not isinstance(speed, Keyframes):
        return math.fsum(_pieces(speed, 0.0, time))
    first, last = speed.times[0], speed.times[-1]
    if not math.isfinite(last - first):
        return math.nan
    return math.fsum(
        [
            *_beyond(speed, speed.before, 0.0, min(first, time)),
            *_pieces(speed, max(first, 0.0), min(last, time)),
            *_beyond(speed, speed.after, max(last, 0.0), time),
        ]
    )


def _beyond(speed: Keyframes, mode: Beyond, start: float, end: float) -> list[float]:
    """What the integral from `start` to `end` is the sum of, both before the first key or after the last.

    Whole rounds of the keys are integrated once, however many there are.
    """
    if not start < end:
        return []
    first, length = speed.times[0], speed.times[-1] - speed.times[0]
    if mode in ("hold", "continue") or not length > 0:  # the speed is a straight line
        return [(end - start) * number_at(speed, 0.5 * (start + end))]
    (n, since), (last, until) = (divmod(time - first, length) for time in (start, end))
    if n == last:
        return _of_round(speed, mode, n, since, until)
    parts = _of_round(speed, mode, n, since, length) + _of_round(speed, mode, last, 0.0, until)
    if (whole := last - n - 1) > 0:
        parts.append(whole * math.fsum(_of_round(speed, mode, 0.5 * (n + last), 0.0, length)))
    return parts


def _of_round(speed: Keyframes, mode: Beyond, n: float, since: float, until: float) -> list[float]:
    """The same of the `n`th round, from `since` seconds after it began to `until`.

    What an offset adds is as much more each round, so that the mean of several is that of the middle one.
    """
    first, last = speed.times[0], speed.times[-1]
    if mode == "ping_pong" and n % 2:
        return _pieces(speed, last - until, last - since)
    gained = speed.values[-1][0] - speed.values[0][0] if mode == "offset" else 0.0
    return [*_pieces(speed, first + since, first + until), n * gained * (until - since)]


def _pieces(speed: Curve, start: float, end: float) -> list[float]:
    """Integrals over the pieces between two times, where keys are not repeated; they are smooth within."""
    if not start < end:
        return []
    marks = {PIECE * i for i in range(math.ceil(start / PIECE), math.ceil(end / PIECE))}
    if isinstance(speed, Keyframes):
        marks |= set(speed.times)
        for (a, b), ease in zip(pairwise(speed.times), speed.eases, strict=False):
            marks |= {a + share * (b - a) for share in kinks(ease)}
    within = sorted(mark for mark in marks if start < mark < end)
    return [_piece(speed, a, b) for a, b in pairwise([start, *within, end])]


ASIDE = 2 * SAME_MOMENT
"""Seconds from the ends of a piece: nearer, a key would be taken for reached."""


@lru_cache(maxsize=4096)
def _piece(speed: Curve, start: float, end: float) -> float:
    """The integral over a piece that is smooth within.

    The rule does not mind infinite slopes at the ends. Source: Takahasi, Mori, *Double exponential formulas
    for numerical integration*, Publ. RIMS 9 (1974).
    """
    middle, half, step = 0.5 * (start + end), 0.5 * (end - start), 3.2 / HALF
    aside, parts = min(ASIDE, half), []
    for i in range(-HALF, HALF + 1):
        s = 0.5 * math.pi * math.sinh(i * step)
        weight = 0.5 * math.pi * math.cosh(i * step) / math.cosh(s) ** 2
        time = middle + half * math.tanh(s)
        parts.append(weight * number_at(speed, min(max(time, start + aside), end - aside)))
    return half * step * math.fsum(parts)
