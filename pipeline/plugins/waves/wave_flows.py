"""Flows of crossed waves, in cells that repeat: Taylor-Green and kneading."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from flowsculpt.api.flows import (
    ExternalField,
    Number,
    ParameterDoc,
    PositiveNumber,
    VectorParameter,
    number_at,
    vector_at,
)
from flowsculpt.pipeline.plugins.waves import wave_kernels as kernels

ORIGIN = (0.0, 0.0, 0.0)


class Waves(ExternalField):
    """The base of waves that make `turn` radians over `scale`."""

    gains_from_order: ClassVar[bool] = False
    turn: ClassVar[float] = 2 * math.pi
    scale: Number

    def cache_data(self, time: float) -> Any:
        """Return what decides its velocities: the time does so by its numbers alone."""
        return list(self.numbers(time))

    def length_scale(self, time: float) -> float:
        return 1.0 / self._wave(time)

    def _wave(self, time: float) -> float:
        return self.turn / number_at(self.scale, time)


@dataclass(frozen=True)
class TaylorGreen(Waves):
    """Turns in cubic cells, each against its neighbours on all sides; keeps volume and height.

        u = speed · sin kx cos ky cos kz    v = −speed · cos kx sin ky cos kz    w = 0

    with k = π / scale. Nothing crosses the planes between cells.

    Source: Taylor & Green, *Mechanism of the Production of Small Eddies from Large Ones*, Proc. R. Soc. A 158
    (1937).
    """

    block = kernels.taylor_green
    turn: ClassVar[float] = math.pi

    centre: Annotated[VectorParameter, ParameterDoc("a corner where cells meet", "units")] = ORIGIN
    scale: Annotated[PositiveNumber, ParameterDoc("side of a cell", "units")] = 1.0
    speed: Annotated[Number, ParameterDoc("the largest speed", "units/s")] = 1.0

    def numbers(self, time: float) -> tuple[float, ...]:
        return (*vector_at(self.centre, time), self._wave(time), number_at(self.speed, time))

    def gradient_bound(self, time: float) -> float:
        return math.sqrt(2.0) * self._wave(time) * abs(number_at(self.speed, time))


@dataclass(frozen=True)
class Kneading(Waves):
    """Stretches and folds like a baker, stroke after stroke: along x, along y, along z; keeps volume.

    A period T has three strokes. In each only one of

        u = a(t) sin ky    v = a(t) sin kz    w = a(t) sin kx        k = 2π / scale

    acts: it bends straight lines into waves, and the next stroke folds the waves over themselves. Over a
    stroke that begins at 0, a(t) = amount · 8/T · sin⁴(3π t/T), so that it begins and ends gently, and the
    crests of the wave move by `amount` in all. Lengths grow exponentially with the number of strokes.

    Source: the sine flow, in three dimensions: Liu, Muzzio & Peskin, *Quantification of mixing in aperiodic
    chaotic flows*, Chaos, Solitons & Fractals 4 (1994); the gentle strokes are ours.
    """

    block = kernels.kneading

    centre: Annotated[VectorParameter, ParameterDoc("a crossing of the waves, a fixed point", "units")] = (
        ORIGIN
    )
    scale: Annotated[PositiveNumber, ParameterDoc("length of a wave", "units")] = 4.0
    amount: Annotated[Number, ParameterDoc("how far a stroke moves the crests", "units")] = 1.0
    period: Annotated[float, "positive", ParameterDoc("of three strokes", "s")] = 3.0

    def numbers(self, time: float) -> tuple[float, ...]:
        stroke, speed = self._stroke(time)
        speeds = [speed if stroke == axis else 0.0 for axis in range(3)]
        return (*vector_at(self.centre, time), self._wave(time), *speeds)

    def gradient_bound(self, time: float) -> float:
        """Return the bound at the peak of a stroke, so that none is missed between two times."""
        return self._wave(time) * abs(number_at(self.amount, time)) * 8.0 / self.period

    def _stroke(self, time: float) -> tuple[int, float]:
        """Return which of the three strokes acts, and its speed."""
        strokes = 3.0 * time / self.period
        speed = number_at(self.amount, time) * 8.0 / self.period * math.sin(math.pi * strokes) ** 4
        return math.floor(strokes) % 3, speed
