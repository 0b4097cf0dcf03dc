"""Velocities from a user's files."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from pipeline.arrays import Floats
from pipeline.flow import _kernels_sampled as kernels
from pipeline.flow.keyframes import Number, Place, number_at, place_at
from pipeline.flow.parameters import Positive, Sense
from pipeline.flow.samples.read import Samples, read_samples
from pipeline.flow.vectors import ORIGIN
from pipeline.flow.velocity import External
from pipeline.kernels import BlockKernel

Outside = Literal["clamp", "zero", "repeat"]

_OUTSIDE = {"clamp": kernels.CLAMP, "zero": kernels.ZERO, "repeat": kernels.REPEAT}

CUBIC_OVERSHOOT = 1.5 * 1.25**2
"""The slope of Catmull and Rom's spline is at most 1.5 of the steepest secant around, and across, in each of
two directions, its weights add up to at most 1.25 without their signs: exactly so on even axes."""


@dataclass(frozen=True)
class SampledFiles:
    """What files held when they were read: equal contents, equal field, wherever they lie.

    digest    SHA-256 of their contents
    array     the name of the velocities in VTK files; None: the file's only vectors
    interval  seconds from file to file
    """

    digest: str
    array: str | None
    interval: float
    samples: Samples = field(compare=False, repr=False)

    @classmethod
    def of(cls, paths: tuple[Path, ...], array: str | None = None, interval: float = 1.0) -> SampledFiles:
        """Raises what `read_samples` raises."""
        samples = read_samples(paths, array, interval)
        return cls(samples.digest, array, interval, samples)


@dataclass(frozen=True)
class Sampled(External):
    """Velocities at the points of a grid, from files of VTK or numpy, and what is between them.

    A place p of the scene reads the samples at (p − centre) / scale, and moves `scale` times as fast, as if
    the field were a thing that was placed and scaled.

    Linear is so along each axis; cubic are Catmull and Rom's splines, whose velocity has no kinks. Clamp
    takes the nearest place inside; to repeat, the last sample is the first again. Between moments velocities
    are blended.
    """

    files: SampledFiles
    between: Annotated[Literal["linear", "cubic"], Sense("what is between samples")] = "linear"
    outside: Annotated[Outside, Sense("what is outside of the grid")] = "clamp"
    centre: Annotated[Place, Sense("where the grid's origin is put", "units")] = ORIGIN
    scale: Annotated[Positive, Sense("units of the scene per unit of the grid")] = 1.0
    strength: Annotated[Number, Sense("factor on the velocities")] = 1.0
    time_scale: Annotated[float, Sense("seconds of the samples per second of the shot")] = 1.0
    start: Annotated[float, Sense("of the samples when the shot starts", "s")] = 0.0
    loop: Annotated[bool, Sense("after the last moment the first follows; else the last stays")] = False

    @property
    def block(self) -> BlockKernel:
        return kernels.sampled

    @cached_property
    def _memory(self) -> Floats:
        axes = self.files.samples.axes
        form = [*map(len, axes), self.between == "cubic", _OUTSIDE[self.outside]]
        return np.concatenate([np.array(form, np.float64), *axes])

    def moment(self, time: float) -> tuple[int, int, float]:
        """The samples' moments before and after a time of the shot, and the share of the latter."""
        times = self.files.samples.times
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
        velocity, scale = self.files.samples.velocity, number_at(self.scale, time)
        addresses = [array.ctypes.data for array in (self._memory, velocity[before], velocity[after])]
        factor = scale * number_at(self.strength, time)
        return (*map(float, addresses), share, *place_at(self.centre, time), scale, factor)

    def identity(self, time: float) -> Any:
        how = [self.between, self.outside, self.files.array]
        numbers = [*self.moment(time), *self.numbers(time)[4:]]
        return {"sampled": self.files.digest, "how": how, "numbers": numbers}

    def gradient_bound(self, time: float) -> float:
        """The steepest difference of neighbours along each axis; within a cell none is exceeded."""
        before, after, share = self.moment(time)
        slopes = (1.0 - share) * self._slopes[before] + share * self._slopes[after]
        overshoot = CUBIC_OVERSHOOT if self.between == "cubic" else 1.0
        return float(overshoot * np.linalg.norm(slopes)) * abs(number_at(self.strength, time))

    @cached_property
    def _slopes(self) -> Floats:
        """(T, 3) the steepest secants along the axes, at every moment."""
        samples = self.files.samples
        return np.array(
            [[_steepest(v, axis, k) for k, axis in enumerate(samples.axes)] for v in samples.velocity]
        )


def _steepest(velocity: Floats, axis: Floats, k: int) -> float:
    rises = np.linalg.norm(np.diff(velocity, axis=k), axis=-1)
    return float((rises / np.diff(axis).reshape([-1 if n == k else 1 for n in range(3)])).max())
