"""Values in a genome: chance that repeats, numbers with keys, and parameters by what they mean.

Equal values of a parent stay equal in a child unless a mutation is about one of them. So the two vortices of
a pair stay a pair, a mirror image stays one, and flows that begin together begin together.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from flowsculpt.api.shots import is_number

STRENGTHS = ("strength", "rate", "speed", "amount", "flux", "inflow", "time_scale", "gain")
"""Parameters that say how strongly a flow acts."""

EXPONENTS = {"units²/s": 2, "units/s": 1, "units³/s": 3, "degrees/unit": -1, "1/unit": -1, "units": 1}
"""The power of a length in the unit of a parameter."""


def rounded(value: float, digits: int = 3) -> float | int:
    """Return a number with so many digits that count, whole where it is."""
    short = float(f"{value:.{digits}g}")
    return int(short) if short.is_integer() and abs(short) < 1e9 else short


def mapped(value: Any, change: Callable[[float, int], float]) -> Any:
    """Return a value with every number changed: constants, vectors, keys, and what follows a sound.

    change  gets a number and its place in a vector, 0 for scalars. Formulas and text stay
    """
    if is_number(value):
        return rounded(change(value, 0))
    if isinstance(value, list):
        return [rounded(change(item, k)) if is_number(item) else item for k, item in enumerate(value)]
    if isinstance(value, dict) and isinstance(value.get("keys"), dict):
        return {**value, "keys": {time: _key(item, change) for time, item in value["keys"].items()}}
    if isinstance(value, dict) and "audio" in value:
        return {**value, **{name: mapped(value[name], change) for name in ("base", "gain") if name in value}}
    return value


def scaled(value: Any, factor: float) -> Any:
    """Return a value with every number multiplied."""
    return mapped(value, lambda number, _: factor * number)


def _key(item: Any, change: Callable[[float, int], float]) -> Any:
    if isinstance(item, dict):
        kept = {name: part for name, part in item.items() if name not in ("left", "right")}
        return {**kept, "value": mapped(item["value"], change)}  # handles are in the unit of the old value
    return mapped(item, change)


def times_of(value: Any) -> tuple[int, ...] | None:
    """Return the times of keys that are whole frames; None for other values."""
    keys = value.get("keys") if isinstance(value, dict) else None
    if not isinstance(keys, dict) or not all(type(time) is int for time in keys):
        return None
    return tuple(keys)


def at_times(value: dict[str, Any], times: tuple[int, ...]) -> dict[str, Any]:
    """Return a value with its keys at other times."""
    return {**value, "keys": dict(zip(times, value["keys"].values(), strict=True))}


@dataclass
class Chance:
    """Random numbers that are the same on every machine, and remembers those that belong together.

    amount  0 to 1: how far a child may go from its parent
    """

    random: random.Random
    amount: float
    _known: dict[Any, float] = field(default_factory=dict)

    def spread(self, width: float) -> float:
        """Return a number around 0, mostly within `width`, seldom twice as far and never farther."""
        return width * max(-2.0, min(2.0, self.random.gauss(0.0, 0.75)))

    def factor(self, width: float) -> float:
        """Return a factor around 1 on a logarithmic scale: twice is as likely as half."""
        return math.exp(self.spread(width))

    def shared(self, key: Any, draw: Callable[[], float]) -> float:
        """Return the number that was drawn for a key; equal keys of a child share one."""
        if key not in self._known:
            self._known[key] = draw()
        return self._known[key]

    def happens(self, probability: float) -> bool:
        """Tell whether something with this probability happens."""
        return self.random.random() < probability

    def direction(self) -> list[float]:
        """Return a vector of length 1, all directions alike."""
        while True:
            x, y, z = (self.random.uniform(-1.0, 1.0) for _ in range(3))
            length = math.sqrt(x * x + y * y + z * z)
            if 0.1 < length <= 1.0:
                return [x / length, y / length, z / length]


AXES = {"x": [1.0, 0.0, 0.0], "y": [0.0, 1.0, 0.0], "z": [0.0, 0.0, 1.0]}


def vector_of(axis: Any) -> list[float]:
    """Return an axis of a shot file as a vector of length 1."""
    x, y, z = AXES[axis] if isinstance(axis, str) else map(float, axis)
    length = math.sqrt(x * x + y * y + z * z)
    return [x / length, y / length, z / length]


def turned(axis: Any, about: list[float], degrees: float) -> list[float | int]:
    """Return an axis turned about another by an angle (Rodrigues), with two decimals."""
    v, angle = vector_of(axis), math.radians(degrees)
    c, s = math.cos(angle), math.sin(angle)
    dot = sum(a * b for a, b in zip(about, v, strict=True))
    cross = [about[k - 2] * v[k - 1] - about[k - 1] * v[k - 2] for k in range(3)]
    return [rounded(round(c * v[k] + s * cross[k] + (1 - c) * dot * about[k], 2)) for k in range(3)]
