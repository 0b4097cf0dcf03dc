"""Velocity fields made of velocity fields: brackets of one program, followed by one integration."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Points
from pipeline.flow.compose.transforms import Mirror, Transform
from pipeline.flow.keyframes import Number, weight_at
from pipeline.flow.program import Program, grouped, placed, scaled
from pipeline.flow.regions import MAX_SLOPE, Region
from pipeline.flow.velocity import VelocityField

GRID = 9
"""Samples of the speed of a field in a region, along each side of the region's box."""


@dataclass(frozen=True)
class Sum(VelocityField):
    """Velocities added up, then integrated together: the order of the fields does not matter."""

    fields: tuple[VelocityField, ...]

    def program(self, time: float) -> Program:
        return tuple(row for field in self.fields for row in field.program(time))

    def gradient_bound(self, time: float) -> float:
        return sum(field.gradient_bound(time) for field in self.fields)

    def leaves(self, point: Points, time: float) -> Iterator[tuple[VelocityField, Points]]:
        for field in self.fields:
            yield from field.leaves(point, time)

    @property
    def name(self) -> str:
        return " + ".join(field.name for field in self.fields)


@dataclass(frozen=True)
class ScaledField(VelocityField):
    """A field with its velocities multiplied by a weight from 0 to 1, or by the rest of it.

    rest  the factor is 1 − weight
    """

    field: VelocityField
    weight: Number
    rest: bool = False

    def program(self, time: float) -> Program:
        return scaled(self.field.program(time), self._factor(time))

    def gradient_bound(self, time: float) -> float:
        return self._factor(time) * self.field.gradient_bound(time)

    def leaves(self, point: Points, time: float) -> Iterator[tuple[VelocityField, Points]]:
        return self.field.leaves(point, time)

    @property
    def name(self) -> str:
        return self.field.name

    def _factor(self, time: float) -> float:
        weight = weight_at(self.weight, time, self.name)
        return 1.0 - weight if self.rest else weight


@dataclass(frozen=True)
class RegionField(VelocityField):
    """A field within a region: its velocities times the region's weight at each point and time."""

    field: VelocityField
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

    def leaves(self, point: Points, time: float) -> Iterator[tuple[VelocityField, Points]]:
        return self.field.leaves(point, time)

    @property
    def name(self) -> str:
        return f"{self.field.name} within a {self.region.name}"


@dataclass(frozen=True)
class TransformedField(VelocityField):
    """A field with a transform, keyed or not, or a mirror: see `Placed`."""

    field: VelocityField
    transform: Transform | Mirror

    def program(self, time: float) -> Program:
        origin, axes = self.transform.at(time)
        return placed(self.field.program(time), tuple(origin.tolist()), axes)

    def gradient_bound(self, time: float) -> float:
        """Return the field's bound: speeds and distances scale alike."""
        return self.field.gradient_bound(time)

    def leaves(self, point: Points, time: float) -> Iterator[tuple[VelocityField, Points]]:
        origin, axes = self.transform.at(time)
        return self.field.leaves(np.asarray(np.linalg.solve(axes, point - origin), np.float64), time)

    @property
    def name(self) -> str:
        return f"{self.transform.name} {self.field.name}"
