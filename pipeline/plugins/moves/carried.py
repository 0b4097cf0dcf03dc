"""Flows that move a subject in its own place, and keyed maps that carry it, its far parts later."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from flowsculpt import Flow, FrameError, Sequence
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.moves import PLUGIN
from flowsculpt.pipeline.plugins.moves.keyed_maps import RATE, MapSequence
from flowsculpt.pipeline.plugins.moves.late_flow import LateFlow, Vector

FASTEST = 0.95
"""The most by which the delay at a place changes in as much time: at 1 parts would meet."""

CHECKED, TIMES = 512, 64
"""Points and times, at most, at which a step is checked for parts that would meet."""

FORESEEN, FINENESS = 128, 16
"""Points, at most, that are checked before frames are made; edges of a solid along its longest side there."""

MOST_TRIES, EXACT = 80, 1e-9
"""Tries to find the delay of a point, far more than any takes, and what it may be wrong by, s or units."""

SCANNED, MARGIN = 60.0, 0.1
"""Delays in a second among which several roots are looked for, and what the box around the subject has added
on each side, of its size."""


@dataclass(frozen=True)
class Carried(Sequence):
    """Flows that move a subject in its own place, and maps M that carry it.

    At a time t, what would be at q is at M(t − delay(q)) q.

    flows  those that act in its own place
    late   the settings
    maps   one after another, each by all its keys up to a time
    """

    acts_around_earlier = True

    late: LateFlow
    subject: Any = field(compare=False)
    place: Vector
    maps: MapSequence = field(compare=False)

    def steps(self, time: float, dt: float) -> Iterator[Any]:
        """Yield the undoing of the maps at the start, the steps of the flows, and the maps at the end."""
        yield from Carrying(self, is_inverse=True).steps(time, dt)
        yield from super().steps(time, dt)
        yield from Carrying(self, is_inverse=False).steps(time, dt)

    @cached_property
    def _at_rest(self) -> Floats:
        """The points (N, 3) of the subject at rest."""
        points: Floats = self.subject.body.build().vertices + np.array(self.place)
        return points

    @cached_property
    def _reach(self) -> float:
        """The distance of what is late by all of the delay."""
        if self.late.reach is not None:
            return self.late.reach
        return max(0.0, float(self.late.distances(self._at_rest).max())) or 1.0

    @cached_property
    def _longest(self) -> float:
        """The longest delay of the subject at rest, seconds."""
        return float(self._delays(self._at_rest).max())

    @cached_property
    def _checked(self) -> set[float]:
        """The times for which no parts meet."""
        return set()

    def _delays(self, points: Floats) -> Floats:
        return self.late.delays(points, self._reach)

    def _outside(self, points: Floats) -> Floats:
        """Return the distances (N,) of points (N, 3) from the box around the subject at rest."""
        low, high = self._at_rest.min(axis=0), self._at_rest.max(axis=0)
        away = np.abs(points - 0.5 * (low + high)) - (0.5 + MARGIN) * (high - low)
        return np.asarray(np.maximum(away, 0.0).max(axis=1, initial=0.0), np.float64)

    def moved(self, points: Floats, first: float, last: float) -> Floats:
        """Return where points (N, 3) of its own place are at `last`, after a step from `first` on.

        Raises FrameError where parts would meet within the step, by the first points of a time.
        """
        if not self.late.seconds:
            return self.maps.apply(points, last)
        moved = self.maps.apply(points, last - self._delays(points))
        if len(points) and last not in self._checked:  # new vertices of a frame come later, a few at a time
            self._checked.add(last)
            self._require_apart(points[:: -(-len(points) // CHECKED)], first, last)
        return moved

    def undone(self, points: Floats, time: float) -> Floats:
        """Return the points (N, 3) of its own place that are at these at a time.

        The delay d of a point x is a root of delay(M(time − d)⁻¹ x) − d, which falls where no parts meet. It
        may have more, away from the subject: of several, that counts whose place is nearest to the subject
        at rest.
        """
        if not self.late.seconds:
            return self.maps.undo(points, time)
        time = max(time, 0.0)
        places = self._roots(points, time, np.zeros(len(points)), np.full(len(points), time))
        away = self._outside(places)
        far = np.flatnonzero(away > 0.0)
        if len(far):
            places[far] = self._nearest_roots(points[far], time, places[far], away[far])
        return places

    def _roots(self, points: Floats, time: float, low: Floats, high: Floats) -> Floats:
        """Return the places (N, 3) of roots between delays (N,), or those of `high` where all is above 0.

        By secants within a bracket, which is halved where a secant leads out of it. Raises FrameError where
        there is none, as where a formula jumps.
        """
        places = self.maps.undo(points, time - high)
        f_before = self._delays(places) - high
        active = np.flatnonzero(f_before < 0.0)
        low, high, before, f_before = low[active], high[active], high[active], f_before[active]
        d = low
        for _ in range(MOST_TRIES):
            if not len(active):
                break
            places[active] = self.maps.undo(points[active], time - d)
            f = self._delays(places[active]) - d
            low, high = np.where(f >= 0.0, d, low), np.where(f >= 0.0, high, d)
            with np.errstate(all="ignore"):
                following = d - f * (d - before) / (f - f_before)
            following = np.where((low < following) & (following < high), following, 0.5 * (low + high))
            left = (np.abs(f) > 1e-16) & (following != low) & (following != high)
            if (lost := ~left & (np.abs(f) > EXACT)).any():
                raise self._meeting(places[active][lost][0], "the delay jumps there", 0.0)
            active, before, f_before, d = active[left], d[left], f[left], following[left]
            low, high = low[left], high[left]
        return places

    def _nearest_roots(self, points: Floats, time: float, places: Floats, away: Floats) -> Floats:
        """Return the places (N, 3) of the roots that are nearest to the subject, maybe the given ones.

        away  the distances (N,) of the given ones
        """
        low, high, before, f_before = np.full((4, len(points)), np.nan)
        for d in np.append(np.arange(0.0, min(time, 2.0 * self._longest), 1.0 / SCANNED), time):
            seen = self.maps.undo(points, np.full(len(points), time - d))
            f, distances = self._delays(seen) - d, self._outside(seen)
            better = (distances < away) & np.where(f < 0.0, f_before >= 0.0, d == time)
            low[better], high[better], away[better] = before[better], d, distances[better]
            before[:], f_before = d, f
        found = np.flatnonzero(np.isfinite(high))
        places[found] = self._roots(points[found], time, low[found], high[found])
        return places

    def findings(self) -> Iterator[tuple[str, bool]]:
        """Yield those of the flows. Raises FrameError, of its frame, where parts would meet."""
        yield from super().findings()
        if not self.late.seconds:
            return
        mesh = self.subject.build(float(np.ptp(self._at_rest, axis=0).max()) / FINENESS)
        points = mesh.vertices[:: -(-len(mesh.vertices) // FORESEEN)] + np.array(self.place)
        for (_, before), (frame, time) in pairwise(self.late.moments):
            points = Sequence(self.flows).displace(points, before, time - before)
            try:
                self._require_apart(points, before, time)
            except FrameError as error:
                raise error.of(frame) from None

    def _require_apart(self, some: Floats, start: float, end: float) -> None:
        """Raise FrameError where, at some of points (N, 3), a part would pass another in a step."""
        first, last = max(min(start, end), 0.0), max(start, end)
        count = min(TIMES, math.ceil((last - first) * RATE - 1e-6))
        if count < 1:
            return
        times = np.repeat(last - (last - first) * np.arange(count) / count, len(some))
        places = np.tile(some, (count, 1))
        before = self.maps.undo(self.maps.apply(places, times), times - 1.0 / RATE)
        changes = (self._delays(before) - np.tile(self._delays(some), count)) * RATE
        if not (worst := float(changes.max())) <= FASTEST:
            fact = f"what moves past there is late by {worst:.2f} s more each second"
            raise self._meeting(places[int(changes.argmax())], fact, 0.99 * FASTEST / worst)
        moved = self.maps.apply(some, end - self._delays(some))
        missed = np.abs(self.undone(moved, end) - some).max(axis=1)
        if not missed.max() < EXACT:
            raise self._meeting(some[missed.argmax()], "another place arrives there too", 0.5)

    def _meeting(self, place: Floats, fact: str, less: float) -> FrameError:
        """Return the error of parts that meet at a place (3,); a delay of `less` times as much would do."""
        where, remedy = ", ".join(f"{x:.3g}" for x in place), f"Multiply the formula by {less:.3g}"
        if isinstance(self.late.seconds, float):
            remedy = f"Write lag: {less * self.late.seconds:.3g} or less"
        elif not less:
            remedy = "Smooth the formula"
        words = f"{self.name}: parts pass through each other near ({where}): {fact}."
        return FrameError(f"{words} {remedy}, or give the keys more time.")

    @property
    def name(self) -> str:
        return self.late.name


@dataclass(frozen=True)
class Carrying(Flow):
    """The maps at the end of a step, or the undoing of those at its start."""

    whole: Carried
    is_inverse: bool

    def displace(self, points: Floats, time: float, dt: float) -> Floats:
        end = self._end(time, dt)
        return self.whole.undone(points, end) if self.is_inverse else self.whole.moved(points, time, end)

    def undoes(self, time: float, before: Any) -> bool:
        flow = before.flow
        return (
            self.is_inverse
            and isinstance(flow, Carrying)
            and not flow.is_inverse
            and self.whole.maps is flow.whole.maps
            and self._end(time, 0.0) == flow._end(before.time, before.dt)
        )

    def _end(self, time: float, dt: float) -> float:
        """Return the time of the maps; the end of a step and the start of the next differ by rounding."""
        return round(time if self.is_inverse else time + dt, 12)

    def cache_data(self, time: float, dt: float) -> Any:
        maps, where, end = self.whole.maps, self.whole.late.where, self._end(time, dt)
        numbers = maps.samples(end) if where else np.array(maps.exactly(end))
        return {
            "plugin": [PLUGIN.name, PLUGIN.version],
            "undoes": self.is_inverse,
            "late": where,
            "maps": [each.constants for each in maps.maps],
            "numbers": hashlib.sha256(numbers.tobytes()).hexdigest()[:24],
        }

    @property
    def name(self) -> str:
        return self.whole.name
