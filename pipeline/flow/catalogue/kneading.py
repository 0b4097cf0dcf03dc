"""Stretched and folded, over and over."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.directions import ORIGIN
from pipeline.flow.choreography import Number, Place, number_at, place_at
from pipeline.flow.parameters import Positive, PositiveConstant, Sense
from pipeline.flow.velocity import Term


@dataclass(frozen=True)
class Kneading(Term):
    """Stretches and folds like a baker, stroke after stroke: along x, along y, along z; keeps volume.

    A period T has three strokes. In each only one of

        u = a(t) sin ky    v = a(t) sin kz    w = a(t) sin kx        k = 2π / scale

    acts: it bends what lies straight into a wave, and the next stroke folds the wave over itself. Over a
    stroke that begins at 0, a(t) = amount · 8/T · sin⁴(3π t/T), so that it begins and ends gently, and the
    crests of the wave move by `amount` in all. Lengths grow exponentially with the number of strokes.

    Source: the sine flow, in three dimensions: Liu, Muzzio & Peskin, *Quantification of mixing in aperiodic
    chaotic flows*, Chaos, Solitons & Fractals 4 (1994); the gentle strokes are ours.
    """

    centre: Annotated[Place, Sense("a crossing of the waves, which stays", "units")] = ORIGIN
    scale: Annotated[Positive, Sense("length of a wave", "units")] = 4.0
    amount: Annotated[Number, Sense("how far a stroke moves the crests", "units")] = 1.0
    period: Annotated[PositiveConstant, Sense("of three strokes", "s")] = 3.0

    @property
    def kind(self) -> int:
        return op.KNEADING

    def row(self, time: float) -> tuple[float, ...]:
        stroke, speed = self._stroke(time)
        speeds = [speed if stroke == axis else 0.0 for axis in range(3)]
        return (*place_at(self.centre, time), self._wave(time), *speeds)

    def steepness(self, time: float) -> float:
        """At the height of a stroke, so that no stroke passes unseen between two looks."""
        return self._wave(time) * abs(number_at(self.amount, time)) * 8.0 / self.period

    def _wave(self, time: float) -> float:
        return 2 * math.pi / number_at(self.scale, time)

    def _stroke(self, time: float) -> tuple[int, float]:
        """Which of the three it is, and its speed."""
        strokes = 3.0 * time / self.period
        speed = number_at(self.amount, time) * 8.0 / self.period * math.sin(math.pi * strokes) ** 4
        return math.floor(strokes) % 3, speed
