"""The flow `contact`, which keeps a subject on or above a floor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar

import numpy as np

from flowsculpt import Flow, FrameError, UsageError
from flowsculpt.api.flows import Number, ParameterDoc, PositiveNumber, number_at
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.contact import PLUGIN
from flowsculpt.pipeline.plugins.contact.earlier_motion import EarlierMotion
from flowsculpt.pipeline.plugins.contact.squash import Squash

FLOATING = 5.0
"""Thousandths of a subject's height above the floor from which on it is seen to float."""


@dataclass(frozen=True)
class Contact(Flow):
    """Keeps the subject above a floor: what the flows before it push below is squashed, and spreads.

    The flows before it act on the subject as it would be without a floor: each step undoes the squash, moves
    the points, and squashes them again. So nothing accumulates, and a subject that rises is as it was.

    floor  its height; None is that of the subject's lowest point at the start
    times  those of all frames, seconds, for `findings`
    """

    floor: Number | None = None
    softness: Annotated[PositiveNumber, ParameterDoc("height of the zone that gives way", "units")] = 1.0
    keep_volume: Annotated[bool, ParameterDoc("false keeps the width instead")] = True
    times: tuple[float, ...] = field(default=(), compare=False, repr=False)

    def displace(self, points: Floats, time: float, dt: float) -> Floats:
        """Refuse to move points of which no subject is known."""
        raise UsageError("contact acts on one subject, as an entry of flows. Take it out of its composition.")

    def cache_data(self, time: float, dt: float) -> Any:
        ends = [self.numbers(t) for t in (time, time + dt)]
        return {"plugin": [PLUGIN.name, PLUGIN.version], "keep_volume": self.keep_volume, "ends": ends}

    def numbers(self, time: float) -> list[float | None]:
        """Return the height of the floor, None for the lowest point at the start, and the softness."""
        floor = None if self.floor is None else float(number_at(self.floor, time))
        return [floor, float(number_at(self.softness, time))]

    def of_subject(self, subject: Any, place: tuple[float, float, float], before: Sequence[Flow]) -> Flow:
        """Return the flow with the flows before it. Raises UsageError for a subject that a file moves."""
        if getattr(subject, "keeps_faces", False):
            raise UsageError("contact does not act on a model that its file moves. Remove it.")
        return OnFloor(tuple(before), self, EarlierMotion(subject, place, _Together(tuple(before))))


@dataclass(frozen=True)
class _Together(Flow):
    """Flows one after another."""

    flows: tuple[Flow, ...]

    def displace(self, points: Floats, time: float, dt: float) -> Floats:
        for flow in self.flows if dt >= 0 else reversed(self.flows):
            points = flow.displace(points, time, dt)
        return points

    def cache_data(self, time: float, dt: float) -> Any:
        return [flow.cache_data(time, dt) for flow in self.flows]


@dataclass(frozen=True)
class OnFloor(Flow):
    """Flows that move a subject above a floor.

    flows    those before `contact`
    contact  the settings
    earlier  where the flows alone move the subject, of which the squash at each time follows
    squashes  those already known, by their times
    """

    acts_around_earlier = True

    flows: tuple[Flow, ...]
    contact: Contact
    earlier: EarlierMotion = field(compare=False)
    squashes: dict[float, Squash] = field(default_factory=dict, compare=False)

    def displace(self, points: Floats, time: float, dt: float) -> Floats:
        for flow, start, length in self.steps(time, dt):
            points = flow.displace(points, start, length)
        return points

    def cache_data(self, time: float, dt: float) -> Any:
        inner = [flow.cache_data(start, length) for flow, start, length in self.steps(time, dt)]
        return [inner, self.earlier.cache_data(time, dt)]

    def steps(self, time: float, dt: float) -> Iterator[Any]:
        """Yield the undoing of the squash at the start, the steps of the flows, and the squash at the end."""
        yield from Squashing(self, undoes=True).steps(time, dt)
        for flow in self.flows if dt >= 0 else reversed(self.flows):
            yield from flow.steps(time, dt)
        yield from Squashing(self, undoes=False).steps(time, dt)

    def with_max_step(self, max_step: float) -> OnFloor:
        return replace(self, flows=tuple(flow.with_max_step(max_step) for flow in self.flows))

    def squash(self, time: float) -> Squash:
        """Return the map at a time. Raises FrameError for a subject that begins below the floor."""
        if time not in self.squashes:
            self.squashes[time] = self._squash(time)
        return self.squashes[time]

    def _squash(self, time: float) -> Squash:
        floor, softness = self.floor(time), float(number_at(self.contact.softness, time))
        if not softness > 0:
            raise FrameError(f"softness is {softness:g}; it must be above 0. Correct its keys.")
        self._require_above()
        lowest, axis = self.earlier.extent(time)
        spreads = self.contact.keep_volume
        return Squash.of(floor, softness, self.earlier.margin, lowest, axis, spreads)

    def floor(self, time: float) -> float:
        """Return the height of the floor, units."""
        floor = self.contact.numbers(time)[0]
        return self.earlier.extent(0.0).lowest if floor is None else floor

    def findings(self) -> Iterator[tuple[str, bool]]:
        """Yield how far the subject rises above the floor and is pressed; warn where it never touches it."""
        yield from super().findings()
        self._require_above()
        gaps = [self.earlier.extent(time).lowest - self.floor(time) for time in self.contact.times]
        if not gaps:
            return
        height = self.earlier.height
        least, most = (1000.0 * gap / height for gap in (min(gaps), max(gaps)))
        yield (
            f"contact: the lowest point rises up to {max(most, 0.0):.0f} thousandths of the subject's height "
            f"above the floor, and is pressed by up to {max(-least, 0.0):.0f}",
            False,
        )
        if least > FLOATING:
            floor = self.floor(0.0) + min(gaps)
            yield (
                f"the subject floats: it is {least:.0f} thousandths of its height or more above the floor of "
                f"contact in all frames. Write floor: {floor:.4g}, or floor: true.",
                True,
            )

    def _require_above(self) -> None:
        floor, lowest = self.floor(0.0), self.earlier.extent(0.0).lowest
        if lowest < floor - 1e-9 * self.earlier.margin:
            raise FrameError(
                f"the subject begins with its lowest point at {lowest:.4g}, below the floor at {floor:.4g}. "
                f"Write floor: {lowest:.4g} or less, or place the subject higher."
            )

    def facts(self, time: float) -> Mapping[str, Any]:
        facts = {name: fact for flow in self.flows for name, fact in flow.facts(time).items()}
        return {**facts, "floor": self.floor(time)}

    @property
    def rest_interval(self) -> int | None:
        return min(
            (flow.rest_interval for flow in self.flows if flow.rest_interval is not None), default=None
        )

    @property
    def name(self) -> str:
        return "contact"


@dataclass(frozen=True)
class Squashing(Flow):
    """The squash at the end of a step, or the undoing of that at its start."""

    whole: OnFloor
    undoes: bool
    name: ClassVar[str] = "contact"

    def displace(self, points: Floats, time: float, dt: float) -> Floats:
        squash = self._squash(time, dt)
        if not self.undoes:
            return squash.apply(points)
        moved = squash.undo(points)
        heights = moved[:, 1]
        if heights.size and np.isnan(heights.min()):
            height = float(points[np.isnan(heights)][0, 1])
            raise FrameError(
                f"a flow after contact moved a point to the height {height:.4g}, below the floor at "
                f"{squash.base + squash.margin:.4g}. Make contact the last entry of flows."
            )
        return moved

    def kernel_row(self, time: float, dt: float) -> Any:
        from flowsculpt.pipeline.plugins.contact.squash_kernels import squash

        return squash, self._squash(time, dt).numbers(self.undoes)

    def _squash(self, time: float, dt: float) -> Squash:
        return self.whole.squash(time if self.undoes else time + dt)

    def cache_data(self, time: float, dt: float) -> Any:
        return {"undoes": self.undoes, **self.whole.contact.cache_data(time, dt)}
