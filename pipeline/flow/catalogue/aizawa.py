"""Aizawa's attractor as a flow."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.attractor import Attractor
from pipeline.flow.choreography import Number, Vector, number_at
from pipeline.flow.parameters import Positive, Sense


@dataclass(frozen=True)
class Aizawa(Attractor):
    """A ball that turns, with a channel down its axis through which everything comes back.

        x' = (z − b) x − d y    y' = d x + (z − b) y
        z' = c + a z − z³/3 − (x² + y²)(1 + e z) + f z x³

    It is about 3 of its units wide and 2.2 high, its middle (0, 0, 0.7) at `centre`.

    Source: Langford, *Numerical Studies of Torus Bifurcations*, in Küpper et al., *Numerical Methods for
    Bifurcation Problems* (1984), whose system it is; named after Aizawa since.
    """

    reach: ClassVar[float] = 1.7

    a: Annotated[Number, Sense("a")] = 0.95
    b: Annotated[Number, Sense("b")] = 0.7
    c: Annotated[Number, Sense("c")] = 0.6
    d: Annotated[Number, Sense("d: turns it")] = 3.5
    e: Annotated[Number, Sense("e")] = 0.25
    f: Annotated[Number, Sense("f")] = 0.1
    scale: Annotated[Positive, Sense("of its units in one of the scene's")] = 1.5
    time_scale: Annotated[Number, Sense("of its time units in a second")] = 0.4

    @property
    def kind(self) -> int:
        return op.AIZAWA

    def _numbers(self, time: float) -> tuple[float, ...]:
        return tuple(number_at(number, time) for number in (self.a, self.b, self.c, self.d, self.e, self.f))

    def _middle(self, time: float) -> Vector:
        return 0.0, 0.0, 0.7

    def _gradient(self, time: float) -> float:
        """The turning, and the root of the sum of squares of the rest, row by row."""
        a, d, e, f = (abs(number_at(number, time)) for number in (self.a, self.d, self.e, self.f))
        x, z = self.reach, self.reach + 0.7
        rising = self.reach + abs(0.7 - number_at(self.b, time))
        radius = math.sqrt(2.0) * x
        across = 2.0 * radius * (1.0 + e * z) + 3.0 * f * z * x * x
        along = max(a, z * z) + e * radius * radius + f * x**3
        return math.hypot(rising, d) + math.hypot(radius, across, along)
