"""Easings, which map the share of the time from a key to the next to the share of the change.

They have the names of Blender's interpolation and easing types joined: `sine_in_out`. `in` starts slowly,
`out` ends slowly, `in_out` does both. Each maps 0 to 0 and 1 to 1. The formulas are Robert Penner's
(*Programming Macromedia Flash MX*, 2002, chapter 7). `settle`, `drop` and `drag` are ours, for heavy things.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

Ease = Callable[[float], float]


def _expo(s: float) -> float:
    """Return 2^(10 (s − 1)), shifted and scaled so that it starts at 0 and ends at 1 exactly."""
    return (math.exp2(10.0 * s) - 1.0) / 1023.0


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


def _settle(overshoot: float) -> Ease:
    """Return a damped spring from rest: it passes its goal by a share of the way, swings and rests.

    The factor (1 − s²)² lets it rest at s = 1, and is level at s = 0. The first peak is at about 1/3, where
    the spring has made half of a swing.
    """
    turn = 3.0 * math.pi
    damping = 3.0 * math.log((8.0 / 9.0) ** 2 / overshoot)

    def ease(s: float) -> float:
        swing = math.cos(turn * s) + damping / turn * math.sin(turn * s)
        return 1.0 - (1.0 - s * s) ** 2 * math.exp(-damping * s) * swing

    return ease


LOWEST_HOP = 0.002  # of the height of the fall: lower hops are not seen


def _hops(restitution: float) -> list[tuple[float, float]]:
    """Return the start and the length of a fall, with the half before s = 0, and of each hop that follows.

    After each touch a ball keeps a share of its speed, `restitution`: the next hop lasts as much shorter.
    """
    lengths = [2.0]
    while (next_length := lengths[-1] * restitution) ** 2 > 4.0 * LOWEST_HOP:
        lengths.append(next_length)
    whole, hops = sum(lengths) - 1.0, [(-1.0, 2.0)]
    for length in lengths[1:]:
        hops.append((sum(hops[-1]), length))
    return [(start / whole, length / whole) for start, length in hops]


def _drop(restitution: float) -> Ease:
    """Return a fall by gravity from rest, with bounces that get lower."""
    (_, fall), *rebounds = _hops(restitution)
    gravity = 4.0 / fall**2

    def ease(s: float) -> float:
        for start, length in reversed(rebounds):
            if s >= start:
                passed = min(s - start, length)
                return 1.0 - gravity * passed * (length - passed)
        return gravity * s * s

    return ease


def _drag(middle: float) -> Ease:
    """Return a slow start that catches up: half of the way is made at the share `middle` of the time."""

    def ease(s: float) -> float:
        warped = s * (1.0 - middle) / (s * (1.0 - middle) + middle * (1.0 - s))
        return warped * warped * (3.0 - 2.0 * warped)

    return ease


_STARTS: dict[str, Ease] = {
    "sine": lambda s: 1.0 - math.cos(s * math.pi / 2),
    "quad": lambda s: math.pow(s, 2),
    "cubic": lambda s: math.pow(s, 3),
    "quart": lambda s: math.pow(s, 4),
    "quint": lambda s: math.pow(s, 5),
    "expo": _expo,
    "circ": lambda s: 1.0 - math.sqrt(max(0.0, 1.0 - s * s)),
    "back": _back,
    "bounce": _bounce,
    "elastic": _elastic,
}

HAND_EASES: dict[str, tuple[Callable[[float], Ease], float, float, float]] = {
    "settle": (_settle, 0.15, 0.01, 0.6),
    "drop": (_drop, 0.3, 0.0, 0.8),
    "drag": (_drag, 0.7, 0.5, 0.95),
}
"""Eases of heavy things, which take a number: what makes one, and the number's default, least and most."""

EASINGS: dict[str, Ease] = {
    "constant": lambda s: 1.0 if s >= 1.0 else 0.0,
    "linear": lambda s: s,
    **{f"{name}_in": ease for name, ease in _STARTS.items()},
    **{f"{name}_out": _reversed(ease) for name, ease in _STARTS.items()},
    **{f"{name}_in_out": _both(ease) for name, ease in _STARTS.items()},
    **{name: make(default) for name, (make, default, *_) in HAND_EASES.items()},
}


@cache
def easing(name: str) -> Ease:
    """Return the easing of a name, which for those of HAND_EASES may end with their number: `settle 0.3`."""
    word, _, number = name.partition(" ")
    return HAND_EASES[word][0](float(number)) if number else EASINGS[word]


def kinks(name: str) -> tuple[float, ...]:
    """Return the shares of time between 0 and 1 at which an easing is not smooth, ascending."""
    if name.startswith("drop"):
        _, *rebounds = _hops(float(name[5:] or HAND_EASES["drop"][1]))
        return tuple(start for start, _ in rebounds)
    family, _, direction = name.partition("_")
    hops = [1.0 - start / 2.75 for start, _, _ in _HOPS[:3]] if family == "bounce" else []
    if direction == "out":
        hops = [1.0 - s for s in hops]
    if direction == "in_out":
        hops = [0.5, *(0.5 * s for s in hops), *(1.0 - 0.5 * s for s in hops)]
    return tuple(sorted(hops))
