"""The deformation that tracked surfaces are compared by."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.directions import ORIGIN
from pipeline.flow.choreography import Place, number_at, place_at
from pipeline.flow.parameters import Positive, PositiveConstant, Sense
from pipeline.flow.velocity import Term


@dataclass(frozen=True)
class Enright(Term):
    """Draws a ball out to a thin curled sheet and puts it together again, within a cube; keeps volume.

    With 0 < x, y, z < 1 in the cube of side `scale` about `centre`,

        u =  2 sin²(πx) sin(2πy) sin(2πz) cos(πt/T)
        v = −  sin(2πx) sin²(πy) sin(2πz) cos(πt/T)
        w = −  sin(2πx) sin(2πy) sin²(πz) cos(πt/T)

    in sides of the cube per second. Nothing crosses the faces of the cube; beyond them the pattern repeats.
    Half way through the period T the deformation is greatest, at its end all is where it was.

    Source: LeVeque, *High-Resolution Conservative Algorithms for Advection in Incompressible Flow*, SIAM
    Journal on Numerical Analysis 33 (1996); with a ball of radius 0.15 about (0.35, 0.35, 0.35) and T = 3,
    the test of Enright et al., *A Hybrid Particle Level Set Method*, J. Comput. Phys. 183 (2002). P3.
    """

    centre: Annotated[Place, Sense("of the cube", "units")] = ORIGIN
    scale: Annotated[Positive, Sense("side of the cube", "units")] = 2.0
    period: Annotated[PositiveConstant, Sense("there and back", "s")] = 3.0

    @property
    def kind(self) -> int:
        return op.ENRIGHT

    def row(self, time: float) -> tuple[float, ...]:
        return (*place_at(self.centre, time), number_at(self.scale, time), self._factor(time))

    def steepness(self, time: float) -> float:
        """4π, which is reached on an axis of the cube, half way from its centre to a face."""
        return 4 * math.pi * abs(self._factor(time))

    def _factor(self, time: float) -> float:
        return math.cos(math.pi * time / self.period)
