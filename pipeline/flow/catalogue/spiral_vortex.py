"""A vortex that draws in what it turns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pipeline.flow.catalogue.directions import ORIGIN, Y
from pipeline.flow.catalogue.strain import Strain
from pipeline.flow.catalogue.vortex import Vortex
from pipeline.flow.choreography import Number, Place
from pipeline.flow.parameters import Direction, Positive, Sense
from pipeline.flow.program import Program
from pipeline.flow.velocity import VelocityField


@dataclass(frozen=True)
class SpiralVortex(VelocityField):
    """Turns about a line, draws in and sends out along the line; keeps volume.

    A Lamb–Oseen vortex of the circulation Γ and the core's radius R, with the velocity −inflow/2 · r across
    the axis and inflow · height along it. In a fluid of the viscosity inflow · R² / 4 it is Burgers' steady
    vortex. A negative inflow spirals outwards and down.

    Source: Burgers, *A mathematical model illustrating the theory of turbulence*, Adv. Appl. Mech. 1 (1948).
    """

    axis: Annotated[Direction, Sense("of the line")] = Y
    centre: Annotated[Place, Sense("where nothing moves", "units")] = ORIGIN
    radius: Annotated[Positive, Sense("of the core", "units")] = 0.5
    strength: Annotated[Number, Sense("circulation, counter-clockwise seen against the axis", "units²/s")] = (
        1.0
    )
    inflow: Annotated[Number, Sense("lengthening along the axis; negative flows out", "1/s")] = 0.5

    def program(self, time: float) -> Program:
        return tuple(row for part in self._parts for row in part.program(time))

    def steepness(self, time: float) -> float:
        return sum(part.steepness(time) for part in self._parts)

    @property
    def _parts(self) -> tuple[Vortex, Strain]:
        return (
            Vortex(self.axis, self.centre, self.radius, self.strength),
            Strain(self.axis, self.centre, self.inflow),
        )
