"""The Lorenz attractor as a flow."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.directions import ORIGIN
from pipeline.flow.choreography import Number, Place, number_at, place_at
from pipeline.flow.velocity import Term


@dataclass(frozen=True)
class Lorenz(Term):
    """Every point follows the Lorenz equations:

        x' = σ (y − x)    y' = x (ρ − z) − y    z' = x y − β z

    The attractor stands upright (its z is our y, its y our −z) with (0, 0, ρ − 1), the height of its two
    eyes, at `centre`. A scene unit is `scale` of its units: it is about 40 wide and 50 high, so 20 makes it
    fit a subject of half-size 1. A second is `time_scale` of its time: one turn about an eye takes
    about 0.7. The divergence is −(σ + 1 + β) × time_scale: everything is drawn to a thin sheet
    within a fraction of its time unit, so a sculpture wants a small time scale.

    Source: Lorenz, *Deterministic Nonperiodic Flow*, J. Atmos. Sci. 20 (1963). P3, P33.
    """

    centre: Place = ORIGIN
    sigma: Number = 10.0
    rho: Number = 28.0
    beta: Number = 8.0 / 3.0
    scale: Number = 20.0
    time_scale: Number = 0.1

    @property
    def kind(self) -> int:
        return op.LORENZ

    def row(self, time: float) -> tuple[float, ...]:
        numbers = (self.sigma, self.rho, self.beta, self.scale, self.time_scale)
        return (*place_at(self.centre, time), *(number_at(number, time) for number in numbers))

    def steepness(self, time: float) -> float:
        """The Jacobian's norm on and about the attractor, where |x| stays below 20; far away it is more."""
        sigma, rho = abs(number_at(self.sigma, time)), abs(number_at(self.rho, time))
        return abs(number_at(self.time_scale, time)) * (sigma + rho + 20.0)
