"""What a flow is: anything that says where points go during a step of time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from pipeline.arrays import Floats, Points

Displacement = Callable[[Points, float, float], Points]
"""Any callable `points, time, dt -> points` (P1)."""


class Flow(ABC):
    """A mapping of points into points, as it acts during a step of time.

    A flow is a value: pure, without memory, and it neither knows nor cares whether the points are
    particles, control points or the vertices of a mesh (P4).
    """

    @abstractmethod
    def displace(self, points: Points, time: float, dt: float) -> Points:
        """Where points (N, 3) are `dt` seconds after `time`, in seconds from the start of the shot.

        The points given are not changed. `dt` may be negative: the flow then runs backwards.
        """

    @abstractmethod
    def cache_data(self, time: float, dt: float) -> Any:
        """All that decides `displace` over this step, as JSON-able data: equal data, equal motion."""

    def parts(self, time: float, dt: float) -> Iterator[Part]:
        """What acts one after another within this step: `displace` is all of it in order."""
        yield Part(self, time, dt)

    def with_max_step(self, max_step: float) -> Flow:
        """Return this flow with sub-steps that take no point further than `max_step` units."""
        return self

    @property
    def name(self) -> str:
        """What error messages call it."""
        return type(self).__name__.lower()


class Part(NamedTuple):
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


def transformed(matrix: Floats, points: Points) -> Points:
    """matrix (3, 3) · each of points (N, 3), with the same bits whatever the other points are."""
    x, y, z = points.T[:, :, None]
    out: Points = x * matrix[:, 0] + y * matrix[:, 1] + z * matrix[:, 2]
    return out


def for_kernels(points: Points) -> Points:
    """Points (N, 3) as the kernels' declared type; a read-only array would be another type to compile for."""
    return np.require(points, np.float64, ["C", "W"])


def as_flow(flow: Flow | Displacement) -> Flow:
    """A flow as it is; any other callable wrapped as one."""
    return flow if isinstance(flow, Flow) else Function(flow)
