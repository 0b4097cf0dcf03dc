"""The Lorenz attractor: every point follows a system of three differential equations."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

from flowsculpt.pipeline.flow.kernels import field_kernels as kernels
from flowsculpt.pipeline.flow.parameters import (
    ORIGIN,
    Number,
    ParameterDoc,
    PositiveNumber,
    VectorParameter,
    number_at,
    vector_at,
)
from flowsculpt.pipeline.flow.velocity import BasicField


@dataclass(frozen=True)
class Lorenz(BasicField):
    """The butterfly of 1963: two eyes between which points change unpredictably.

        x' = σ (y − x)    y' = x (ρ − z) − y    z' = x y − β z

    It stands upright: its z is our y, its y our −z. (0, 0, ρ − 1), the height of its two eyes, is at
    `centre`. It is about 40 of its units wide and 50 high, so a scale of 20 makes it fit a subject of
    half-size 1. One turn about an eye takes about 0.7 of its time. The divergence is −(σ + 1 + β) ×
    time_scale: everything is drawn to a thin sheet within a fraction of its time unit, so a sculpture wants a
    small time scale.

    The gradient grows with the distance; its bound holds up to `reach` of its units from the centre along
    each axis, a little further than the attractor extends. Keep the subject about as large as that.

    Source: Lorenz, *Deterministic Nonperiodic Flow*, J. Atmos. Sci. 20 (1963). P3, P33.
    """

    opcode: ClassVar[int] = kernels.LORENZ
    reach: ClassVar[float] = 27.0

    centre: Annotated[VectorParameter, ParameterDoc("of the attractor", "units")] = ORIGIN
    scale: Annotated[PositiveNumber, ParameterDoc("of its units in one of the scene's")] = 20.0
    time_scale: Annotated[Number, ParameterDoc("of its time units in a second")] = 0.1
    sigma: Annotated[Number, ParameterDoc("σ")] = 10.0
    rho: Annotated[Number, ParameterDoc("ρ")] = 28.0
    beta: Annotated[Number, ParameterDoc("β")] = 8.0 / 3.0

    def row(self, time: float) -> tuple[float, ...]:
        sigma, rho, beta = self._parameters(time)
        (x, y, z), scale = vector_at(self.centre, time), number_at(self.scale, time)
        rate = number_at(self.time_scale, time) / scale
        return x, y - (rho - 1.0) / scale, z, scale, rate, sigma, rho, beta

    def _parameters(self, time: float) -> tuple[float, float, float]:
        return number_at(self.sigma, time), number_at(self.rho, time), number_at(self.beta, time)

    def gradient_bound(self, time: float) -> float:
        """Bound the gradient by its Frobenius norm (ρ − z is 1 in the middle), at least as for |x| < 20."""
        sigma, rho, beta = self._parameters(time)
        bound = math.hypot(math.sqrt(2.0) * sigma, 1.0 + self.reach, 1.0, math.sqrt(3.0) * self.reach, beta)
        return abs(number_at(self.time_scale, time)) * max(bound, abs(sigma) + abs(rho) + 20.0)

    def length_scale(self, time: float) -> float:
        """Return half the `reach`: over it the gradient, linear in the position or about so, changes."""
        return 0.5 * self.reach / number_at(self.scale, time)


FLOWS: tuple[type, ...] = (Lorenz,)
