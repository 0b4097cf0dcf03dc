"""Flows made of flows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pipeline.arrays import Points
from pipeline.flow.flow import Flow
from pipeline.flow.program import Program
from pipeline.flow.velocity import VelocityField


@dataclass(frozen=True)
class Sum(VelocityField):
    """Velocities added up, then integrated together: the order of the fields does not matter."""

    fields: tuple[VelocityField, ...]

    @property
    def terms(self) -> tuple[VelocityField, ...]:
        return tuple(term for field in self.fields for term in field.terms)

    def program(self, time: float) -> Program:
        return tuple(row for field in self.fields for row in field.program(time))

    def steepness(self, time: float) -> float:
        return sum(field.steepness(time) for field in self.fields)

    @property
    def name(self) -> str:
        return " + ".join(field.name for field in self.fields)


@dataclass(frozen=True)
class Sequence(Flow):
    """Flows one after another within each step, the first first; with none, everything stays."""

    flows: tuple[Flow, ...]

    def displace(self, points: Points, time: float, dt: float) -> Points:
        order = self.flows if dt >= 0 else reversed(self.flows)
        for flow in order:
            points = flow.displace(points, time, dt)
        return points

    def acting(self, time: float, dt: float) -> Any:
        return [flow.acting(time, dt) for flow in self.flows]

    @property
    def name(self) -> str:
        return ", ".join(flow.name for flow in self.flows)


@dataclass(frozen=True)
class Reversed(Flow):
    """A flow run backwards in time: what it does from 0 to `duration` seconds is undone in that time."""

    flow: Flow
    duration: float

    def displace(self, points: Points, time: float, dt: float) -> Points:
        return self.flow.displace(points, self.duration - time, -dt)

    def acting(self, time: float, dt: float) -> Any:
        return self.flow.acting(self.duration - time, -dt)

    @property
    def name(self) -> str:
        return f"reversed {self.flow.name}"
