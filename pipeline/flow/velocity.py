"""Velocity fields, and the flow that follows their streamlines."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices, Points, Vectors
from pipeline.errors import FrameError
from pipeline.flow import _kernels_velocity as kernels
from pipeline.flow._kernels_opcodes import COLUMNS
from pipeline.flow.flow import Flow, for_kernels
from pipeline.flow.parameters import shot_name
from pipeline.flow.program import Instruction, Program, identity_of, kinds_of, owners_of, table_of

STEP_LIMIT = 0.1
"""The longest sub-step times the steepest velocity gradient.

The classical Runge-Kutta step leaves out the terms of the exponential from (h L)^5 / 120 on, so at a
tenth one sub-step errs by about 1e-7 of the distance over which the field varies.
"""

MOST_SUBSTEPS = 10_000
WORTH_SHARING = 8000  # steps of points: fewer are done before a second thread has begun


class VelocityField(ABC):
    """Velocities in scene units per second, at any point and time, as a program for the kernels."""

    @abstractmethod
    def program(self, time: float) -> Program:
        """What the kernels do for it at a time: the same opcodes, and owners, at all times."""

    @abstractmethod
    def steepness(self, time: float) -> float:
        """A bound of the velocity gradient, in 1/s: it decides the number of sub-steps."""

    def leaves(self, place: Points, time: float) -> Iterator[tuple[VelocityField, Points]]:
        """The basic fields in it, each with the place that it sees where the whole sees `place` (3,)."""
        yield self, place

    @property
    def name(self) -> str:
        """What error messages call it."""
        return shot_name(type(self))

    def velocity(self, points: Points, time: float) -> Vectors:
        """Velocities (N, 3) at points (N, 3)."""
        points, program = for_kernels(points), self.program(time)
        out = np.empty_like(points)
        kernels.velocities(points, kinds_of(program), table_of(program).ravel(), out)
        return out


class Term(VelocityField):
    """A basic field: one leaf of the kernels and its numbers at a time. The catalogue holds the equations."""

    @property
    @abstractmethod
    def kind(self) -> int:
        """Its opcode."""

    @abstractmethod
    def row(self, time: float) -> tuple[float, ...]:
        """Its numbers at a time, in the kernels' order."""

    def program(self, time: float) -> Program:
        return (Instruction(self.kind, self.row(time)),)


class Course(NamedTuple):
    """Sub-steps along velocity fields, one after another, as the kernel takes them.

    kinds    int32 (K,), the kinds of all the fields
    tables   float64, their tables, flat
    steps    int64 (S, 3): the first field of each sub-step, the one after its last, and where its three
             tables (at its start, middle and end) begin
    lengths  float64 (S,), seconds
    owners   of the memory whose addresses stand in the tables
    """

    kinds: Indices
    tables: Floats
    steps: AnyArray
    lengths: Floats
    owners: tuple[Any, ...] = ()

    @classmethod
    def joined(cls, courses: Sequence[Course]) -> Course:
        """All of them in order, as one."""
        shift, steps = np.zeros(3, np.int64), []
        for course in courses:
            steps.append(course.steps + shift)
            shift += (len(course.kinds), len(course.kinds), len(course.tables))
        return cls(
            np.concatenate([course.kinds for course in courses]),
            np.concatenate([course.tables for course in courses]),
            np.concatenate(steps),
            np.concatenate([course.lengths for course in courses]),
            tuple({id(owner): owner for course in courses for owner in course.owners}.values()),
        )

    def follow(self, points: Points) -> Points:
        """Where points (N, 3) are at its end."""
        points = for_kernels(points)
        out = np.empty_like(points)
        together = len(points) * len(self.lengths) > WORTH_SHARING
        (kernels.advect_together if together else kernels.advect)(points, *self[:4], out)
        return out


@dataclass(frozen=True)
class Streamlines(Flow):
    """Points carried along a velocity field by the classical Runge-Kutta method of order 4.

    substeps  into how many steps a frame is divided; None chooses the least that keeps
              sub-step × steepness of the field below STEP_LIMIT
    """

    field: VelocityField
    substeps: int | None = None

    order: ClassVar[int] = 4

    def displace(self, points: Points, time: float, dt: float) -> Points:
        return self.course(time, dt).follow(points)

    def course(self, time: float, dt: float) -> Course:
        """The sub-steps of this step. Raises FrameError where they are more than MOST_SUBSTEPS."""
        wanted = self._substeps(time, dt)
        if not wanted <= MOST_SUBSTEPS:
            raise FrameError(
                f"flow {self.name} at {time:g} s is so steep or finely cut that a frame takes {wanted:.3g} "
                f"sub-steps; {MOST_SUBSTEPS} are the most. Lower its strength or widen its radius."
            )
        count = int(wanted)
        programs, length = self._programs(time, dt, count)
        kinds = kinds_of(programs[0])
        tables = np.concatenate([table_of(program) for program in programs])
        steps = np.zeros((count, 3), np.int64)
        steps[:, 1], steps[:, 2] = len(kinds), 2 * len(kinds) * COLUMNS * np.arange(count)
        return Course(kinds, tables.ravel(), steps, np.full(count, length), owners_of(programs[0]))

    def acting(self, time: float, dt: float) -> Any:
        """A field too steep to follow has data too, without a step: its frame fails, and not before."""
        wanted = self._substeps(time, dt)
        feasible = wanted <= MOST_SUBSTEPS
        programs, length = self._programs(time, dt, int(wanted) if feasible else 1)
        step = length if feasible else None
        return {"streamlines": [identity_of(program) for program in programs], "step": step}

    @property
    def name(self) -> str:
        return self.field.name

    def _substeps(self, time: float, dt: float) -> float:
        """How many are given, or asked for by STEP_LIMIT at the start, middle and end of the step."""
        if self.substeps:
            return self.substeps
        steepest = max(self.field.steepness(t) for t in (time, time + dt / 2, time + dt))
        wanted = steepest * abs(dt) / STEP_LIMIT
        return max(1, math.ceil(wanted)) if math.isfinite(wanted) else math.inf

    def _programs(self, time: float, dt: float, count: int) -> tuple[list[Program], float]:
        """At the ends and middles of sub-steps, and how long one is."""
        times = time + dt * np.arange(2 * count + 1) / (2 * count)
        return [self.field.program(float(t)) for t in times], dt / count
