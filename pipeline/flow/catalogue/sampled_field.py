"""Velocities by samples on a grid."""

from __future__ import annotations

import hashlib
import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Floats
from flowsculpt.pipeline.flow.kernels import external_kernels as kernels
from flowsculpt.pipeline.flow.parameters import (
    ORIGIN,
    Number,
    ParameterDoc,
    PositiveNumber,
    VectorParameter,
    number_at,
    vector_at,
)
from flowsculpt.pipeline.flow.velocity import ExternalField, Program, StableProperty
from flowsculpt.pipeline.kernels import BlockKernel

Outside = Literal["clamp", "zero", "repeat"]

_OUTSIDE = {"clamp": kernels.CLAMP, "zero": kernels.ZERO, "repeat": kernels.REPEAT}

CUBIC_OVERSHOOT = 1.5 * 1.25**2
"""The bound of a Catmull-Rom gradient over the largest secant nearby: its slope is at most 1.5 secants along
an axis; across, in each of two directions, the absolute values of its weights add up to at most 1.25. Exact
on evenly spaced axes."""


FLAT, SPHERE, SPHERE_SURFACE, TURNED = range(4)
"""What axes measure: positions x, y, z; longitude, latitude (radians) and distance from the centre; the same
with velocities along the sphere alone; positions along other directions."""


class Samples(ABC):
    """Velocities at the nodes of a grid, at one time or several, of which only those that are used are read.

    axes      three float64 arrays, each ascending and of two numbers or more
    times     (T,) seconds, ascending
    array     the name of the velocities in files; None: the only ones there
    geometry  FLAT, SPHERE, SPHERE_SURFACE or TURNED
    turn      (3, 3) with the directions of the axes as columns, of length 1; None where they are x, y, z
    is_single True if velocities are float32
    is_paced  True if velocities are lengths per second of the samples: with more of these in a second of the
              shot, all moves faster
    metre     the length of a metre in the grid, where that is known
    is_large  True if memory has room for the times of a step alone
    surface   dimension of depths in files, and the index nearest the surface; None without depths
    """

    axes: tuple[Floats, Floats, Floats]
    times: Floats
    array: str | None
    geometry: int = FLAT
    turn: Floats | None = None
    is_single: bool = False
    is_paced: bool = False
    metre: float | None = None
    is_large: bool = False
    surface: tuple[str, int] | None = None

    def date(self, seconds: float) -> str:
        """Return the date and time at seconds of the samples; empty where they have none."""
        return ""

    @property
    def period(self) -> float:
        """Seconds after which the first time comes again, where samples repeat: by default at the last."""
        return float(self.times[-1] - self.times[0])

    @staticmethod
    def of_arrays(
        axes: tuple[Floats, Floats, Floats],
        times: Floats,
        velocity: Floats,
        digests: tuple[str, ...],
        array: str | None = None,
        interval: float = 1.0,
        turn: Floats | None = None,
    ) -> ArraySamples:
        """Return samples in memory.

        velocity  float64 (T, X, Y, Z, 3)
        digests   SHA-256 of each file: of one with all times, or of one for each time
        interval  seconds from file to file
        """
        return ArraySamples(axes, times, velocity, digests, array, interval, turn)

    @abstractmethod
    def velocities(self, index: int) -> AnyArray:
        """Return velocities (X, Y, Z, 3) at a time, float64 or float32, in C order."""

    @abstractmethod
    def digest(self, index: int) -> str:
        """Return the digest of everything that decides the velocities at a time."""

    def slopes(self, index: int) -> Floats:
        """Return the largest secants (3,) along the axes at a time, 1/s."""
        velocity = self.velocities(index)
        return np.array([_largest_secant(velocity, axis, k) for k, axis in enumerate(self.axes)])

    @cached_property
    def spacing(self) -> float:
        """The shortest distance of two nodes."""
        return min(float(np.diff(axis).min()) for axis in self.axes)

    @cached_property
    def known_slopes(self) -> dict[int, Floats]:
        """The slopes of the times that were asked for."""
        return {}


@dataclass(frozen=True)
class ArraySamples(Samples):
    """Samples in memory: equal contents of files, equal samples."""

    axes: tuple[Floats, Floats, Floats] = field(compare=False, repr=False)
    times: Floats = field(compare=False, repr=False)
    velocity: Floats = field(compare=False, repr=False)
    digests: tuple[str, ...]
    array: str | None = None
    interval: float = 1.0
    turn: Floats | None = field(default=None, compare=False, repr=False)

    @property
    def geometry(self) -> int:  # type: ignore[override]
        return FLAT if self.turn is None else TURNED

    def velocities(self, index: int) -> AnyArray:
        return self.velocity[index]

    def digest(self, index: int) -> str:
        own = self.digests[index if len(self.digests) > 1 else 0]
        return hashlib.sha256(own.encode()).hexdigest()


class _Address:
    """The address of the velocities at a time: they are read when a table takes it, and kept from then on."""

    def __init__(self, samples: Samples, index: int) -> None:
        self._samples, self._index = samples, index

    @cached_property
    def _velocities(self) -> AnyArray:
        return self._samples.velocities(self._index)

    def __float__(self) -> float:
        return float(self._velocities.ctypes.data)


@dataclass(frozen=True)
class Sampled(ExternalField):
    """Velocities at the points of a grid, from files, interpolated between.

    A point p of the scene reads the samples at (p − centre) / scale, and moves `scale` times as fast: the
    field is placed and scaled like an object.

    `linear` interpolates along each axis; `cubic` is a Catmull-Rom spline, whose velocity has no kinks.
    `clamp` takes the nearest point inside; to `repeat`, the last sample must equal the first. Velocities are
    blended between times.
    """

    block: ClassVar[BlockKernel] = kernels.sampled

    samples: Samples
    between: Annotated[Literal["linear", "cubic"], ParameterDoc("interpolation between samples")] = "linear"
    outside: Annotated[Outside, ParameterDoc("velocity outside of the grid")] = "clamp"
    centre: Annotated[VectorParameter, ParameterDoc("position of the grid's origin", "units")] = ORIGIN
    scale: Annotated[PositiveNumber, ParameterDoc("units of the scene per unit of the grid")] = 1.0
    strength: Annotated[Number, ParameterDoc("factor on the velocities")] = 1.0
    time_scale: Annotated[float, ParameterDoc("seconds of the samples per second of the shot")] = 1.0
    start: Annotated[float, ParameterDoc("of the samples when the shot starts", "s")] = 0.0
    loop: Annotated[bool, ParameterDoc("repeat after the last time; else its samples stay")] = False

    @StableProperty
    def _memory(self) -> Floats:
        samples = self.samples
        header = [*map(len, samples.axes), self.between == "cubic", _OUTSIDE[self.outside]]
        header += [samples.is_single, samples.geometry]
        turn = () if samples.turn is None else samples.turn.ravel()
        return np.concatenate([np.array(header, np.float64), *samples.axes, turn])

    def seconds(self, time: float) -> float:
        """Return the seconds of the samples at a time, from the first time on, within their period."""
        times = self.samples.times
        now, first, last = self.start + self.time_scale * time, float(times[0]), float(times[-1])
        if self.loop and last > first:
            return float(first + (now - first) % self.samples.period)
        return min(max(now, first), last)

    def moment(self, time: float) -> tuple[int, int, float]:
        """Return the indices of the samples before and after a time, and the share of the latter."""
        times, now = self.samples.times, self.seconds(time)
        i = int(np.searchsorted(times, now + self._near, side="right")) - 1
        if now <= times[i] + self._near:
            return i, i, 0.0
        if i + 1 == len(times):  # before the first comes again
            return i, 0, float((now - times[i]) / (times[0] + self.samples.period - times[i]))
        return i, i + 1, float((now - times[i]) / (times[i + 1] - times[i]))

    @cached_property
    def _near(self) -> float:
        """Seconds within which a time is that of a sample: a millionth of the shortest between two."""
        return 1e-6 * float(np.diff(self.samples.times).min(initial=1.0))

    def kinks(self, time: float, dt: float) -> Iterator[float]:
        """Yield the times of samples within a step; so the sub-steps between them need two samples alone."""
        times = self.samples.times
        if len(times) == 1:
            return
        period = self.samples.period if self.loop else 1.0
        least, most = sorted(self.start + self.time_scale * each for each in (time, time + dt))
        first, last = (math.floor((each - times[0]) / period) if self.loop else 0 for each in (least, most))
        for turn in range(first, last + 1):
            at = times + turn * period
            at = at[(at > least + self._near) & (at < most - self._near)]
            yield from ((at - self.start) / self.time_scale).tolist()

    def numbers(self, time: float) -> tuple[Any, ...]:
        before, after, share = self.moment(time)
        first = _Address(self.samples, before)
        second = _Address(self.samples, after) if share else first
        return (float(self._memory.ctypes.data), first, second, share, *self._place(time))

    def _place(self, time: float) -> tuple[float, ...]:
        """Return the centre, the scale, and the factor on velocities at a time."""
        scale = number_at(self.scale, time)
        return *vector_at(self.centre, time), scale, scale * self._factor(time)

    def _factor(self, time: float) -> float:
        pace = self.time_scale if self.samples.is_paced else 1.0
        return number_at(self.strength, time) * pace

    def program(self, time: float) -> Program:
        (row,) = super().program(time)
        return (row._replace(owner=(self, row.numbers)),)  # whose addresses own what was read

    def cache_data(self, time: float) -> Any:
        moment = self.moment(time)
        how = [self.between, self.outside, self.samples.array]
        digests = [self.samples.digest(index) for index in dict.fromkeys(moment[:2])]
        deciding = digests[0] if len(set(digests)) == 1 else digests
        return {"sampled": deciding, "how": how, "numbers": [*moment, *self._place(time)]}

    def gradient_bound(self, time: float) -> float:
        """Bound the gradient by the largest differences of neighbours along each axis."""
        before, after, share = self.moment(time)
        slopes = (1.0 - share) * self._slopes(before) + share * self._slopes(after)
        overshoot = CUBIC_OVERSHOOT if self.between == "cubic" else 1.0
        return float(overshoot * np.linalg.norm(slopes)) * abs(self._factor(time))

    def length_scale(self, time: float) -> float:
        """Return the shortest distance of two samples."""
        return number_at(self.scale, time) * self.samples.spacing

    @property
    def holds_much(self) -> bool:  # type: ignore[override]
        return self.samples.is_large

    def _slopes(self, index: int) -> Floats:
        known = self.samples.known_slopes
        if index not in known:
            known[index] = self.samples.slopes(index)
        return known[index]


ROWS = 16  # nodes along x whose differences are held at once


def _largest_secant(velocity: AnyArray, axis: Floats, k: int) -> float:
    steps, most = np.diff(axis).reshape([-1 if n == k else 1 for n in range(3)]), 0.0
    for first in range(0, len(velocity), ROWS):
        part = velocity[first : first + ROWS + (k == 0)].astype(np.float64, copy=False)
        rises = np.linalg.norm(np.diff(part, axis=k), axis=-1)
        along = steps[first : first + ROWS] if k == 0 else steps
        most = max(most, float((rises / along).max(initial=0.0)))
    return most
