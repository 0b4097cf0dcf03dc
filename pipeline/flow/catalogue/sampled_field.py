"""Velocities by samples on a grid."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from flowsculpt.pipeline.arrays import Floats
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
from flowsculpt.pipeline.flow.velocity import ExternalField, StableProperty
from flowsculpt.pipeline.kernels import BlockKernel

Outside = Literal["clamp", "zero", "repeat"]

_OUTSIDE = {"clamp": kernels.CLAMP, "zero": kernels.ZERO, "repeat": kernels.REPEAT}

CUBIC_OVERSHOOT = 1.5 * 1.25**2
"""The bound of a Catmull-Rom gradient over the largest secant nearby: its slope is at most 1.5 secants along
an axis; across, in each of two directions, the absolute values of its weights add up to at most 1.25. Exact
on evenly spaced axes."""


@dataclass(frozen=True)
class Samples:
    """Velocities at the nodes of a grid, at one time or several: equal contents of files, equal samples.

    axes      three float64 arrays, each ascending and of two numbers or more
    times     (T,) seconds, ascending
    velocity  float64 (T, X, Y, Z, 3)
    digests   SHA-256 of each file
    array     the name of the velocities in VTK files; None: the file's only vectors
    interval  seconds from file to file
    """

    axes: tuple[Floats, Floats, Floats] = field(compare=False, repr=False)
    times: Floats = field(compare=False, repr=False)
    velocity: Floats = field(compare=False, repr=False)
    digests: tuple[str, ...]
    array: str | None = None
    interval: float = 1.0

    @property
    def digest(self) -> str:
        """The digest of all files together."""
        return hashlib.sha256("".join(self.digests).encode()).hexdigest()


@dataclass(frozen=True)
class Sampled(ExternalField):
    """Velocities at the points of a grid, from VTK or numpy files, interpolated between.

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
        axes = self.samples.axes
        header = [*map(len, axes), self.between == "cubic", _OUTSIDE[self.outside]]
        return np.concatenate([np.array(header, np.float64), *axes])

    def moment(self, time: float) -> tuple[int, int, float]:
        """Return the indices of the samples before and after a time, and the share of the latter."""
        times = self.samples.times
        now, first, last = self.start + self.time_scale * time, float(times[0]), float(times[-1])
        if self.loop and last > first:
            now = first + (now - first) % (last - first)
        if now <= first or len(times) == 1:
            return 0, 0, 0.0
        if now >= last:
            return len(times) - 1, len(times) - 1, 0.0
        i = int(np.searchsorted(times, now, side="right")) - 1
        return i, i + 1, float((now - times[i]) / (times[i + 1] - times[i]))

    def numbers(self, time: float) -> tuple[float, ...]:
        before, after, share = self.moment(time)
        velocity, scale = self.samples.velocity, number_at(self.scale, time)
        addresses = [array.ctypes.data for array in (self._memory, velocity[before], velocity[after])]
        factor = scale * number_at(self.strength, time)
        return (*map(float, addresses), share, *vector_at(self.centre, time), scale, factor)

    def cache_data(self, time: float) -> Any:
        how = [self.between, self.outside, self.samples.array]
        numbers = [*self.moment(time), *self.numbers(time)[4:]]
        return {"sampled": self.samples.digest, "how": how, "numbers": numbers}

    def gradient_bound(self, time: float) -> float:
        """Bound the gradient by the largest differences of neighbours along each axis."""
        before, after, share = self.moment(time)
        slopes = (1.0 - share) * self._slopes[before] + share * self._slopes[after]
        overshoot = CUBIC_OVERSHOOT if self.between == "cubic" else 1.0
        return float(overshoot * np.linalg.norm(slopes)) * abs(number_at(self.strength, time))

    def length_scale(self, time: float) -> float:
        """Return the shortest distance of two samples."""
        return number_at(self.scale, time) * self._narrowest

    @cached_property
    def _narrowest(self) -> float:
        return min(float(np.diff(axis).min()) for axis in self.samples.axes)

    @cached_property
    def _slopes(self) -> Floats:
        """(T, 3) the largest secants along the axes, at every time."""
        samples = self.samples
        return np.array(
            [[_largest_secant(v, axis, k) for k, axis in enumerate(samples.axes)] for v in samples.velocity]
        )


def _largest_secant(velocity: Floats, axis: Floats, k: int) -> float:
    rises = np.linalg.norm(np.diff(velocity, axis=k), axis=-1)
    return float((rises / np.diff(axis).reshape([-1 if n == k else 1 for n in range(3)])).max())
