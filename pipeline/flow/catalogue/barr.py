"""Deformations with one parameter, `amount`, after Barr.

Source: Barr, *Global and Local Deformations of Solid Primitives*, SIGGRAPH 84. P3.

Each is a family of maps D(a) that form a group: D(b) D(a)⁻¹ is again of the family. Between two frames
the flow applies D(amount after) D(amount before)⁻¹, which needs no inverse of anything bent; so a keyed
deformation equals the closed form at every frame, whatever other flows did to the subject meanwhile is
kept, and no integration error exists.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.arrays import Floats, Points
from pipeline.errors import FrameError
from pipeline.flow import _kernels_deform as kernels
from pipeline.flow.catalogue.directions import ORIGIN, X, Y, unit
from pipeline.flow.choreography import Number, Vector, number_at
from pipeline.flow.flow import Flow, for_kernels


@dataclass(frozen=True)
class Deformation(Flow):
    """What all share: an axis through a centre, and the amount, constant or keyed."""

    axis: Vector = Y
    centre: Vector = ORIGIN
    amount: Number = 0.0

    def displace(self, points: Points, time: float, dt: float) -> Points:
        points = for_kernels(points)
        before, after = self._amounts(time, dt)
        if before == after:
            return points
        out = np.empty_like(points)
        self._deform(points, before, after, out)
        return out

    def acting(self, time: float, dt: float) -> Any:
        before, after = self._amounts(time, dt)
        return {self.name: [*self.centre, *unit(self.axis)], "before": before, "after": after}

    @abstractmethod
    def _deform(self, points: Points, before: float, after: float, out: Points) -> None:
        """D(after) D(before)⁻¹ of points (N, 3) into `out`."""

    def _amounts(self, time: float, dt: float) -> tuple[float, float]:
        return float(number_at(self.amount, time)), float(number_at(self.amount, time + dt))

    def _line(self) -> tuple[Floats, Floats]:
        return np.array(self.centre, dtype=np.float64), np.array(unit(self.axis))


@dataclass(frozen=True)
class Twist(Deformation):
    """Turned about the axis by amount × height along it: like a wrung towel. Keeps volume.

    amount  radians per unit
    """

    def _deform(self, points: Points, before: float, after: float, out: Points) -> None:
        kernels.twist(points, *self._line(), after - before, out)


@dataclass(frozen=True)
class Taper(Deformation):
    """Widened across the axis by exp(amount × height along it): a cube becomes a flared block.

    amount  per unit; negative narrows upwards
    """

    def _deform(self, points: Points, before: float, after: float, out: Points) -> None:
        kernels.taper(points, *self._line(), after - before, out)


@dataclass(frozen=True)
class Stretch(Deformation):
    """Scaled along the axis by `amount`, and across it by 1/√amount so that the volume stays.

    amount  a factor above 0: 1 is as it was, 3 is three times as long
    keep_volume  False leaves the width alone
    """

    amount: Number = 1.0
    keep_volume: bool = True

    def _deform(self, points: Points, before: float, after: float, out: Points) -> None:
        if not (before > 0 and after > 0):
            raise FrameError(
                f"stretch amount {min(before, after):g} is not above 0; it is a factor of length. "
                "Write 1 for as it was, 2 for twice as long."
            )
        lengthen = after / before
        kernels.stretch(
            points, *self._line(), lengthen, 1 / math.sqrt(lengthen) if self.keep_volume else 1.0, out
        )

    def acting(self, time: float, dt: float) -> Any:
        return {**super().acting(time, dt), "keep_volume": self.keep_volume}


@dataclass(frozen=True)
class Shear(Deformation):
    """Slid in `direction` by amount × height along the axis, like a pack of cards. Keeps volume.

    direction  the part of it across the axis counts
    """

    direction: Vector = X

    def _deform(self, points: Points, before: float, after: float, out: Points) -> None:
        centre, axis = self._line()
        kernels.shear(points, centre, axis, self._across(), after - before, out)

    def acting(self, time: float, dt: float) -> Any:
        return {**super().acting(time, dt), "direction": self._across().tolist()}

    def _across(self) -> Floats:
        axis, direction = np.array(unit(self.axis)), np.array(unit(self.direction))
        x, y, z = (direction - axis * (axis @ direction)).tolist()
        return np.array(unit((x, y, z)))
