"""How parameters change in time: constants, or keyframes with easing."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass

from pipeline.flow.easing import EASINGS

Vector = tuple[float, float, float]

SAME_MOMENT = 1e-9
"""Seconds by which a sum of steps may miss the time of a key."""


@dataclass(frozen=True)
class Keyframes:
    """Values at times, and how to go from each to the next.

    times   seconds from the start of the shot, ascending
    values  one a time: numbers or vectors (all of one length)
    eases   one a time, names of EASINGS: how the value leaves that key; the last is unused

    Before the first key and after the last the value holds.
    """

    times: tuple[float, ...]
    values: tuple[tuple[float, ...], ...]
    eases: tuple[str, ...]

    def at(self, time: float) -> tuple[float, ...]:
        """The value at any time, between frames too."""
        i = bisect_right(self.times, time + SAME_MOMENT) - 1
        if i < 0:
            return self.values[0]
        if i == len(self.times) - 1:
            return self.values[i]
        here, there = self.values[i], self.values[i + 1]
        passed = (time - self.times[i]) / (self.times[i + 1] - self.times[i])
        share = EASINGS[self.eases[i]](min(max(passed, 0.0), 1.0))
        return tuple(a + (b - a) * share for a, b in zip(here, there, strict=True))


Number = float | Keyframes
"""A scalar parameter: constant or keyed."""

Place = Vector | Keyframes
"""A vector parameter: constant or keyed."""


def keyed(
    times: tuple[float, ...], values: tuple[float, ...] | tuple[Vector, ...], ease: str = "sine_in_out"
) -> Keyframes:
    """Keyframes with one easing throughout: `keyed((0, 1, 3), (0, 4, 4))`."""
    rows = tuple(v if isinstance(v, tuple) else (float(v),) for v in values)
    return Keyframes(tuple(times), rows, (ease,) * len(rows))


def number_at(parameter: Number, time: float) -> float:
    return parameter.at(time)[0] if isinstance(parameter, Keyframes) else parameter


def place_at(parameter: Place, time: float) -> Vector:
    if isinstance(parameter, Keyframes):
        x, y, z = parameter.at(time)
        return x, y, z
    return parameter
