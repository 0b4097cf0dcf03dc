"""Flows made of flows: in sequence, backwards, repeated, transformed, mirrored, summed, blended, in a region.

Velocity fields compose to fields, other flows to maps. A composed field is one program with brackets,
followed by one integration. A sequence is composed flow by flow, so that each of its fields keeps its
integration.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Self

import numpy as np

from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.errors import FrameError, UsageError
from flowsculpt.pipeline.flow.flow import Flow, FlowStep
from flowsculpt.pipeline.flow.parameters import (
    ORIGIN,
    Number,
    Vector,
    VectorParameter,
    X,
    number_at,
    transform,
    unit,
    vector_at,
    weight_at,
)
from flowsculpt.pipeline.flow.regions import MAX_SLOPE, Region
from flowsculpt.pipeline.flow.streamlines import Streamlines
from flowsculpt.pipeline.flow.velocity import (
    ModifiedField,
    Program,
    VelocityField,
    grouped,
    scaled,
    transformed,
)

MAX_ROUNDS = 1000  # rounds of a repeated flow within one step
ROUND_TOLERANCE = 1e-9  # the share of a period by which a sum of steps may miss its end


@dataclass(frozen=True)
class _Composed(Flow):
    """A flow made of those in its fields."""

    def with_max_step(self, max_step: float) -> Self:
        def bounded(value: Any) -> Any:
            if isinstance(value, tuple):
                return tuple(map(bounded, value))
            return value.with_max_step(max_step) if isinstance(value, Flow) else value

        return replace(self, **{part.name: bounded(getattr(self, part.name)) for part in fields(self)})


class _Ordered(_Composed):
    """A flow that consists of the steps of other flows."""

    def displace(self, points: Points, time: float, dt: float) -> Points:
        for step in self.steps(time, dt):
            points = step.flow.displace(points, step.time, step.dt)
        return points

    def cache_data(self, time: float, dt: float) -> Any:
        return [step.flow.cache_data(step.time, step.dt) for step in self.steps(time, dt)]


@dataclass(frozen=True)
class Sequence(_Ordered):
    """Flows one after another within each step, the first first; with none, nothing moves.

    Backwards they act in the opposite order, so that each undoes its own motion.
    """

    flows: tuple[Flow, ...]

    @property
    def members(self) -> tuple[Flow, ...]:
        return self.flows

    def steps(self, time: float, dt: float) -> Iterator[FlowStep]:
        for flow in self.flows if dt >= 0 else reversed(self.flows):
            yield from flow.steps(time, dt)

    @property
    def name(self) -> str:
        return ", ".join(flow.name for flow in self.flows)


@dataclass(frozen=True)
class Reversed(_Ordered):
    """A flow run backwards in time: it undoes within `duration` seconds its motion from 0 to `duration`."""

    flow: Flow
    duration: float

    def steps(self, time: float, dt: float) -> Iterator[FlowStep]:
        yield from self.flow.steps(self.duration - time, -dt)

    @property
    def name(self) -> str:
        return f"reversed {self.flow.name}"


@dataclass(frozen=True)
class Repeated(_Ordered):
    """A flow from 0 to `period` seconds, repeated.

    A step across the end of a round is cut there, so that rounds do not depend on the frames. The motion of a
    round stays: a twist keyed from 0° to 60° adds 60° in each. Raises UsageError for an invalid period.
    """

    flow: Flow
    period: float

    def __post_init__(self) -> None:
        if not (self.period > 0 and math.isfinite(self.period)):
            raise UsageError(f"period is {self.period:g} s; it must be above 0, such as 1 s")

    def steps(self, time: float, dt: float) -> Iterator[FlowStep]:
        """Yield the steps of all rounds. Raises FrameError where they are more than MAX_ROUNDS."""
        if abs(dt) > MAX_ROUNDS * self.period:
            raise FrameError(
                f"flow {self.name} at {time:g} s goes through {abs(dt) / self.period:.3g} rounds in a frame; "
                f"{MAX_ROUNDS} are the most. Lengthen its period."
            )
        for start, length in _rounds(time / self.period, dt / self.period):
            yield from self.flow.steps(start * self.period, length * self.period)

    @property
    def name(self) -> str:
        return f"repeated {self.flow.name}"


def _rounds(time: float, dt: float) -> Iterator[tuple[float, float]]:
    """Cut a step, in periods, where rounds end: yield each piece's start within its round, and its length."""
    if dt < 0:  # the same rounds, seen from their ends
        yield from ((1.0 - start, -length) for start, length in _rounds(-time, -dt))
        return
    left = dt
    while True:
        turn = math.floor(time + ROUND_TOLERANCE)
        start = max(0.0, time - turn)
        if start + left <= 1.0 + ROUND_TOLERANCE:
            yield start, left
            return
        yield start, 1.0 - start
        left -= 1.0 - start
        time = turn + 1.0


@dataclass(frozen=True)
class Transform:
    """Scale, then rotation, then translation; all may be keyed.

    translate  position of the origin
    rotate     radians about x, then y, then z (Blender's *XYZ Euler*), about the origin
    scale      a factor above 0
    """

    translate: VectorParameter = ORIGIN
    rotate: VectorParameter = ORIGIN
    scale: Number = 1.0
    name: ClassVar = "placed"

    def at(self, time: float) -> tuple[Floats, Floats]:
        """Return the origin (3,) and the axes, the columns of a matrix (3, 3).

        Raises FrameError where the scale is not above 0, or not finite.
        """
        scale = float(number_at(self.scale, time))
        if not 0 < scale < math.inf:
            fact = f"a frame has the scale {scale:g} at {time:g} s; it must be above 0, and finite"
            raise FrameError(f"{fact}. Correct its keys.")
        (cx, cy, cz), (sx, sy, sz) = (
            [function(angle) for angle in vector_at(self.rotate, time)] for function in (math.cos, math.sin)
        )
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
        about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
        about_z = np.array([[cz, -sz, 0.0], [sz, cz, 0.0], [0.0, 0.0, 1.0]])
        return np.array(vector_at(self.translate, time)), scale * (about_z @ about_y @ about_x)


@dataclass(frozen=True)
class Mirror:
    """A reflection across the plane through `centre` with the normal `normal`."""

    normal: Vector = X
    centre: Vector = ORIGIN
    name: ClassVar = "mirrored"

    def at(self, time: float) -> tuple[Floats, Floats]:
        """Return the images of the origin (3,) and of the axes, the columns of a matrix (3, 3)."""
        normal, centre = np.array(unit(self.normal)), np.array(self.centre)
        axes: Floats = np.eye(3) - 2.0 * np.outer(normal, normal)
        return centre - axes @ centre, axes


@dataclass(frozen=True)
class Placed(Flow):
    """A flow transformed like an object, distances and speeds alike; or mirrored.

    A moving transform moves the flow, not the points. It is taken at the middle of each step.
    """

    flow: Flow
    transform: Transform | Mirror
    max_step: float | None = None

    def displace(self, points: Points, time: float, dt: float) -> Points:
        origin, axes = self.transform.at(time + dt / 2)
        back: Floats = np.linalg.inv(axes).astype(np.float64)
        inside = transform(back, points - origin)
        return transform(axes, self._inside(axes).displace(inside, time, dt)) + origin

    def cache_data(self, time: float, dt: float) -> Any:
        origin, axes = self.transform.at(time + dt / 2)
        flow = self._inside(axes).cache_data(time, dt)
        return {"placed": [origin.tolist(), axes.tolist()], "flow": flow}

    def with_max_step(self, max_step: float) -> Placed:
        return replace(self, max_step=max_step)

    def _inside(self, axes: Floats) -> Flow:
        """Return the flow with the maximum step in its own units."""
        scale = float(np.linalg.norm(axes[:, 0]))
        return self.flow if self.max_step is None else self.flow.with_max_step(self.max_step / scale)

    @property
    def name(self) -> str:
        return f"{self.transform.name} {self.flow.name}"


GRID = 9  # samples of the speed of a field in a region, along each side of the region's box
JUMP = 0.05  # the length scale where a region has no falloff, of half the shortest side of its box
CLOSE = 1e-14  # the distance of an inverse's image from its point, relative to their distance from the origin

MAX_ITERATIONS = 100


@dataclass(frozen=True)
class Sum(VelocityField):
    """Velocities added up, then integrated together, in any order, by `Streamlines(Sum((one, other)))`."""

    fields: tuple[VelocityField, ...]

    def program(self, time: float) -> Program:
        return tuple(row for field in self.fields for row in field.program(time))

    def gradient_bound(self, time: float) -> float:
        return sum(field.gradient_bound(time) for field in self.fields)

    def length_scale(self, time: float) -> float:
        return min((f.length_scale(time) for f in self.fields if f.gradient_bound(time) > 0), default=np.inf)

    def leaves(self, point: Points, time: float) -> Iterator[tuple[VelocityField, Points]]:
        for field in self.fields:
            yield from field.leaves(point, time)

    @property
    def name(self) -> str:
        return " + ".join(field.name for field in self.fields)


@dataclass(frozen=True)
class ScaledField(ModifiedField):
    """A field with its velocities multiplied by a weight from 0 to 1, or by the `rest`, 1 − weight."""

    weight: Number
    rest: bool = False

    def program(self, time: float) -> Program:
        return scaled(self.field.program(time), self._factor(time))

    def gradient_bound(self, time: float) -> float:
        return self._factor(time) * self.field.gradient_bound(time)

    def _factor(self, time: float) -> float:
        weight = weight_at(self.weight, time, self.name)
        return 1.0 - weight if self.rest else weight


@dataclass(frozen=True)
class RegionField(ModifiedField):
    """A field within a region: its velocities times the region's weight at each point and time."""

    region: Region

    def program(self, time: float) -> Program:
        return grouped(self.field.program(time), self.region.closing(time))

    def gradient_bound(self, time: float) -> float:
        """Return the field's bound, plus the slope of the falloff times the largest speed in it.

        The speed is sampled on a grid over the region and its falloff, with a margin for between the samples.
        Without a falloff the field's bound counts alone.
        """
        inside, falloff = self.field.gradient_bound(time), self.region.falloff_at(time)
        if falloff <= 0:
            return inside
        middle, half = self.region.bounds(time)
        lines = [np.linspace(m - h, m + h, GRID) for m, h in zip(middle, half, strict=True)]
        grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
        fastest = float(np.linalg.norm(self.field.velocity(grid, time), axis=1).max())
        between = inside * float(np.linalg.norm(half)) / (GRID - 1)
        return inside + MAX_SLOPE[self.region.falloff_type] / falloff * (fastest + between)

    def length_scale(self, time: float) -> float:
        """Return the field's, or the falloff. Where the velocity jumps, return a small part of the region."""
        falloff = self.region.falloff_at(time)
        _, half = self.region.bounds(time)
        return min(self.field.length_scale(time), falloff if falloff > 0 else JUMP * min(half))

    @property
    def name(self) -> str:
        return f"{self.field.name} within a {self.region.name}"


@dataclass(frozen=True)
class TransformedField(ModifiedField):
    """A field with a transform, keyed or not, or a mirror: see `Placed`. Speeds and distances scale alike."""

    transform: Transform | Mirror

    def program(self, time: float) -> Program:
        origin, axes = self.transform.at(time)
        return transformed(self.field.program(time), tuple(origin.tolist()), axes)

    def length_scale(self, time: float) -> float:
        shortest = float(np.linalg.norm(self.transform.at(time)[1], ord=-2))
        return shortest * self.field.length_scale(time)

    def leaves(self, point: Points, time: float) -> Iterator[tuple[VelocityField, Points]]:
        origin, axes = self.transform.at(time)
        return self.field.leaves(np.asarray(np.linalg.solve(axes, point - origin), np.float64), time)

    @property
    def name(self) -> str:
        return f"{self.transform.name} {self.field.name}"


def within(flow: Flow, region: Region) -> Flow:
    """Return a flow within a region, which weighs velocities of fields and displacements of other flows."""
    return _composed(flow, lambda field: RegionField(field, region), lambda other: Within(other, region))


def placed(flow: Flow, transform: Transform | Mirror) -> Flow:
    """Return a transformed or mirrored flow."""
    return _composed(flow, lambda f: TransformedField(f, transform), lambda other: Placed(other, transform))


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


class _Weighted(_Composed):
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
        f"flow {name} cannot be undone at ({where}): it folds space there within a frame. "
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
        weight, moved = weight_at(self.weight, time + dt / 2, self.name), points
        for flow, share in ((self.first, 1.0 - weight), (self.second, weight)):
            if share:
                moved = moved + share * (flow.displace(points, time, dt) - points)
        return moved

    def cache_data(self, time: float, dt: float) -> Any:
        weight = weight_at(self.weight, time + dt / 2, self.name)
        first = self.first.cache_data(time, dt) if weight != 1 else None
        second = self.second.cache_data(time, dt) if weight != 0 else None
        return {"blend": weight, "from": first, "to": second}

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

    @property
    def name(self) -> str:
        return f"{self.flow.name} within a {self.region.name}"
