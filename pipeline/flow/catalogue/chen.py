"""Chen's attractor as a flow."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.attractor import Attractor
from pipeline.flow.choreography import Number, Vector, number_at
from pipeline.flow.parameters import Positive, Sense


@dataclass(frozen=True)
class Chen(Attractor):
    """Lorenz's dual: two eyes again, more tightly wound.

        x' = a (y − x)    y' = (c − a) x − x z + c y    z' = x y − b z

    (0, 0, 2 c − a), the height of its eyes, is at `centre`; it is about 50 of its units wide and 40 high. The
    divergence is (c − a − b) × time_scale.

    Source: Chen & Ueta, *Yet Another Chaotic Attractor*, Int. J. Bifurcation and Chaos 9 (1999).
    """

    reach: ClassVar[float] = 27.0

    a: Annotated[Number, Sense("a")] = 35.0
    b: Annotated[Number, Sense("b")] = 3.0
    c: Annotated[Number, Sense("c")] = 28.0
    scale: Annotated[Positive, Sense("of its units in one of the scene's")] = 25.0
    time_scale: Annotated[Number, Sense("of its time units in a second")] = 0.04

    @property
    def kind(self) -> int:
        return op.CHEN

    def _numbers(self, time: float) -> tuple[float, ...]:
        return (number_at(self.a, time), number_at(self.b, time), number_at(self.c, time))

    def _middle(self, time: float) -> Vector:
        return 0.0, 0.0, 2.0 * number_at(self.c, time) - number_at(self.a, time)

    def _gradient(self, time: float) -> float:
        """The root of the sum of squares, where c − a − z is −c in the middle."""
        a, b, c = (number_at(number, time) for number in (self.a, self.b, self.c))
        reach = self.reach
        return math.hypot(math.sqrt(2.0) * a, abs(c) + reach, c, math.sqrt(3.0) * reach, b)
