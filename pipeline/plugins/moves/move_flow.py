"""The flow `move`, which carries a subject along a keyed way, its far parts later than the near ones."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

import numpy as np

from flowsculpt import Flow, FrameError, Sequence, UsageError
from flowsculpt.api.flows import Number, ParameterDoc, VectorParameter, number_at, vector_at
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.moves import PLUGIN

Vector = tuple[float, float, float]
ORIGIN = (0.0, 0.0, 0.0)

RATE = 480.0
"""Samples of a motion in a second, where parts are late; between them it is smooth."""

ROUND = 0.05
"""Width of the place that is not late, over the reach: there the delay is round, not a cone."""

FASTEST = 0.95
"""The largest difference of delay by which a motion may differ in as much time: at 1 parts would meet."""


@dataclass(frozen=True)
class Move(Flow):
    """Carries the subject along a way and turns it, its far parts later: they drag, and swing out.

    The flows before it act on the subject in its own place: each step undoes the motion, moves the points,
    and carries them again. A point is late by lag × its distance from `leads` over `reach`, in that place;
    with `along`, by that in its direction alone, and not where it is behind.
    """

    by: Annotated[VectorParameter, ParameterDoc("the way from the first frame on, keyed", "units")] = ORIGIN
    turn: Annotated[Number, ParameterDoc("about the axis, which goes along, keyed", "degrees")] = 0.0
    axis: Annotated[Vector, "direction", ParameterDoc("of the turn")] = (0.0, 1.0, 0.0)
    centre: Annotated[Vector, ParameterDoc("a point of the axis in the first frame", "units")] = ORIGIN
    lag: Annotated[float, ParameterDoc("by which the farthest parts are late", "s", bounds=(0.0, 5.0))] = 0.0
    leads: Vector | None = None
    reach: float | None = None
    along: Vector | None = None

    def displace(self, points: Floats, time: float, dt: float) -> Floats:
        """Refuse to move points of which no subject is known."""
        raise UsageError("move carries one subject, as an entry of flows. Take it out of its composition.")

    def cache_data(self, time: float, dt: float) -> Any:
        raise UsageError("move carries one subject")

    def of_subject(self, subject: Any, place: Vector, before: Any) -> Flow:
        """Return the flow with the flows before it. Raises UsageError for a subject that a file moves."""
        if getattr(subject, "keeps_faces", False):
            raise UsageError("move does not carry a model that its file moves. Use place, or remove it.")
        return Carried(tuple(before), self, subject, place)

    def pose(self, time: float) -> tuple[float, float, float, float]:
        """Return offset and angle, radians, at a time, relative to those at the start; zero before it."""
        (x, y, z), (x0, y0, z0) = (vector_at(self.by, max(t, 0.0)) for t in (time, 0.0))
        angle = number_at(self.turn, max(time, 0.0)) - number_at(self.turn, 0.0)
        return x - x0, y - y0, z - z0, float(angle)


@dataclass(frozen=True)
class Carried(Sequence):
    """Flows that move a subject in its own place, which a motion carries.

    flows    those before `move`
    move     the settings
    motions  the numbers of motions for the kernel, by the times at which they end
    sizes    the distance of what is late by the lag, and of the farthest point from the centre, once known
    """

    acts_around_earlier = True
    name: ClassVar[str] = "move"

    move: Move
    subject: Any = field(compare=False)
    place: Vector
    motions: dict[float, Floats] = field(default_factory=dict, compare=False)
    sizes: list[float] = field(default_factory=list, compare=False)

    def steps(self, time: float, dt: float) -> Iterator[Any]:
        """Yield the undoing of the motion at the start, the steps of the flows, and the motion at the end."""
        yield from Carrying(self, is_inverse=True).steps(time, dt)
        yield from super().steps(time, dt)
        yield from Carrying(self, is_inverse=False).steps(time, dt)

    @property
    def leads(self) -> Vector:
        """The place that is not late."""
        return self.move.centre if self.move.leads is None else self.move.leads

    @property
    def along(self) -> Floats:
        """The unit vector (3,) along which parts are later; zeros where the distance from `leads` counts."""
        along = np.array(self.move.along or ORIGIN)
        return along / (float(np.linalg.norm(along)) or 1.0)

    @property
    def reach(self) -> float:
        """The distance from there of what is late by the lag: that of the farthest point at rest."""
        return self._sizes()[0] if self.move.reach is None else self.move.reach

    def _speed(self, samples: Floats) -> float:
        """Return how fast parts come nearer to the place that is not late, at most, units/s."""
        move, axis = self.move, np.array(self.move.axis) / np.linalg.norm(self.move.axis)
        changes = np.diff(samples, axis=0) * RATE
        if move.along is None:  # of a turn, only what leads towards or away from that place counts
            shifts, away = np.linalg.norm(changes[:, :3], axis=1), math.dist(self.leads, move.centre)
        else:  # shifts across that direction, as it is turned by then, change no delay
            angles, across = samples[:-1, 3:], np.cross(axis, self.along)
            turned = np.cos(angles) * self.along + np.sin(angles) * across
            turned += (1.0 - np.cos(angles)) * (axis @ self.along) * axis
            shifts, away = np.abs((changes[:, :3] * turned).sum(axis=1)), float(np.linalg.norm(across))
            away *= self._sizes()[1]
        return float((shifts + away * np.abs(changes[:, 3])).max(initial=0.0))

    def _sizes(self) -> list[float]:
        if not self.sizes:
            points = self.subject.body.build().vertices + np.array(self.place)
            away = points - self.leads
            ahead = np.linalg.norm(away, axis=1) if self.move.along is None else away @ self.along
            turned = np.linalg.norm(points - self.move.centre, axis=1)
            self.sizes.extend([max(0.0, float(ahead.max())) or 1.0, float(turned.max())])
        return self.sizes

    def samples(self, time: float) -> tuple[float, Floats]:
        """Return the time of the first sample of a motion that ends at `time`, and the samples (N, 4).

        Samples lie at multiples of 1 / RATE. Twice the lag is enough for all points up to twice the reach.
        """
        if self.move.lag == 0.0:
            return time, np.array([self.move.pose(time)])
        first, last = math.floor((time - 2.0 * self.move.lag) * RATE) - 1, math.ceil(time * RATE) + 2
        return first / RATE, np.array([self.move.pose(i / RATE) for i in range(first, last + 1)])

    def motion(self, time: float) -> Floats:
        """Return the numbers of a motion for the kernel. Raises FrameError where parts would meet."""
        if time not in self.motions:
            first, samples = self.samples(time)
            move, slowness = self.move, self.move.lag / self.reach if self.move.lag else 0.0
            speed = self._speed(samples) if slowness else 0.0
            if speed * slowness > FASTEST:
                most = FASTEST / speed * self.reach
                raise FrameError(
                    f"parts pass through each other: they move {speed:.3g} units/s where they are late by "
                    f"{slowness:.3g} s a unit. Write lag: {most:.2g} or less, or give "
                    "the keys more time."
                )
            axis = np.array(move.axis) / np.linalg.norm(move.axis)
            round_off = ROUND * self.reach
            head = [len(samples), first, 1.0 / RATE, *move.centre, *axis, *self.leads, slowness, round_off]
            self.motions[time] = np.concatenate([head, self.along, samples.ravel()])
        return self.motions[time]


@dataclass(frozen=True)
class Carrying(Flow):
    """The motion at the end of a step, or the undoing of that at its start."""

    whole: Carried
    is_inverse: bool
    name: ClassVar[str] = "move"

    def displace(self, points: Floats, time: float, dt: float) -> Floats:
        kernel, numbers = self.kernel_row(time, dt)
        rows = np.ascontiguousarray(points.T, np.float64)
        moves = np.zeros_like(rows)
        kernel(np.array(numbers), rows, 0.0, moves)
        return np.ascontiguousarray((rows + moves).T)

    def kernel_row(self, time: float, dt: float) -> Any:
        # imported here, as shots are read without numba
        from flowsculpt.pipeline.plugins.moves.move_kernels import move

        at = self._end(time, dt)
        motion = self.whole.motion(at)
        return move, (float(motion.ctypes.data), float(len(motion)), at, float(self.is_inverse))

    def undoes(self, time: float, before: Any) -> bool:
        flow = before.flow
        return (
            self.is_inverse
            and isinstance(flow, Carrying)
            and not flow.is_inverse
            and self.whole.motions is flow.whole.motions
            and self._end(time, 0.0) == flow._end(before.time, before.dt)
        )

    def _end(self, time: float, dt: float) -> float:
        """Return the time of the motion; the end of a step and the start of the next differ by rounding."""
        return round(time if self.is_inverse else time + dt, 12)

    def cache_data(self, time: float, dt: float) -> Any:
        whole, at = self.whole, self._end(time, dt)
        move, (first, samples) = whole.move, whole.samples(at)
        late = [whole.leads, move.reach, move.lag, move.along] if move.lag else []
        digest = hashlib.sha256(samples.tobytes()).hexdigest()[:24]
        turn = [list(move.axis), list(move.centre)]
        return {
            "plugin": [PLUGIN.name, PLUGIN.version],
            "undoes": self.is_inverse,
            "motion": [first, digest, *turn, *late],
        }
