"""Curves that follow the level of a sound: base + gain × envelope."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from pipeline.arrays import Floats
from pipeline.flow.parameters import Curve, Values
from render.base.serialise import NOT_PLAIN

Normalisation = Literal["loudest", "full_scale"]

SILENT = 1e-4
"""The highest level (−80 dB) of a band that counts as silent: it is not raised to 1."""

DECIMALS = 6
"""Decimals of an envelope."""

_FADED = 14.0
"""Release times after which nothing is left of a level, to DECIMALS."""


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
    """

    digest: str
    band: tuple[float, float]
    attack: float
    release: float
    normalise: Normalisation
    interval: float = field(compare=False, repr=False, metadata=NOT_PLAIN)
    levels: tuple[float, ...] = field(compare=False, repr=False, metadata=NOT_PLAIN)

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
