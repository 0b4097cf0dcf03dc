"""Maps undone without a formula for their inverse."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.arrays import Points
from pipeline.errors import FrameError
from pipeline.flow.compose.fields import InFrame, Limited, Scaled, Sum, weight_at
from pipeline.flow.compose.order import Sequence
from pipeline.flow.compose.space import Frame, Mirror, Placed
from pipeline.flow.flow import Flow
from pipeline.flow.keyframes import Number
from pipeline.flow.regions import Region
from pipeline.flow.streamlines import Streamlines
from pipeline.flow.velocity import VelocityField

CLOSE = 1e-14
"""How near the image of the point found lies to the point given, as a share of how far out both are."""

MOST_TURNS = 100


def undone(move: Callable[[Points], Points], points: Points, name: str) -> Points:
    """The points (N, 3) that `move` takes to `points`: q with move(q) = p, by q ← q + p − move(q).

    The turns close in where two points move differently by less than they lie apart, as they do in the step
    of a frame that folds nothing. Each point takes turns until it is there, whatever the others do.

    Raises FrameError, which calls the map `name`, where that does not come about.
    """
    found = np.array(points, dtype=np.float64)
    waiting = np.arange(len(found))
    size = CLOSE * (1.0 + np.abs(found).max(axis=1, initial=0.0))
    for _ in range(MOST_TURNS):
        missed = points[waiting] - move(found[waiting])
        found[waiting] += missed
        waiting = waiting[~(np.abs(missed).max(axis=1, initial=0.0) <= size[waiting])]
        if not len(waiting):
            return found
    where = ", ".join(f"{x:.4g}" for x in points[waiting[0]])
    raise FrameError(
        f"flow {name} cannot be undone at ({where}): there it folds the space within a frame. "
        "Lower its strength or widen its falloff."
    )


class Weighed(Flow):
    """A map whose way is weighed. Backwards it is undone to the last digits, by the weights there were."""

    def displace(self, points: Points, time: float, dt: float) -> Points:
        if dt >= 0:
            return self._forwards(points, time, dt)
        return undone(lambda there: self._forwards(there, time + dt, -dt), points, self.name)

    @abstractmethod
    def _forwards(self, points: Points, time: float, dt: float) -> Points:
        """`displace` with dt of 0 or more."""


@dataclass(frozen=True)
class Blend(Weighed):
    """Between two flows: the way of a point is (1 − weight) × that of `first` + weight × that of `second`.

    weight  0 to 1, taken at the middle of each step
    """

    first: Flow
    second: Flow
    weight: Number

    def _forwards(self, points: Points, time: float, dt: float) -> Points:
        weight = weight_at(self.weight, time + dt / 2, self.name)
        moved = points
        for flow, share in ((self.first, 1.0 - weight), (self.second, weight)):
            if share:
                moved = moved + share * (flow.displace(points, time, dt) - points)
        return moved

    def cache_data(self, time: float, dt: float) -> Any:
        weight = weight_at(self.weight, time + dt / 2, self.name)
        first = self.first.cache_data(time, dt) if weight != 1 else None
        return {
            "blend": weight,
            "from": first,
            "to": self.second.cache_data(time, dt) if weight != 0 else None,
        }

    def with_max_step(self, max_step: float) -> Blend:
        return replace(
            self, first=self.first.with_max_step(max_step), second=self.second.with_max_step(max_step)
        )

    @property
    def name(self) -> str:
        return f"blend of {self.first.name or 'nothing'} and {self.second.name or 'nothing'}"


@dataclass(frozen=True)
class Within(Weighed):
    """A flow within a region: the way of a point is multiplied by the region's weight where it starts.

    The region is taken at the middle of each step.
    """

    flow: Flow
    region: Region

    def _forwards(self, points: Points, time: float, dt: float) -> Points:
        weight = self.region.weight(points, time + dt / 2)[:, None]
        return points + weight * (self.flow.displace(points, time, dt) - points)

    def cache_data(self, time: float, dt: float) -> Any:
        return {"within": self.region.cache_data(time + dt / 2), "flow": self.flow.cache_data(time, dt)}

    def with_max_step(self, max_step: float) -> Within:
        return replace(self, flow=self.flow.with_max_step(max_step))

    @property
    def name(self) -> str:
        return f"{self.flow.name} within a {self.region.name}"


def within(flow: Flow, region: Region) -> Flow:
    """A flow within a region: velocities are weighed where there are any, else the way of a step."""
    return _composed(flow, lambda field: Limited(field, region), lambda other: Within(other, region))


def placed(flow: Flow, frame: Frame | Mirror) -> Flow:
    """A flow in a frame, or in a mirror."""
    return _composed(flow, lambda field: InFrame(field, frame), lambda other: Placed(other, frame))


def blended(first: Flow, second: Flow, weight: Number) -> Flow:
    """Between two flows: of velocities where each is a velocity field or nothing, else of ways."""
    one, other = _only(first), _only(second)
    fields = [
        Scaled(flow.field, weight, rest)
        for flow, rest in ((one, True), (other, False))
        if isinstance(flow, Streamlines)
    ]
    if not fields or not all(flow is None or isinstance(flow, Streamlines) for flow in (one, other)):
        return Blend(first, second, weight)
    sum_of = Sum(tuple(fields))
    joined = {replace(flow, field=sum_of) for flow in (one, other) if isinstance(flow, Streamlines)}
    return joined.pop() if len(joined) == 1 else Blend(first, second, weight)


def _only(flow: Flow) -> Flow | None:
    """The one flow that it is, None for nothing."""
    if isinstance(flow, Sequence) and len(flow.flows) < 2:
        return _only(flow.flows[0]) if flow.flows else None
    return flow


def _composed(
    flow: Flow, field: Callable[[VelocityField], VelocityField], other: Callable[[Flow], Flow]
) -> Flow:
    if isinstance(flow, Sequence):
        return Sequence(tuple(_composed(part, field, other) for part in flow.flows))
    if isinstance(flow, Streamlines):
        return replace(flow, field=field(flow.field))
    return other(flow)
