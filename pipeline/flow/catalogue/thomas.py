"""Thomas' attractor as a flow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.catalogue.attractor import Attractor
from pipeline.flow.choreography import Number, number_at
from pipeline.flow.parameters import Positive, Sense


@dataclass(frozen=True)
class Thomas(Attractor):
    """A lattice of coils that points wander through, the same along all three axes.

        x' = sin y − b x    y' = sin z − b y    z' = sin x − b z

    It is about 8 of its units wide. The divergence is −3 b × time_scale: near b = 0 it keeps volume and
    fills space.

    Source: Thomas, *Deterministic chaos seen in terms of feedback circuits*, Int. J. Bifurcation and Chaos 9
    (1999).
    """

    b: Annotated[Number, Sense("b: how strongly it is held together")] = 0.208186
    scale: Annotated[Positive, Sense("of its units in one of the scene's")] = 4.0
    time_scale: Annotated[Number, Sense("of its time units in a second")] = 1.5

    @property
    def kind(self) -> int:
        return op.THOMAS

    def _numbers(self, time: float) -> tuple[float, ...]:
        return (number_at(self.b, time),)

    def _gradient(self, time: float) -> float:
        return 1.0 + abs(number_at(self.b, time))
