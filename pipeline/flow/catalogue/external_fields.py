"""Velocities by external functions: formulas, and samples on a grid."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.flow.compiled_formulas import FRAME, NAMES, compile_formulas
from flowsculpt.pipeline.flow.kernels import external_kernels as kernels
from flowsculpt.pipeline.flow.keyframes import frame_at
from flowsculpt.pipeline.flow.parameters import (
    ORIGIN,
    Number,
    ParameterDoc,
    PositiveConstant,
    PositiveNumber,
    VectorParameter,
    number_at,
    vector_at,
)
from flowsculpt.pipeline.flow.velocity import ExternalField, StableProperty
from flowsculpt.pipeline.formula import Expression, time_values
from flowsculpt.pipeline.kernels import BlockKernel

MAX_NUMBERS = 10

SAMPLES = 8  # samples of the gradient along each side of the cube; even, so that none lies on an axis


@dataclass(frozen=True)
class FormulaField(ExternalField):
    """The velocity by three formulas over x, y, z, t and frame.

        FormulaField(("-y", "x", "0.3 * sin(t)"))

    texts  along x, y and z, units per second; see `flowsculpt.pipeline.formula`
    words  further names and their values, constant or keyed: changing these compiles nothing
    fps    frames per second, for `frame`
    first  the number of the frame at 0 seconds

    The gradient of an arbitrary formula has no known bound. It is sampled by differences at 8³ points of a
    cube, and the largest decides the sub-steps: where the gradient is larger, between the samples or outside
    the cube, sub-steps are less exact.

    Raises FormulaError, with the column, for invalid formulas, and UsageError for too many numbers.
    """

    texts: tuple[str, str, str]
    words: tuple[tuple[str, Number], ...] = ()
    extent: Annotated[
        PositiveConstant, ParameterDoc("half the side of the cube where the gradient is sampled", "units")
    ] = 2.0
    fps: float = 24.0
    first: int = 1

    def __post_init__(self) -> None:
        assert self.expressions, "they are checked now, not when the first frame is made"
        if len(self._names) > MAX_NUMBERS:
            beside = f" beside {FRAME}" if FRAME in self._names else ""
            raise UsageError(
                f"a formula has {len(self.words)} numbers of its own{beside}; "
                f"{MAX_NUMBERS - bool(beside)} are the most. Write some of them into the formula."
            )

    @property
    def name(self) -> str:
        return "formula"

    @cached_property
    def expressions(self) -> tuple[Expression, Expression, Expression]:
        u, v, w = (Expression(text, (*NAMES, *(name for name, _ in self.words))) for text in self.texts)
        return u, v, w

    @cached_property
    def _names(self) -> tuple[str, ...]:
        """The names of the numbers that the compiled function takes."""
        named = tuple(name for name, _ in self.words)
        return (*named, FRAME) if FRAME in self._used_names else named

    @StableProperty
    def block(self) -> BlockKernel:
        return compile_formulas(self.expressions, self._names)

    @cached_property
    def depends_on_time(self) -> bool:
        return bool({"t", "time"} & self._used_names)

    @cached_property
    def _used_names(self) -> frozenset[str]:
        return frozenset().union(*(expression.uses for expression in self.expressions))

    def numbers(self, time: float) -> tuple[float, ...]:
        numbers = tuple(number_at(value, time) for _, value in self.words)
        if FRAME in self._used_names:
            return (*numbers, float(frame_at(time, self.fps, self.first)))
        return numbers

    def cache_data(self, time: float) -> Any:
        named = zip(self._names, self.numbers(time), strict=True)
        numbers = {name: number for name, number in named if name in self._used_names}
        seconds = {"t": time} if self.depends_on_time else {}
        return {"formula": list(self.texts), "numbers": numbers, **seconds}

    def gradient_bound(self, time: float) -> float:
        return _sampled_gradient(self, self.numbers(time), time if self.depends_on_time else 0.0)

    def length_scale(self, time: float) -> float:
        """Return half the distance of the samples: what is narrower may lie between them."""
        return self.extent / SAMPLES

    def diagnose(self, point: Points, time: float) -> str | None:
        """Return which part of a formula is not finite at a point (3,), and its column; None if all are."""
        x, y, z = point.tolist()
        words = {name: number_at(value, time) for name, value in self.words}
        now = time_values(float(frame_at(time, self.fps, self.first)), time)
        values = {"x": x, "y": y, "z": z, **now, **words}
        return next(filter(None, (expression.diagnose(values) for expression in self.expressions)), None)


@lru_cache(maxsize=4096)
def _sampled_gradient(field: FormulaField, numbers: tuple[float, ...], time: float) -> float:
    """Return the largest norm of the gradient at the samples where it is finite."""
    columns, step = _gradient_samples(field.extent)
    out = np.zeros_like(columns)
    field.block(np.array(numbers or (0.0,)), columns, time, out)
    velocity = out.T.reshape(3, 2, -1, 3)
    with np.errstate(all="ignore"):
        gradient = ((velocity[:, 0] - velocity[:, 1]) / (2.0 * step)).transpose(1, 2, 0)
    return largest_norm(gradient[np.isfinite(gradient).all(axis=(1, 2))])


@lru_cache(maxsize=16)
def _gradient_samples(extent: float) -> tuple[Floats, float]:
    """Return the points, as columns (3, N), whose velocities differ by the gradient, and their distance."""
    side = extent * (2.0 * np.arange(SAMPLES) - SAMPLES + 1) / SAMPLES
    points = np.stack(np.meshgrid(side, side, side), axis=-1).reshape(-1, 3)
    step = 1e-5 * extent
    shifted = np.concatenate([points + sign * step * axis for axis in np.eye(3) for sign in (1.0, -1.0)])
    return np.ascontiguousarray(shifted.T), step


def largest_norm(matrices: Floats) -> float:
    """Return the largest spectral norm of finite matrices (N, 3, 3); 0 where there are none.

    Singular values take long, and few matrices can have the largest: a spectral norm is at least the norm of
    each row and column, and at most the Frobenius norm.
    """
    largest = np.abs(matrices).max(initial=0.0)
    if largest == 0.0:
        return 0.0
    squares = (matrices / largest) ** 2
    columns, rows = squares.sum(axis=1), squares.sum(axis=2)
    least = max(columns.max(), rows.max())
    candidates = matrices[columns.sum(axis=1) >= (1.0 - 1e-9) * least]
    return float(np.linalg.norm(candidates, ord=2, axis=(1, 2)).max())


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
