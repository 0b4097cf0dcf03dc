"""Rössler's attractor as a flow."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.attractor import Attractor
from pipeline.flow.choreography import Number, number_at
from pipeline.flow.parameters import Positive, Sense


@dataclass(frozen=True)
class Rossler(Attractor):
    """A disc that spirals outwards and folds over itself: the simplest of the strange attractors.

        x' = −y − z    y' = x + a y    z' = b + z (x − c)

    Its disc is about 20 of its units wide and lies level at `centre`; a turn takes about 6 of its time.

    Source: Rössler, *An Equation for Continuous Chaos*, Physics Letters A 57 (1976).
    """

    reach: ClassVar[float] = 23.0

    a: Annotated[Number, Sense("a")] = 0.2
    b: Annotated[Number, Sense("b")] = 0.2
    c: Annotated[Number, Sense("c: how far it spirals before it folds")] = 5.7
    scale: Annotated[Positive, Sense("of its units in one of the scene's")] = 10.0
    time_scale: Annotated[Number, Sense("of its time units in a second")] = 1.0

    @property
    def kind(self) -> int:
        return op.ROSSLER

    def _numbers(self, time: float) -> tuple[float, ...]:
        return (number_at(self.a, time), number_at(self.b, time), number_at(self.c, time))

    def _gradient(self, time: float) -> float:
        a, c = number_at(self.a, time), number_at(self.c, time)
        return math.hypot(math.sqrt(3.0), a, self.reach, self.reach + abs(c))
