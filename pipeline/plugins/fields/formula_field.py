"""Velocities by formulas."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Annotated, Any

import numpy as np

from flowsculpt import UsageError
from flowsculpt.api.flows import Expression, ExternalField, Number, ParameterDoc, StableProperty, number_at
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.fields.compiled_formulas import FRAME, NAMES, compile_formulas

MAX_NUMBERS = 10

SAMPLES = 8  # samples of the gradient along each side of the cube; even, so that none lies on an axis


@dataclass(frozen=True)
class FormulaField(ExternalField):
    """The velocity by three formulas over x, y, z, t and frame.

        FormulaField(("-y", "x", "0.3 * sin(t)"))

    texts  along x, y and z, units per second; see `Expression`
    words  further names and their values, constant or keyed: changing these compiles nothing
    fps    frames per second, for `frame`
    first  the number of the frame at 0 seconds

    The gradient of an arbitrary formula has no known bound. It is sampled by differences at 8³ points of a
    cube, and the largest decides the sub-steps: where the gradient is larger, between the samples or outside
    the cube, sub-steps are less exact.

    Raises FormulaError, with the column, for invalid formulas, and UsageError for too many numbers.
    """

    can_diagnose = True

    texts: tuple[str, str, str]
    words: tuple[tuple[str, Number], ...] = ()
    extent: Annotated[
        float,
        ParameterDoc("half the side of the cube where the gradient is sampled", "units", bounds=(1e-9, 1e9)),
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
    def block(self) -> Any:
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
            return (*numbers, float(Expression.frame_at(time, self.fps, self.first)))
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

    def diagnose(self, point: Floats, time: float) -> str | None:
        """Return which part of a formula is not finite at a point (3,), and its column; None if all are."""
        x, y, z = point.tolist()
        words = {name: number_at(value, time) for name, value in self.words}
        frame = float(Expression.frame_at(time, self.fps, self.first))
        values = {"x": x, "y": y, "z": z, "t": time, "time": time, FRAME: frame, **words}
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
