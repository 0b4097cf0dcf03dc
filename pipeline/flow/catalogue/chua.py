"""Chua's double scroll as a flow."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.attractor import Attractor
from pipeline.flow.choreography import Number, number_at
from pipeline.flow.parameters import Positive, Sense


@dataclass(frozen=True)
class Chua(Attractor):
    """The double scroll of an electric circuit, with a smooth cubic for its resistor.

        x' = α (y − x³ − c x)    y' = x − y + z    z' = −β y

    It is about 1 of its units wide, 1.5 high, and flat: 0.16 deep.

    Source: Zhong, *Implementation of Chua's circuit with a cubic nonlinearity*, IEEE Trans. Circuits and
    Systems I 41 (1994).
    """

    reach: ClassVar[float] = 1.0

    alpha: Annotated[Number, Sense("α")] = 10.0
    beta: Annotated[Number, Sense("β")] = 16.0
    c: Annotated[Number, Sense("c of the cubic")] = -0.143
    scale: Annotated[Positive, Sense("of its units in one of the scene's")] = 0.7
    time_scale: Annotated[Number, Sense("of its time units in a second")] = 0.5

    @property
    def kind(self) -> int:
        return op.CHUA

    def _numbers(self, time: float) -> tuple[float, ...]:
        return (number_at(self.alpha, time), number_at(self.beta, time), number_at(self.c, time))

    def _gradient(self, time: float) -> float:
        """It changes with x alone; along y and z the reach has no end."""
        alpha = number_at(self.alpha, time)
        bend = alpha * (3.0 * self.reach**2 + abs(number_at(self.c, time)))
        return math.hypot(bend, alpha, number_at(self.beta, time), 2.0)
