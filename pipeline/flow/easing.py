"""Easing curves by name: the share of the way from one key to the next, from the share of the time.

The names are Blender's interpolation and easing types joined: `sine_in_out`. `in` starts slowly, `out`
ends slowly, `in_out` does both. Each maps 0 to 0 and 1 to 1. The formulas are Robert Penner's
(*Programming Macromedia Flash MX*, 2002, chapter 7).
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
    """2^(10 (s − 1)), shifted and scaled so that it starts at 0 and ends at 1 exactly."""
    return (math.exp2(10.0 * s) - 1.0) / 1023.0


def _circ(s: float) -> float:
    return 1.0 - math.sqrt(max(0.0, 1.0 - s * s))


def _back(s: float) -> float:
    """Swings back by a tenth first."""
    overshoot = 1.70158
    return s * s * ((overshoot + 1.0) * s - overshoot)


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
}

EASINGS: dict[str, Ease] = {
    "constant": lambda s: 1.0 if s >= 1.0 else 0.0,
    "linear": lambda s: s,
    **{f"{name}_in": ease for name, ease in _STARTS.items()},
    **{f"{name}_out": _reversed(ease) for name, ease in _STARTS.items()},
    **{f"{name}_in_out": _both(ease) for name, ease in _STARTS.items()},
}
