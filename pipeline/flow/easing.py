"""Easing curves by name: the share of the change between two keys, from the share of the time.

The names are Blender's interpolation and easing types joined: `sine_in_out`. `in` starts slowly, `out`
ends slowly, `in_out` does both. Each maps 0 to 0 and 1 to 1. The formulas are Robert Penner's
(*Programming Macromedia Flash MX*, 2002, chapter 7). Blender's `bezier` has handles and
is not an easing: see `keyframes.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable

Ease = Callable[[float], float]


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

OVERSHOOTING = frozenset(name for name in EASINGS if name.startswith(("back", "elastic")))
"""The easings that leave the range between the two keys."""


def kinks(name: str) -> tuple[float, ...]:
    """Return the shares of time between 0 and 1 at which an easing is not smooth, ascending."""
    family, _, direction = name.partition("_")
    hops = [1.0 - start / 2.75 for start, _, _ in _HOPS[:3]] if family == "bounce" else []
    if direction == "out":
        hops = [1.0 - s for s in hops]
    if direction == "in_out":
        hops = [0.5, *(0.5 * s for s in hops), *(1.0 - 0.5 * s for s in hops)]
    return tuple(sorted(hops))
