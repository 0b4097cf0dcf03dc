"""The interface of flows: mappings of points during a step of time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

from pipeline.arrays import Points

Displacement = Callable[[Points, float, float], Points]
"""Any callable `points, time, dt -> points` (P1)."""


class Flow(ABC):
    """A mapping of points into points, as it acts during a step of time.

    A flow is a value: pure, without memory, and it neither knows nor cares whether the points are
    particles, control points or the vertices of a mesh (P4).
    """

    @abstractmethod
    def displace(self, points: Points, time: float, dt: float) -> Points:
        """Return the positions of points (N, 3) `dt` seconds after `time`.

        `time` counts seconds from the start of the shot. The given points are not changed. `dt` may be
        negative: the flow then runs backwards.
        """

    @abstractmethod
    def cache_data(self, time: float, dt: float) -> Any:
        """Return all that decides `displace` over this step, JSON-able: equal data, equal motion."""

    def steps(self, time: float, dt: float) -> Iterator[FlowStep]:
        """Yield the flows that act one after another within this step: `displace` is all of them in order."""
        yield FlowStep(self, time, dt)

    def with_max_step(self, max_step: float) -> Flow:
        """Return the flow with no sub-step along velocities longer than `max_step` units."""
        return self

    @property
    def name(self) -> str:
        """The name in error messages."""
        return type(self).__name__.lower()


class FlowStep(NamedTuple):
    """A flow that acts from `time` on, for `dt` seconds."""

    flow: Flow
    time: float
    dt: float


@dataclass(frozen=True)
class Function(Flow):
    """Any Python callable `points, time, dt -> points` as a flow (P1). It may write over its points."""

    displacement: Displacement

    def displace(self, points: Points, time: float, dt: float) -> Points:
        return self.displacement(points.copy(), time, dt)

    def cache_data(self, time: float, dt: float) -> Any:
        return {"function": self.name, "time": time, "dt": dt}

    @property
    def name(self) -> str:
        return getattr(self.displacement, "__qualname__", type(self.displacement).__name__)


def as_flow(flow: Flow | Displacement) -> Flow:
    """Return a flow unchanged, and any other callable wrapped as one."""
    return flow if isinstance(flow, Flow) else Function(flow)
