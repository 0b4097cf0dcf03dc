"""Three crossed waves that stir each other."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.directions import ORIGIN
from pipeline.flow.choreography import Number, Place, number_at, place_at
from pipeline.flow.parameters import Positive, Sense
from pipeline.flow.velocity import Term


@dataclass(frozen=True)
class ABC(Term):
    """Stirs in cells that repeat, by three crossed waves; keeps volume.

        u = a sin kz + c cos ky    v = b sin kx + a cos kz    w = c sin ky + b cos kx

    with k = 2π / scale. Its vorticity is k times the velocity, and its streamlines wander without a pattern.

    Source: Arnold (1965), Beltrami, Childress (1970); Dombre et al., *Chaotic streamlines in the ABC flows*,
    J. Fluid Mech. 167 (1986).
    """

    centre: Annotated[Place, Sense("where kx, ky and kz are nought", "units")] = ORIGIN
    scale: Annotated[Positive, Sense("after which it repeats", "units")] = 3.0
    a: Annotated[Number, Sense("wave along z", "units/s")] = 1.0
    b: Annotated[Number, Sense("wave along x", "units/s")] = (2.0 / 3.0) ** 0.5
    c: Annotated[Number, Sense("wave along y", "units/s")] = (1.0 / 3.0) ** 0.5

    @property
    def kind(self) -> int:
        return op.ABC

    def row(self, time: float) -> tuple[float, ...]:
        return (*place_at(self.centre, time), self._wave(time), *self._speeds(time))

    def steepness(self, time: float) -> float:
        return self._wave(time) * math.hypot(*self._speeds(time))

    def _wave(self, time: float) -> float:
        return 2 * math.pi / number_at(self.scale, time)

    def _speeds(self, time: float) -> tuple[float, float, float]:
        return number_at(self.a, time), number_at(self.b, time), number_at(self.c, time)
