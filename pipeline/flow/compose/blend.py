"""Maps in part: between two, or within a region. What is weighed is the way a point goes in a step."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Any

from pipeline.arrays import Points
from pipeline.flow.choreography import Number
from pipeline.flow.compose.inverse import undone
from pipeline.flow.compose.weight import weight_at
from pipeline.flow.flow import Flow
from pipeline.flow.regions import Region


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

    def acting(self, time: float, dt: float) -> Any:
        weight = weight_at(self.weight, time + dt / 2, self.name)
        first = self.first.acting(time, dt) if weight != 1 else None
        return {"blend": weight, "from": first, "to": self.second.acting(time, dt) if weight != 0 else None}

    def striding(self, stride: float) -> Blend:
        return replace(self, first=self.first.striding(stride), second=self.second.striding(stride))

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

    def acting(self, time: float, dt: float) -> Any:
        return {"within": self.region.acting(time + dt / 2), "flow": self.flow.acting(time, dt)}

    def striding(self, stride: float) -> Within:
        return replace(self, flow=self.flow.striding(stride))

    @property
    def name(self) -> str:
        return f"{self.flow.name} within a {self.region.name}"
