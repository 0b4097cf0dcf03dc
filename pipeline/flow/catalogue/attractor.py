"""What all attractors share: how their equations stand in a scene."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Annotated, ClassVar

from pipeline.flow.catalogue.directions import ORIGIN
from pipeline.flow.choreography import Number, Place, Vector, number_at, place_at
from pipeline.flow.parameters import Positive, Sense
from pipeline.flow.velocity import Term


@dataclass(frozen=True)
class Attractor(Term):
    """Every point follows a system of three equations. It stands upright: its z is our y, its y our −z.

    Far from the attractor many systems fly apart: keep the subject about as large as the attractor is. The
    gradient grows with the distance; its bound holds up to `reach` of its own units from the centre along
    each axis, which is a little further than the attractor goes.
    """

    reach: ClassVar[float] = math.inf

    centre: Annotated[Place, Sense("of the attractor", "units")] = ORIGIN
    scale: Annotated[Positive, Sense("of its units in one of the scene's")] = 1.0
    time_scale: Annotated[Number, Sense("of its time units in a second")] = 0.1

    @abstractmethod
    def _numbers(self, time: float) -> tuple[float, ...]:
        """Its own parameters, in the kernel's order."""

    @abstractmethod
    def _gradient(self, time: float) -> float:
        """A bound of its Jacobian's norm within `reach` of the middle, in its own units; far away is more."""

    def _middle(self, time: float) -> Vector:
        """What lies at `centre`, in its own coordinates."""
        return ORIGIN

    def row(self, time: float) -> tuple[float, ...]:
        (cx, cy, cz), (x, y, z) = place_at(self.centre, time), self._middle(time)
        scale = number_at(self.scale, time)
        origin = cx - x / scale, cy - z / scale, cz + y / scale
        return (*origin, scale, number_at(self.time_scale, time) / scale, *self._numbers(time))

    def steepness(self, time: float) -> float:
        return abs(number_at(self.time_scale, time)) * self._gradient(time)
