"""The Lorenz attractor as a flow."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.attractor import Attractor
from pipeline.flow.choreography import Number, Vector, number_at
from pipeline.flow.parameters import Positive, Sense


@dataclass(frozen=True)
class Lorenz(Attractor):
    """The butterfly of 1963: two eyes that points change between at no one's guess.

        x' = σ (y − x)    y' = x (ρ − z) − y    z' = x y − β z

    (0, 0, ρ − 1), the height of its two eyes, is at `centre`. It is about 40 of its units wide and 50 high,
    so a scale of 20 makes it fit a subject of half-size 1. One turn about an eye takes about 0.7 of its time.
    The divergence is −(σ + 1 + β) × time_scale: everything is drawn to a thin sheet within a fraction of its
    time unit, so a sculpture wants a small time scale.

    Source: Lorenz, *Deterministic Nonperiodic Flow*, J. Atmos. Sci. 20 (1963). P3, P33.
    """

    reach: ClassVar[float] = 27.0

    sigma: Annotated[Number, Sense("σ")] = 10.0
    rho: Annotated[Number, Sense("ρ")] = 28.0
    beta: Annotated[Number, Sense("β")] = 8.0 / 3.0
    scale: Annotated[Positive, Sense("of its units in one of the scene's")] = 20.0
    time_scale: Annotated[Number, Sense("of its time units in a second")] = 0.1

    @property
    def kind(self) -> int:
        return op.LORENZ

    def _numbers(self, time: float) -> tuple[float, ...]:
        return (number_at(self.sigma, time), number_at(self.rho, time), number_at(self.beta, time))

    def _middle(self, time: float) -> Vector:
        return 0.0, 0.0, number_at(self.rho, time) - 1.0

    def _gradient(self, time: float) -> float:
        """The root of the sum of squares, with ρ − z = 1 in the middle; and never less than for |x| < 20."""
        sigma, rho, beta = (number_at(number, time) for number in (self.sigma, self.rho, self.beta))
        bound = math.hypot(math.sqrt(2.0) * sigma, 1.0 + self.reach, 1.0, math.sqrt(3.0) * self.reach, beta)
        return max(bound, abs(sigma) + abs(rho) + 20.0)
