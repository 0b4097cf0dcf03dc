"""What a flow is: anything that says where points go during a step of time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.arrays import Points
from pipeline.errors import FrameError

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
    def acting(self, time: float, dt: float) -> Any:
        """All that decides `displace` over this step, as JSON-able data: equal data, equal motion."""

    @property
    def name(self) -> str:
        """What error messages call it."""
        return type(self).__name__.lower()


@dataclass(frozen=True)
class Function(Flow):
    """Any Python callable `points, time, dt -> points` as a flow (P1)."""

    displacement: Displacement

    def displace(self, points: Points, time: float, dt: float) -> Points:
        return self.displacement(points, time, dt)

    def acting(self, time: float, dt: float) -> Any:
        return {"function": self.name, "time": time, "dt": dt}

    @property
    def name(self) -> str:
        return getattr(self.displacement, "__qualname__", type(self.displacement).__name__)


def as_flow(flow: Flow | Displacement) -> Flow:
    """A flow as it is; any other callable wrapped as one."""
    return flow if isinstance(flow, Flow) else Function(flow)


def displaced(flow: Flow, points: Points, time: float, dt: float, frame: int) -> Points:
    """`flow.displace`, trusted by nobody: a new float64 array (N, 3) of finite numbers, or a FrameError.

    The error names the flow, the frame, the first bad vertex and where that vertex was.
    """
    place = f"frame {frame}: flow {flow.name}"
    try:
        moved = np.array(flow.displace(points.copy(), time, dt), dtype=np.float64)
    except FrameError as error:
        raise FrameError(f"frame {frame}: {error}") from error
    except Exception as error:
        raise FrameError(
            f"{place} raised {type(error).__name__}: {error}; a flow takes points (N, 3), time and dt "
            f"and returns points (N, 3). Call it alone with {len(points)} points at time {time:g} s."
        ) from error
    if moved.shape != points.shape:
        raise FrameError(
            f"{place} returned an array of shape {moved.shape} for points of shape {points.shape}; "
            "a flow returns one point for each it is given. Return all points, moved or not."
        )
    finite = np.isfinite(moved).all(axis=1)
    if not finite.all():
        vertex = int(np.argmin(finite))
        where = ", ".join(f"{x:.4g}" for x in points[vertex])
        raise FrameError(
            f"{place} moved vertex {vertex} from ({where}) to {moved[vertex].tolist()}; points must stay "
            "finite. Lower the flow's strength, or raise substeps if it grows from frame to frame."
        )
    return moved
