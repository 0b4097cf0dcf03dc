"""Where points are that seeds released, at the end of their travel: exactly, by integration from the seed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from flowsculpt import FrameError, Streamlines, VelocityField
from flowsculpt.api.meshes import Floats

SAME = 1e-12
"""Seconds up to which two times are one."""

MOST_STEPS = 30_000  # to a frame or the end of streamlines, were points as fast all the way
_FASTER = 1.25  # than where its step begins a point may become, before its sub-steps are made finer
_LOOKS = 0.0, 0.37, 0.71, 1.0
"""Shares of a step at which velocities are compared: if they are equal, they are so throughout."""

_CUBIC = 4  # sub-steps of a step up to which a cubic curve shows how points move within it
_ASIDE = 1e-4  # how far a point is moved aside for a derivative, over how far it goes in a step
_JOINED = 16  # steps that are planned as one


@dataclass(frozen=True)
class Frozen(VelocityField):
    """A velocity field as it is at one moment, in seconds."""

    field: VelocityField
    moment: float

    def program(self, time: float) -> Any:
        return self._program

    @cached_property
    def _program(self) -> Any:
        return self.field.program(self.moment)

    def gradient_bound(self, time: float) -> float:
        return self.field.gradient_bound(self.moment)

    def length_scale(self, time: float) -> float:
        return self.field.length_scale(self.moment)

    def leaves(self, point: Floats, time: float) -> Iterator[tuple[VelocityField, Floats]]:
        return self.field.leaves(point, self.moment)

    def kinks(self, time: float, dt: float) -> Iterable[float]:
        return ()

    @property
    def name(self) -> str:
        return self.field.name


@dataclass(frozen=True, eq=False)
class TravelStep:
    """A step in which all points move.

    flow   moves them, in as many sub-steps as the fastest of them needs
    begin  seconds
    end    seconds; before `begin` in a step backwards
    count  of sub-steps
    field  what the velocities are, JSON-able; None if they change within the step
    kept   the plan of the whole step; None if its velocities take so much memory that none is kept
    """

    flow: Streamlines
    begin: float
    end: float
    count: int
    field: Any
    kept: Any

    @classmethod
    def of(cls, flow: Streamlines, begin: float, end: float, speed: float) -> TravelStep:
        """Return a step of points of which the fastest begins with a speed, units per second.

        Raises FrameError where the field needs too many sub-steps.
        """
        seconds = end - begin
        count, longest = flow.gradient_substeps(begin, seconds), flow.longest_step(begin, seconds)
        if math.isfinite(count):
            count = max(1, count, math.ceil(_FASTER * speed * abs(seconds) / longest))
            flow = replace(flow, substeps=int(count))
        seen = [[row.as_data() for row in flow.field.program(begin + share * seconds)] for share in _LOOKS]
        steady = all(each == seen[0] for each in seen)
        plan = flow.step_plan(begin, seconds)
        is_large = flow.holds_much(begin) and not isinstance(flow.field, Frozen)
        kept = None if is_large else plan
        return cls(flow, begin, end, len(plan.spans), seen[0] if steady else None, kept)

    @property
    def plan(self) -> Any:
        """The plan of the whole step."""
        return self.flow.step_plan(self.begin, self.end - self.begin) if self.kept is None else self.kept

    def moved(self, points: Floats) -> Floats:
        """Return points (N, 3) after the whole step."""
        moved = np.asarray(self.plan.follow(points))
        lost = ~np.isfinite(moved).all(axis=1)
        if lost.any():  # their sub-steps are too coarse
            flow = replace(self.flow, substeps=None)
            moved[lost] = flow.displace(points[lost], self.begin, self.end - self.begin)
        return moved

    @property
    def finest(self) -> float:
        """The length of a sub-step, in seconds."""
        return abs(self.end - self.begin) / self.count

    def moved_within(self, points: Floats, starts: Floats, stops: Floats, finest: float) -> Floats:
        """Return points (N, 3) that move in a part of the step alone, from `starts` (N,) to `stops` (N,).

        Each has sub-steps of its own, at most `finest` seconds long, of Runge and Kutta's method. Velocities
        at their times are interpolated, by a parabola through those at both ends and in the middle.
        """
        seconds, times = (stops - starts)[:, None], starts[:, None]
        count = max(1, math.ceil(float(np.abs(seconds).max(initial=0.0)) / finest - SAME))
        h = seconds / count
        for _ in range(count):
            one = self._velocity(points, times)
            two = self._velocity(points + 0.5 * h * one, times + 0.5 * h)
            three = self._velocity(points + 0.5 * h * two, times + 0.5 * h)
            four = self._velocity(points + h * three, times + h)
            points, times = points + h / 6.0 * (one + 2.0 * (two + three) + four), times + h
        return points

    def moved_until(self, points: Floats, stops: Floats) -> Floats:
        """Return points (N, 3) that move from the begin on, at times (N,) within the step.

        Between both ends of the step they are on the cubic curve that has their velocities there, which in
        steps of few sub-steps is within 2 · 10⁻⁴ of how far a point goes.
        """
        if self.count > _CUBIC:
            whole, points = self._sub_steps(stops, np.floor), points.copy()
            for count in np.unique(whole[whole > 0]).tolist():
                points[whole == count] = self._followed(points[whole == count], 0, count)
            return self.moved_within(points, self._boundaries(whole), stops, self.finest)
        seconds, there = self.end - self.begin, self.moved(points)
        first, _, last = self._moments
        ahead, after = first.velocity(points, self.begin), last.velocity(there, self.end)
        return _cubic(points, seconds * ahead, there, seconds * after, (stops - self.begin) / seconds)

    def moved_since(self, points: Floats, starts: Floats) -> Floats:
        """Return points (N, 3) that begin at times (N,) within the step, at its end; as `moved_until`."""
        if self.count > _CUBIC:
            whole = self._sub_steps(starts, np.ceil)
            points = self.moved_within(points, starts, self._boundaries(whole), self.finest)
            for first in np.unique(whole[whole < self.count]).tolist():
                points[whole == first] = self._followed(points[whole == first], first, self.count)
            return points
        seconds, (first, _, last) = self.end - self.begin, self._moments
        ahead = first.velocity(points, self.begin)
        aside = _ASIDE * seconds
        there, beside = np.split(self.moved(np.concatenate([points, points + aside * ahead])), 2)
        leaving = -seconds / aside * (beside - there)  # by how much a later start leaves a point behind
        arriving = -seconds * last.velocity(points, self.end)
        return _cubic(there, leaving, points, arriving, (starts - self.begin) / seconds)

    def _sub_steps(self, times: Floats, rounded: np.ufunc) -> np.ndarray:
        """Return how many sub-steps (N,) lie before times (N,), rounded down or up."""
        share = (times - self.begin) / (self.end - self.begin)
        return np.clip(rounded(share * self.count), 0, self.count).astype(np.int64)

    def _boundaries(self, whole: np.ndarray) -> Floats:
        """Return the times (N,) at which so many sub-steps have passed."""
        return np.asarray(self.begin + (self.end - self.begin) * whole / self.count)

    def _followed(self, points: Floats, first: int, last: int) -> Floats:
        """Return points (N, 3) after the sub-steps from number `first` up to `last`, which is left out."""
        plan = self.plan._replace(steps=self.plan.steps[first:last], spans=self.plan.spans[first:last])
        moved = np.asarray(plan.follow(points))
        lost = ~np.isfinite(moved).all(axis=1)
        if lost.any():  # their sub-steps are too coarse
            ends = self._boundaries(np.array([first, last]))
            starts, stops = np.repeat(ends[:, None], lost.sum(), axis=1)
            moved[lost] = self.moved_within(points[lost], starts, stops, self.finest)
        return moved

    def _velocity(self, points: Floats, times: Floats) -> Floats:
        """Return velocities (N, 3) at points (N, 3) and times (N, 1)."""
        if self.field is not None:
            return self._moments[0].velocity(points, self.begin)
        s = 2.0 * (times - self.begin) / (self.end - self.begin) - 1.0
        shares = 0.5 * s * (s - 1.0), 1.0 - s * s, 0.5 * s * (s + 1.0)
        found = (field.velocity(points, field.moment) for field in self._moments)
        return np.asarray(sum(share * each for share, each in zip(shares, found, strict=True)))

    @property
    def _moments(self) -> list[Frozen]:
        """The field at the begin, the middle and the end, made again each time where no plan is kept."""
        return self._frozen() if self.kept is None else self._kept_moments

    @cached_property
    def _kept_moments(self) -> list[Frozen]:
        return self._frozen()

    def _frozen(self) -> list[Frozen]:
        return [Frozen(self.flow.field, float(time)) for time in np.linspace(self.begin, self.end, 3)]


@dataclass(eq=False)
class Travel:
    """The steps in which points are moved from a time on, forwards or backwards.

    flow   moves them
    begin  seconds
    """

    flow: Streamlines
    begin: float
    steps: list[TravelStep] = field(default_factory=list)
    _blocks: dict[int, Any] = field(default_factory=dict)

    @property
    def now(self) -> float:
        """The end of the last step."""
        return self.steps[-1].end if self.steps else self.begin

    @property
    def before(self) -> float:
        """The begin of the last step."""
        return self.steps[-1].begin

    def advance(self, moving: Floats, until: float, leading: Floats, longest: float) -> None:
        """Add a step of points (N, 3) towards a time, in which others (M, 3) go about `longest` at most.

        It ends where velocities bend in time. Raises FrameError where too many steps or sub-steps are needed.
        """
        speed = self._fastest(leading)
        if not math.isfinite(speed):
            raise FrameError(f"a velocity is {speed}; it must be finite. Guard it, for example by clamp.")
        if (steps := abs(until - self.now) * speed / longest) > MOST_STEPS:
            raise FrameError(
                f"points move {speed:.3g} units a second, which takes over {MOST_STEPS:,} steps of "
                f"{longest:.3g} units. Raise max_edge_length, or write a shorter length or slower velocities."
            )
        count = math.ceil(steps)
        end = until if count <= 1 else self.now + (until - self.now) / count
        kinks = self.flow.field.kinks(self.now, end - self.now)
        end = min(kinks, key=lambda kink: abs(kink - self.now), default=end)
        self.steps.append(TravelStep.of(self.flow, self.now, end, self._fastest(moving)))

    def _fastest(self, points: Floats) -> float:
        speeds = np.linalg.norm(self.flow.field.velocity(points, self.now), axis=1)
        return float(speeds.max(initial=0.0))

    def moved(self, points: Floats) -> Floats:
        """Return points (N, 3) moved by the last step."""
        return self.steps[-1].moved(points)

    def released(self, points: Floats, times: Floats) -> Floats:
        """Return where points (N, 3) are now that were released at times (N,) since `begin`."""
        order = np.argsort(times, kind="stable")
        points, times = points[order], times[order]
        ends = np.array([step.end for step in self.steps])
        within = np.minimum(np.searchsorted(ends - SAME, times, side="right"), len(ends))
        if self._is_steady:
            first = within < len(ends)
            points[first] = self._steadily(points[first], times[first], ends[within[first]])
        moving, reached = 0, 0
        for number in np.unique(within[within < len(ends)]).tolist():
            points[:moving] = self._through(points[:moving], reached, number + 1)
            last, step = int(np.searchsorted(within, number, side="right")), self.steps[number]
            new = slice(moving, last)
            if not self._is_steady:
                points[new] = step.moved_since(points[new], np.maximum(times[new], step.begin))
            moving, reached = last, number + 1
        points[:moving] = self._through(points[:moving], reached, len(ends))
        return _unsorted(points, order)

    def travelled(self, points: Floats, lengths: Floats) -> Floats:
        """Return where points (N, 3) are that left their places at `begin`, after lengths (N,) of seconds."""
        order = np.argsort(lengths, kind="stable")
        points, lengths = points[order], lengths[order]
        ends = np.abs(np.array([step.end for step in self.steps]) - self.begin)
        whole = np.searchsorted(
            ends - SAME, lengths, side="right"
        )  # steps that each point makes to their end
        reached, sign = 0, 1.0 if self.now > self.begin else -1.0
        for number in np.unique(whole).tolist():
            first, last = (int(np.searchsorted(whole, number, side=side)) for side in ("left", "right"))
            points[first:] = self._through(points[first:], reached, number)
            reached = number
            if number < len(self.steps) and not self._is_steady:
                part = slice(first, last)
                points[part] = self.steps[number].moved_until(points[part], self.begin + sign * lengths[part])
        if self._is_steady:
            begins = np.concatenate([[0.0], ends])[whole]
            rest = whole < len(ends)
            points[rest] = self._steadily(points[rest], sign * begins[rest], sign * lengths[rest])
        return _unsorted(points, order)

    def _steadily(self, points: Floats, starts: Floats, stops: Floats) -> Floats:
        """Return points (N, 3) moved in parts of any steps, where the velocities are steady."""
        return self.steps[0].moved_within(points, starts, stops, min(step.finest for step in self.steps))

    @property
    def _is_steady(self) -> bool:
        """True if velocities were the same in all steps."""
        known = self.steps[0].field
        return known is not None and all(step.field is known or step.field == known for step in self.steps)

    def _through(self, points: Floats, first: int, last: int) -> Floats:
        """Return points (N, 3) after the steps with numbers from `first` up to `last`, which is left out."""
        while first < last and len(points):
            if first % _JOINED or first + _JOINED > last or self.steps[first].kept is None:
                points, first = self.steps[first].moved(points), first + 1
                continue
            moved = np.asarray(self._block(first).follow(points))
            lost = ~np.isfinite(moved).all(axis=1)
            for step in self.steps[first : first + _JOINED] if lost.any() else ():
                points[lost] = step.moved(points[lost])
            moved[lost] = points[lost]
            points, first = moved, first + _JOINED
        return points

    def _block(self, first: int) -> Any:
        """Return the plan of steps from a number on."""
        if first not in self._blocks:
            plans = [step.plan for step in self.steps[first : first + _JOINED]]
            self._blocks[first] = plans[0].joined(plans)
        return self._blocks[first]


def travelled_both_ways(ahead: Travel, back: Travel, points: Floats, lengths: Floats) -> Floats:
    """Return where points (N, 3) are after lengths (N,) of seconds, backwards where these are below 0."""
    ended, before = points.copy(), lengths < 0.0
    ended[~before] = ahead.travelled(points[~before], lengths[~before])
    if before.any():
        ended[before] = back.travelled(points[before], -lengths[before])
    return ended


def _cubic(start: Floats, leaving: Floats, end: Floats, arriving: Floats, shares: Floats) -> Floats:
    """Return points (N, 3) at shares (N,) of curves from `start` to `end`, with derivatives by the share."""
    s, step = shares[:, None], end - start
    return np.asarray(
        start
        + s * (leaving + s * (3.0 * step - 2.0 * leaving - arriving + s * (leaving + arriving - 2.0 * step)))
    )


def _unsorted(points: Floats, order: np.ndarray) -> Floats:
    out = np.empty_like(points)
    out[order] = points
    return out
