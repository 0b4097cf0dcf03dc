"""Flows in the order of time: one after another, backwards, again and again."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from pipeline.arrays import Points
from pipeline.errors import FrameError, UsageError
from pipeline.flow.flow import Flow, Part

MOST_ROUNDS = 1000
"""Of a repeated flow within one step."""

SAME_ROUND = 1e-9
"""The share of a period by which a sum of steps may miss its end."""


class Ordered(Flow):
    """A flow that does nothing but to let others act, one at a time."""

    def displace(self, points: Points, time: float, dt: float) -> Points:
        for part in self.parts(time, dt):
            points = part.flow.displace(points, part.time, part.dt)
        return points

    def cache_data(self, time: float, dt: float) -> Any:
        return [part.flow.cache_data(part.time, part.dt) for part in self.parts(time, dt)]


@dataclass(frozen=True)
class Sequence(Ordered):
    """Flows one after another within each step, the first first; with none, everything stays.

    Backwards they act in the other order, so that each undoes what it did.
    """

    flows: tuple[Flow, ...]

    def parts(self, time: float, dt: float) -> Iterator[Part]:
        for flow in self.flows if dt >= 0 else reversed(self.flows):
            yield from flow.parts(time, dt)

    def with_max_step(self, max_step: float) -> Sequence:
        return Sequence(tuple(flow.with_max_step(max_step) for flow in self.flows))

    @property
    def name(self) -> str:
        return ", ".join(flow.name for flow in self.flows)


@dataclass(frozen=True)
class Reversed(Ordered):
    """A flow run backwards in time: what it does from 0 to `duration` seconds is undone in that time."""

    flow: Flow
    duration: float

    def parts(self, time: float, dt: float) -> Iterator[Part]:
        yield from self.flow.parts(self.duration - time, -dt)

    def with_max_step(self, max_step: float) -> Reversed:
        return replace(self, flow=self.flow.with_max_step(max_step))

    @property
    def name(self) -> str:
        return f"reversed {self.flow.name}"


@dataclass(frozen=True)
class Repeated(Ordered):
    """What a flow does from 0 to `period` seconds, again and again.

    A step across the end of a round is cut there, so that rounds are the same whatever the frames are. What a
    flow did in a round stays done: a twist keyed from 0° to 60° adds 60° in each. Raises UsageError for a
    period that is none.
    """

    flow: Flow
    period: float

    def __post_init__(self) -> None:
        if not (self.period > 0 and math.isfinite(self.period)):
            raise UsageError(f"a period of {self.period:g} s has no rounds; it must be above 0, such as 1 s")

    def parts(self, time: float, dt: float) -> Iterator[Part]:
        """Raises FrameError where the rounds of a step are more than MOST_ROUNDS."""
        if abs(dt) > MOST_ROUNDS * self.period:
            raise FrameError(
                f"flow {self.name} at {time:g} s goes through {abs(dt) / self.period:.3g} rounds in a frame; "
                f"{MOST_ROUNDS} are the most. Lengthen its period."
            )
        for start, length in _rounds(time / self.period, dt / self.period):
            yield from self.flow.parts(start * self.period, length * self.period)

    def with_max_step(self, max_step: float) -> Repeated:
        return replace(self, flow=self.flow.with_max_step(max_step))

    @property
    def name(self) -> str:
        return f"repeated {self.flow.name}"


def _rounds(time: float, dt: float) -> Iterator[tuple[float, float]]:
    """A step in periods, cut where rounds end: from where in its round each piece starts, and its length."""
    if dt < 0:  # the same rounds, seen from their ends
        yield from ((1.0 - start, -length) for start, length in _rounds(-time, -dt))
        return
    left = dt
    while True:
        turn = math.floor(time + SAME_ROUND)
        start = max(0.0, time - turn)
        if start + left <= 1.0 + SAME_ROUND:
            yield start, left
            return
        yield start, 1.0 - start
        left -= 1.0 - start
        time = turn + 1.0
