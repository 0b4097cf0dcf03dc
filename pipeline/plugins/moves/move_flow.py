"""The flow `move`, which carries a subject along a keyed way, its far parts later than the near ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from flowsculpt import Flow
from flowsculpt.api.flows import Number, ParameterDoc, VectorParameter, number_at, vector_at
from flowsculpt.pipeline.plugins.moves.carried import Carried
from flowsculpt.pipeline.plugins.moves.keyed_maps import AffineMap, MapSequence
from flowsculpt.pipeline.plugins.moves.late_flow import LateFlow, Vector


@dataclass(frozen=True)
class Move(LateFlow):
    """Carries the subject along a way and turns it, its far parts later: they drag, and swing out.

    The flows before it act on the subject in its own place: each step undoes the motion, moves the points,
    and carries them again.
    """

    by: Annotated[VectorParameter, ParameterDoc("the way from the first frame on, keyed", "units")] = (
        0.0,
        0.0,
        0.0,
    )
    turn: Annotated[Number, ParameterDoc("about the axis, which goes along, keyed", "degrees")] = 0.0
    axis: Annotated[Vector, "direction", ParameterDoc("of the turn")] = (0.0, 1.0, 0.0)
    centre: Annotated[Vector, ParameterDoc("a point of the axis in the first frame", "units")] = (
        0.0,
        0.0,
        0.0,
    )

    def of_subject(self, subject: Any, place: Vector, before: Any) -> Flow:
        """Return the flow with the flows before it. Raises UsageError for a subject that a file moves."""
        self.require_still(subject)
        return Carried(tuple(before), self, subject, place, MapSequence([MoveMap(self)]))


class MoveMap(AffineMap):
    """The offset and the turn of a `move`, relative to those at the start."""

    def __init__(self, move: Move) -> None:
        self._move = move

    def at(self, time: float) -> Sequence[float]:
        move, length = self._move, math.hypot(*self._move.axis)
        u, c = [x / length for x in move.axis], move.centre
        offset = [b - a for a, b in zip(*(vector_at(move.by, t) for t in (0.0, time)), strict=True)]
        angle = number_at(move.turn, time) - number_at(move.turn, 0.0)
        sine, more = math.sin(angle), 2.0 * math.sin(0.5 * angle) ** 2  # 1 − cos
        cross = (0.0, -u[2], u[1]), (u[2], 0.0, -u[0]), (-u[1], u[0], 0.0)
        numbers = []
        for i in range(3):
            row = [sine * cross[i][j] + more * (u[i] * u[j] - (i == j)) for j in range(3)]
            shift = offset[i] - sum(x * y for x, y in zip(row, c, strict=True))
            numbers += [*(x + (i == j) for j, x in enumerate(row)), shift]
        return numbers
