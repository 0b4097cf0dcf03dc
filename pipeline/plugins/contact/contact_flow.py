"""The flow `contact`, which keeps a subject above a floor, and away from other subjects."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np

from flowsculpt import Flow, FrameError, Sequence, UsageError
from flowsculpt.api.flows import Number, ParameterDoc, PositiveNumber, number_at
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.contact import PLUGIN
from flowsculpt.pipeline.plugins.contact.earlier_motion import EarlierMotion
from flowsculpt.pipeline.plugins.contact.obstacles import Obstacle
from flowsculpt.pipeline.plugins.contact.squash import Press, Squash

FLOATING = 5.0
"""Thousandths of a subject's height above the floor from which on it is seen to float."""

SINKING = 2.0
"""Thousandths of a subject's height in another subject from which on it is seen to sink in."""

SUNK = 0.02
"""Of a subject's height: how deep in another it may begin, as edges are round in contact and not in fact."""

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Contact(Flow):
    """Keeps the subject above a floor and out of others: what is pushed in is squashed, and spreads.

    The flows before it act on the subject as it would be alone: each step undoes the squash, moves
    the points, and squashes them again. So nothing accumulates, and a subject that rises is as it was.

    floor   its height; None is that of the subject's lowest point at the start
    others  names of the subjects that it gives way to
    side    direction from those to it; None is that of the widest gap at the start
    times   those of all frames, seconds, for `findings`
    """

    floor: Number | None = None
    softness: Annotated[PositiveNumber, ParameterDoc("height of the zone that gives way", "units")] = 1.0
    keep_volume: Annotated[bool, ParameterDoc("false keeps the width instead")] = True
    side: Vector | None = None
    has_floor: bool = True
    others: tuple[str, ...] = ()
    times: tuple[float, ...] = field(default=(), compare=False, repr=False)

    def displace(self, points: Floats, time: float, dt: float) -> Floats:
        """Refuse to move points of which no subject is known."""
        raise UsageError("contact acts on one subject, as an entry of flows. Take it out of its composition.")

    def cache_data(self, time: float, dt: float) -> Any:
        ends = [self.numbers(t) for t in (time, time + dt)]
        data = {"plugin": [PLUGIN.name, PLUGIN.version], "keep_volume": self.keep_volume, "ends": ends}
        others = {"has_floor": self.has_floor, "side": self.side, "relief": 3}
        return {**data, **others} if self.others else data

    def numbers(self, time: float) -> list[float | None]:
        """Return the height of the floor, None for the lowest point at the start, and the softness."""
        floor = None if self.floor is None else float(number_at(self.floor, time))
        return [floor, float(number_at(self.softness, time))]

    def of_subject(self, subject: Any, place: Vector, before: Any) -> Flow:
        """Return the flow with the flows before it. Raises UsageError for a subject that a file moves."""
        if getattr(subject, "keeps_faces", False):
            raise UsageError("contact does not act on a model that its file moves. Remove it.")
        return InContact(tuple(before), self, EarlierMotion(subject, place, Sequence(tuple(before))))


class Meeting(NamedTuple):
    """A subject and a floor, or another subject, at one time.

    with_what  in words
    floor      its height, units; of another subject 0, or how deep in it the subject begins, below 0
    gap        height of the subject's lowest point above it if nothing gave way, units; below 0 where pressed
    """

    with_what: str
    floor: float
    gap: float
    map: Squash | Press

    def gap_of(self, points: Floats) -> float:
        """Return the height of the lowest of points (N, 3) above it, units."""
        if isinstance(self.map, Squash):
            return float(points[:, 1].min()) - self.floor
        seen = points @ self.map.axes.T
        return float((seen[:, 1] - self.map.heights.at(seen)).min()) - self.floor


@dataclass(frozen=True)
class InContact(Sequence):
    """Flows that move a subject, which gives way to a floor and to other subjects.

    flows      those before `contact`
    contact    the settings
    earlier    where the flows alone move the subject, of which the maps at each time follow
    obstacles  the other subjects
    meetings   those already known, by their times
    """

    acts_around_earlier = True
    name: ClassVar[str] = "contact"

    contact: Contact
    earlier: EarlierMotion = field(compare=False)
    obstacles: tuple[Obstacle, ...] = field(default=(), compare=False)
    meetings: dict[float, tuple[Meeting, ...]] = field(default_factory=dict, compare=False, repr=False)

    def steps(self, time: float, dt: float) -> Iterator[Any]:
        """Yield the undoing of the maps at the start, the steps of the flows, and the maps at the end."""
        count = len(self.obstacles) + self.contact.has_floor
        for number in reversed(range(count)):
            yield from Squashing(self, number, is_inverse=True).steps(time, dt)
        yield from super().steps(time, dt)
        for number in range(count):
            yield from Squashing(self, number, is_inverse=False).steps(time, dt)

    def beside(self, name: str, subjects: Mapping[str, Any]) -> InContact:
        """Return the flow with the others. Raises UsageError for one that is not there, or a circle."""
        others = [other for other in self.contact.others if other != name]
        for other in others:
            if other not in subjects:
                known = [each for each in subjects if each != name]
                remedy = f"Write {' or '.join(known)}" if known else "Put it beside this one, under subjects"
                raise UsageError(f"contact: the shot has no other subject {other}. {remedy}.")
            _require_no_circle((name, other), subjects)
        earlier = EarlierMotion(self.earlier.subject, self.earlier.place, self.earlier.flow, name, subjects)
        obstacles = tuple(Obstacle(other, earlier, subjects, self.contact.side) for other in others)
        return replace(self, earlier=earlier, obstacles=obstacles, meetings={})

    def meetings_at(self, time: float) -> tuple[Meeting, ...]:
        """Return how it meets the others, in order, and the floor at a time.

        Raises FrameError for a subject that begins within another, or below the floor.
        """
        time = round(time, 12)  # the end of a step and the start of the next differ by rounding
        if time not in self.meetings:
            self.meetings[time] = tuple(self._meet(time))
        return self.meetings[time]

    def _meet(self, time: float) -> Iterator[Meeting]:
        softness = float(number_at(self.contact.softness, time))
        if not softness > 0:
            raise FrameError(f"softness is {softness:g}; it must be above 0. Correct its keys.")
        points = self.earlier.points(time)
        for number, obstacle in enumerate(self.obstacles):
            meeting = self._meet_other(obstacle, points, time, softness)
            yield meeting
            if self.contact.has_floor or number + 1 < len(self.obstacles):
                points = meeting.map.apply(points)
        if self.contact.has_floor:
            self._require_above()
            floor, least, most = self.floor(time), points.min(axis=0), points.max(axis=0)
            lowest, middle = float(least[1]), 0.5 * (least + most)
            axis, spreads = (float(middle[0]), float(middle[2])), self.contact.keep_volume
            squash = Squash.of(floor, softness, self.earlier.margin, lowest, axis, spreads)
            yield Meeting("the floor", floor, lowest - floor, squash)

    def _meet_other(self, obstacle: Obstacle, points: Floats, time: float, softness: float) -> Meeting:
        """Return how the subject, with points (N, 3), meets another one. Raises FrameError as `_meet`."""
        axes, heights = obstacle.relief(time, 1.0 / softness)
        seen = points @ axes.T
        above = seen[:, 1] - heights.at(seen)
        gap = float(above.min())
        if time == 0.0 and gap < -SUNK * self.earlier.height:
            raise FrameError(
                f"the subject begins {-gap:.4g} units within {obstacle.name}, as seen along "
                f"{[round(float(x), 3) for x in axes[1]]}. Place it farther away, or write side: the "
                "direction in which it gives way."
            )
        number = self.obstacles.index(obstacle)
        sunk = min(0.0, gap) if time == 0.0 else self.meetings_at(0.0)[number].floor
        # near the deepest point, which then stays where it is seen from the side
        weights = np.maximum(0.0, gap + 0.5 * softness - above) ** 2
        a, b = (float(weights @ seen[:, k] / weights.sum()) for k in (0, 2))
        squash = Squash.of(sunk, softness, self.earlier.margin, gap, (a, b), self.contact.keep_volume)
        press = Press(axes, heights, squash, float(seen[:, 1].min()), softness)
        return Meeting(obstacle.name, sunk, gap - sunk, press)

    def floor(self, time: float) -> float:
        """Return the height of the floor, units."""
        floor = self.contact.numbers(time)[0]
        return float(self.earlier.points(0.0)[:, 1].min()) if floor is None else floor

    def findings(self) -> Iterator[tuple[str, bool]]:
        """Yield how far it rises above what it meets and is pressed; warn where it never touches that."""
        yield from self._findings([self._pressed_points(time) for time in self.contact.times])

    def _findings(self, ends: list[Floats]) -> Iterator[tuple[str, bool]]:
        """Yield them, given the points (N, 3) of each time once the last of several entries has acted."""
        for part in self.flows:
            yield from part._findings(ends) if isinstance(part, InContact) else part.findings()
        for meetings in self._meetings_of(self.contact.times):
            gaps, name = [meeting.gap for meeting in meetings], meetings[0].with_what
            least, most = (1000.0 * gap / self.earlier.height for gap in (min(gaps), max(gaps)))
            yield (
                f"contact: the lowest point rises up to {max(0.0, most):.0f} thousandths of the subject's "
                f"height above {name}, and is pressed by up to {max(0.0, -least):.0f}",
                False,
            )
            yield from self._sinking(meetings, ends)
            if least < -SINKING and self.contact.keep_volume and self.earlier.of_copies is not None:
                fact = f"copies are squashed about one axis: {name} draws those beside it outwards"
                yield f"contact: {fact}. Write keep_volume: false.", True
            if least > FLOATING:
                yield self._floating(name, least, min(gaps)), True

    def _meetings_of(self, times: Iterable[float]) -> Iterator[tuple[Meeting, ...]]:
        """Yield the meetings at these times with each of what it meets, those of an entry in order."""
        yield from zip(*(self.meetings_at(time) for time in times), strict=True)

    def _sinking(self, meetings: Iterable[Meeting], ends: Iterable[Floats]) -> Iterator[tuple[str, bool]]:
        """Warn where points (N, 3) of the same times lie within what the subject meets."""
        deepest, name = max(
            (-meeting.gap_of(points), meeting.with_what)
            for meeting, points in zip(meetings, ends, strict=True)
        )
        if (sunk := 1000.0 * deepest / self.earlier.height) > SINKING:
            yield (
                f"the subject sinks up to {sunk:.0f} thousandths of its height into {name}: what it "
                "meets after that pushes it back. Write keep_volume: false, or less softness.",
                True,
            )

    def _pressed_points(self, time: float) -> Floats:
        """Return the points of the subject at a time once it has given way."""
        points = self.earlier.points(time)
        for meeting in self.meetings_at(time):
            points = meeting.map.apply(points)
        return points

    def _floating(self, name: str, least: float, gap: float) -> str:
        fact = f"the subject floats: it is {least:.0f} thousandths of its height or more above {name}"
        if name != "the floor":
            return f"{fact} in all frames. Move it nearer, or take {name} out of others."
        return f"{fact} of contact in all frames. Write floor: {self.floor(0.0) + gap:.4g}, or floor: true."

    def _require_above(self) -> None:
        floor, lowest = self.floor(0.0), float(self.earlier.points(0.0)[:, 1].min())
        if lowest < floor - 1e-9 * self.earlier.margin:
            raise FrameError(
                f"the subject begins with its lowest point at {lowest:.4g}, below the floor at {floor:.4g}. "
                f"Write floor: {lowest:.4g} or less, or place the subject higher."
            )

    def facts(self, time: float) -> Mapping[str, Any]:
        return {**super().facts(time), **({"floor": self.floor(time)} if self.contact.has_floor else {})}


def _require_no_circle(way: tuple[str, ...], subjects: Mapping[str, Any]) -> None:
    """Raise UsageError if the last subject of a way gives way to the first, maybe by way of more."""
    name, *_, last = way
    if last == name:
        circle = " to ".join(way)
        raise UsageError(f"contact: {circle}: they give way in a circle. Take one out of others.")
    for further in () if subjects[last] is None else _others_of(subjects[last].flow):
        _require_no_circle((*way, further), subjects)


def _others_of(flow: Flow) -> Iterator[str]:
    """Yield the names of the subjects that one with this flow gives way to."""
    if isinstance(flow, InContact):
        yield from (obstacle.name for obstacle in flow.obstacles)
    if isinstance(flow, Sequence):
        for part in flow.flows:
            yield from _others_of(part)


@dataclass(frozen=True)
class Squashing(Flow):
    """A map at the end of a step, or the undoing of that at its start.

    number  of the meeting
    """

    whole: InContact
    number: int
    is_inverse: bool
    name: ClassVar[str] = "contact"

    def displace(self, points: Floats, time: float, dt: float) -> Floats:
        meeting = self._meeting(time, dt)
        if not self.is_inverse:
            return meeting.map.apply(points)
        moved = meeting.map.undo(points)
        lost = np.isnan(moved[:, 1])
        if lost.any():
            place = ", ".join(f"{x:.4g}" for x in points[lost][0])
            raise FrameError(
                f"a flow after contact moved a point to ({place}), into {meeting.with_what}. "
                "Make contact the last entry of flows."
            )
        return moved

    def kernel_row(self, time: float, dt: float) -> Any:
        return self._meeting(time, dt).map.kernel_row(self.is_inverse)

    def undoes(self, time: float, before: Any) -> bool:
        return (
            self.is_inverse
            and isinstance(before.flow, Squashing)
            and not before.flow.is_inverse
            and self._meeting(time, 0.0) is before.flow._meeting(before.time, before.dt)
        )

    def _meeting(self, time: float, dt: float) -> Meeting:
        return self.whole.meetings_at(time if self.is_inverse else time + dt)[self.number]

    def cache_data(self, time: float, dt: float) -> Any:
        data = {"undoes": self.is_inverse, **self.whole.contact.cache_data(time, dt)}
        if self.whole.earlier.of_copies is not None:
            data["of"] = "all copies"
        if self.is_inverse or self.number == len(self.whole.obstacles):
            return data
        return {**data, "other": self.whole.obstacles[self.number].surface.cache_data(time, dt)}
