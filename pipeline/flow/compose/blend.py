"""Flows blended, within a region, and placed: velocity fields compose to fields, other flows to maps.

A sequence is composed flow by flow, so that each of its fields keeps its integration.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.arrays import Points
from pipeline.errors import FrameError
from pipeline.flow.compose.fields import RegionField, ScaledField, Sum, TransformedField
from pipeline.flow.compose.order import Sequence
from pipeline.flow.compose.transforms import Mirror, Placed, Transform
from pipeline.flow.flow import Flow
from pipeline.flow.keyframes import Number, weight_at
from pipeline.flow.regions import Region
from pipeline.flow.streamlines import Streamlines
from pipeline.flow.velocity import VelocityField

CLOSE = 1e-14
"""The distance of an inverse's image from its point, relative to their distance from the origin."""

MAX_ITERATIONS = 100


def within(flow: Flow, region: Region) -> Flow:
    """Return a flow within a region, which weighs velocities of fields and displacements of other flows."""
    return _composed(flow, lambda field: RegionField(field, region), lambda other: Within(other, region))


def placed(flow: Flow, transform: Transform | Mirror) -> Flow:
    """Return a transformed or mirrored flow."""
    return _composed(
        flow, lambda field: TransformedField(field, transform), lambda other: Placed(other, transform)
    )


def blended(first: Flow, second: Flow, weight: Number) -> Flow:
    """Blend two flows: their velocities where each is a velocity field or nothing, else displacements."""
    one, other = _single(first), _single(second)
    fields = [
        ScaledField(flow.field, weight, rest)
        for flow, rest in ((one, True), (other, False))
        if isinstance(flow, Streamlines)
    ]
    if not fields or not all(flow is None or isinstance(flow, Streamlines) for flow in (one, other)):
        return Blend(first, second, weight)
    sum_of = Sum(tuple(fields))
    joined = {replace(flow, field=sum_of) for flow in (one, other) if isinstance(flow, Streamlines)}
    return joined.pop() if len(joined) == 1 else Blend(first, second, weight)


def _single(flow: Flow) -> Flow | None:
    """Return the only flow of a sequence, None for an empty one, and any other flow unchanged."""
    if isinstance(flow, Sequence) and len(flow.flows) < 2:
        return _single(flow.flows[0]) if flow.flows else None
    return flow


def _composed(
    flow: Flow, field: Callable[[VelocityField], VelocityField], other: Callable[[Flow], Flow]
) -> Flow:
    if isinstance(flow, Sequence):
        return Sequence(tuple(_composed(part, field, other) for part in flow.flows))
    if isinstance(flow, Streamlines):
        return replace(flow, field=field(flow.field))
    return other(flow)


class _Weighted(Flow):
    """A map with a weighted displacement. Backwards it is inverted to the last digits."""

    def displace(self, points: Points, time: float, dt: float) -> Points:
        if dt >= 0:
            return self._forwards(points, time, dt)
        return inverse(lambda start: self._forwards(start, time + dt, -dt), points, self.name)

    @abstractmethod
    def _forwards(self, points: Points, time: float, dt: float) -> Points:
        """Return `displace` for dt of 0 or more."""


def inverse(move: Callable[[Points], Points], points: Points, name: str) -> Points:
    """Return the points (N, 3) that `move` takes to `points`: q with move(q) = p, by q ← q + p − move(q).

    The iteration converges where two points move differently by less than their distance, as in the step of
    a frame without folds. Each point iterates until it is exact, independently of the others.

    Raises FrameError, which calls the map `name`, where it does not converge.
    """
    starts = np.array(points, dtype=np.float64)
    active = np.arange(len(starts))
    size = CLOSE * (1.0 + np.abs(starts).max(axis=1, initial=0.0))
    for _ in range(MAX_ITERATIONS):
        missed = points[active] - move(starts[active])
        starts[active] += missed
        active = active[~(np.abs(missed).max(axis=1, initial=0.0) <= size[active])]
        if not len(active):
            return starts
    where = ", ".join(f"{x:.4g}" for x in points[active[0]])
    raise FrameError(
        f"flow {name} cannot be undone at ({where}): it folds the space there within a frame. "
        "Lower its strength or widen its falloff."
    )


@dataclass(frozen=True)
class Blend(_Weighted):
    """A blend of two flows: (1 − weight) × the displacement of `first` + weight × that of `second`.

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
        second = self.second.cache_data(time, dt) if weight != 0 else None
        return {"blend": weight, "from": first, "to": second}

    def with_max_step(self, max_step: float) -> Blend:
        first, second = self.first.with_max_step(max_step), self.second.with_max_step(max_step)
        return replace(self, first=first, second=second)

    @property
    def name(self) -> str:
        return f"blend of {self.first.name or 'nothing'} and {self.second.name or 'nothing'}"


@dataclass(frozen=True)
class Within(_Weighted):
    """A flow within a region: a point's displacement times the region's weight where the point starts.

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
