"""Rows of vortices, each against its neighbours."""

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
class TaylorGreen(Term):
    """Turns in cubic cells, each against its neighbours on all sides; keeps volume and height.

        u = speed · sin kx cos ky cos kz    v = −speed · cos kx sin ky cos kz    w = 0

    with k = π / scale. Nothing crosses the planes between cells.

    Source: Taylor & Green, *Mechanism of the Production of Small Eddies from Large Ones*, Proc. R. Soc. A 158
    (1937).
    """

    centre: Annotated[Place, Sense("a corner where cells meet", "units")] = ORIGIN
    scale: Annotated[Positive, Sense("side of a cell", "units")] = 1.0
    speed: Annotated[Number, Sense("the greatest there is", "units/s")] = 1.0

    @property
    def kind(self) -> int:
        return op.TAYLOR_GREEN

    def row(self, time: float) -> tuple[float, ...]:
        return (*place_at(self.centre, time), self._wave(time), number_at(self.speed, time))

    def steepness(self, time: float) -> float:
        return math.sqrt(2.0) * self._wave(time) * abs(number_at(self.speed, time))

    def _wave(self, time: float) -> float:
        return math.pi / number_at(self.scale, time)
