"""Weights of flows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Points
from pipeline.errors import FrameError
from pipeline.flow.compose.space import Frame, Mirror
from pipeline.flow.keyframes import Number, number_at
from pipeline.flow.program import Program, grouped, placed, scaled
from pipeline.flow.regions import STEEPEST_FALL, Region
from pipeline.flow.velocity import VelocityField


def weight_at(weight: Number, time: float, name: str) -> float:
    """A weight at a time. Raises FrameError, of the flow `name`, where it is not from 0 to 1."""
    value = float(number_at(weight, time))
    if not -1e-12 <= value <= 1.0 + 1e-12:
        raise FrameError(
            f"flow {name} has the weight {value:g} at {time:g} s; a weight is from 0 to 1. "
            "Mend its keys, or choose an easing that does not overshoot."
        )
    return min(max(value, 0.0), 1.0)


@dataclass(frozen=True)
class Sum(VelocityField):
    """Velocities added up, then integrated together: the order of the fields does not matter."""

    fields: tuple[VelocityField, ...]

    def program(self, time: float) -> Program:
        return tuple(row for field in self.fields for row in field.program(time))

    def gradient_bound(self, time: float) -> float:
        return sum(field.gradient_bound(time) for field in self.fields)

    def leaves(self, place: Points, time: float) -> Iterator[tuple[VelocityField, Points]]:
        for field in self.fields:
            yield from field.leaves(place, time)

    @property
    def name(self) -> str:
        return " + ".join(field.name for field in self.fields)


@dataclass(frozen=True)
class Scaled(VelocityField):
    """A field with its velocities multiplied by a weight from 0 to 1, or by what is left of it.

    rest  the factor is 1 − weight
    """

    field: VelocityField
    weight: Number
    rest: bool = False

    def program(self, time: float) -> Program:
        return scaled(self.field.program(time), self._factor(time))

    def gradient_bound(self, time: float) -> float:
        return self._factor(time) * self.field.gradient_bound(time)

    def leaves(self, place: Points, time: float) -> Iterator[tuple[VelocityField, Points]]:
        return self.field.leaves(place, time)

    @property
    def name(self) -> str:
        return self.field.name

    def _factor(self, time: float) -> float:
        weight = weight_at(self.weight, time, self.name)
        return 1.0 - weight if self.rest else weight


@dataclass(frozen=True)
class Limited(VelocityField):
    """A field within a region: its velocities are multiplied by the weight of the region there and then."""

    field: VelocityField
    region: Region

    def program(self, time: float) -> Program:
        return grouped(self.field.program(time), self.region.closing(time))

    def gradient_bound(self, time: float) -> float:
        """The field's own, and what the fall adds: its slope times the speed in it.

        The speed is looked at on a grid over the region and its rim, and is at most that much more between.
        Where there is no rim, or none that a step could resolve, the field's own counts alone.
        """
        inside, falloff = self.field.gradient_bound(time), self.region.falloff_at(time)
        if falloff <= 0:
            return inside
        middle, half = self.region.bounds(time)
        lines = [np.linspace(m - h, m + h, GRID) for m, h in zip(middle, half, strict=True)]
        grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
        fastest = float(np.linalg.norm(self.field.velocity(grid, time), axis=1).max())
        between = inside * float(np.linalg.norm(half)) / (GRID - 1)
        return inside + STEEPEST_FALL[self.region.falloff_type] / falloff * (fastest + between)

    def leaves(self, place: Points, time: float) -> Iterator[tuple[VelocityField, Points]]:
        return self.field.leaves(place, time)

    @property
    def name(self) -> str:
        return f"{self.field.name} within a {self.region.name}"


GRID = 9
"""Points along each side of the box in which the speed of a limited field is looked at."""


@dataclass(frozen=True)
class InFrame(VelocityField):
    """A field in a frame, keyed or not, or in a mirror: see `Placed`."""

    field: VelocityField
    frame: Frame | Mirror

    def program(self, time: float) -> Program:
        origin, axes = self.frame.at(time)
        return placed(self.field.program(time), tuple(origin.tolist()), axes)

    def gradient_bound(self, time: float) -> float:
        """The same: speeds and distances are scaled alike."""
        return self.field.gradient_bound(time)

    def leaves(self, place: Points, time: float) -> Iterator[tuple[VelocityField, Points]]:
        origin, axes = self.frame.at(time)
        return self.field.leaves(np.asarray(np.linalg.solve(axes, place - origin), np.float64), time)

    @property
    def name(self) -> str:
        return f"{self.frame.name} {self.field.name}"
