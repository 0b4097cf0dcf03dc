"""Deformations with one parameter, `amount`, after Barr.

Source: Barr, *Global and Local Deformations of Solid Primitives*, SIGGRAPH 84. P3.

Each is a family of maps D(a) that form a group: D(b) D(a)⁻¹ is again of the family. Between two frames
the flow applies D(amount after) D(amount before)⁻¹, which needs no inverse, except for a bend. So a keyed
deformation equals the closed form at every frame, keeps what other flows did to the subject meanwhile, and
has no integration error.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass, fields
from typing import Annotated, Any

import numpy as np

from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.errors import FrameError
from flowsculpt.pipeline.flow.flow import Flow
from flowsculpt.pipeline.flow.kernels import deformation_kernels as kernels
from flowsculpt.pipeline.flow.parameters import (
    ORIGIN,
    Direction,
    Number,
    ParameterDoc,
    PositiveConstant,
    PositiveNumber,
    Vector,
    X,
    Y,
    across,
    number_at,
    unit,
)
from flowsculpt.pipeline.flow.streamlines import StepPlan


@dataclass(frozen=True)
class Deformation(Flow):
    """The base of all deformations: an axis through a centre, and the amount, constant or keyed."""

    axis: Annotated[Direction, ParameterDoc("along which heights are measured")] = Y
    centre: Annotated[Vector, ParameterDoc("a point on the axis, where the height is 0", "units")] = ORIGIN
    amount: Annotated[Number, ParameterDoc("how much", required=True)] = 0.0

    def displace(self, points: Points, time: float, dt: float) -> Points:
        return self.step_plan(time, dt).follow(points, self.name)

    def step_plan(self, time: float, dt: float) -> StepPlan:
        """Return the step as one row of a plan; as none where the amount stays."""
        before, after = self._amounts(time, dt)
        if before == after:
            return StepPlan.of_deformation(dt)
        opcode, numbers = self._row(before, after)
        return StepPlan.of_deformation(dt, opcode, (*self.centre, *unit(self.axis), *numbers))

    def cache_data(self, time: float, dt: float) -> Any:
        before, after = self._amounts(time, dt)
        own = {
            f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("axis", "centre", "amount")
        }
        return {self.name: [*self.centre, *unit(self.axis)], "before": before, "after": after, **own}

    def between(self, points: Points, before: Any, after: Any) -> Points:
        """Return points (N, 3) as D(after) D(before)⁻¹ moves them, by amounts (N,) or one for all."""
        opcode, numbers = self._row(before, after)
        columns = [np.broadcast_to(x, len(points)) for x in (*self.centre, *unit(self.axis), *numbers)]
        moved = np.array(points, np.float64, order="C")
        kernels.deform_each(opcode, np.stack(columns, axis=1), moved)
        return moved

    @abstractmethod
    def _row(self, before: Any, after: Any) -> tuple[int, tuple[Any, ...]]:
        """Return the opcode of D(after) D(before)⁻¹, and its numbers after those of the axis, maybe (N,)."""

    def _amounts(self, time: float, dt: float) -> tuple[float, float]:
        return float(number_at(self.amount, time)), float(number_at(self.amount, time + dt))


@dataclass(frozen=True)
class Twist(Deformation):
    """Turns about the axis by amount × height along it, like a wrung towel; keeps volume."""

    amount: Annotated[Number, ParameterDoc("turning by height", "degrees/unit", required=True)] = 0.0

    def _row(self, before: Any, after: Any) -> tuple[int, tuple[Any, ...]]:
        return kernels.TWIST, (after - before,)


@dataclass(frozen=True)
class Taper(Deformation):
    """Widens across the axis by exp(amount × height along it): a cube becomes a flared block."""

    amount: Annotated[Number, ParameterDoc("negative narrows upwards", "1/unit", required=True)] = 0.0

    def _row(self, before: Any, after: Any) -> tuple[int, tuple[Any, ...]]:
        return kernels.TAPER, (after - before,)


@dataclass(frozen=True)
class Stretch(Deformation):
    """Scales along the axis by amount, and across it by 1/√amount so that the volume stays."""

    amount: Annotated[PositiveNumber, ParameterDoc("factor of length: 1 is unchanged", required=True)] = 1.0
    keep_volume: Annotated[bool, ParameterDoc("false keeps the width instead")] = True

    def _row(self, before: Any, after: Any) -> tuple[int, tuple[Any, ...]]:
        least = np.minimum(before, after).min()
        if not least > 0:
            raise FrameError(
                f"stretch amount {least:g} is not above 0; it is a factor of length. "
                "Write 1 for unchanged, 2 for twice as long."
            )
        lengthen = after / before
        widen = 1 / np.sqrt(lengthen) if self.keep_volume else 1.0
        return kernels.STRETCH, (lengthen, widen)


class _Directed(Deformation):
    """A deformation with a direction; only its part across the axis counts."""

    direction: Vector

    def cache_data(self, time: float, dt: float) -> Any:
        return {**super().cache_data(time, dt), "direction": list(self._across())}

    def _across(self) -> Vector:
        return across(self.axis, self.direction)


@dataclass(frozen=True)
class Shear(_Directed):
    """Slides in a direction by amount × height along the axis, like a pack of cards; keeps volume."""

    amount: Annotated[Number, ParameterDoc("slide by height", required=True)] = 0.0
    direction: Annotated[Direction, ParameterDoc("of sliding; its part across the axis counts")] = X

    def _row(self, before: Any, after: Any) -> tuple[int, tuple[Any, ...]]:
        return kernels.SHEAR, (*self._across(), after - before)


@dataclass(frozen=True)
class Bend(_Directed):
    """Bends the axis to an arc; beyond the bent length it goes straight on.

    Between the heights −length/2 and length/2 the axis becomes an arc of the curvature `amount`, radians per
    unit of length; the space across the axis goes along. The arc opens in `direction`. Bending is undone
    exactly. Points beyond the centre of curvature, 1/amount away, would fold, and should not exist. The whole
    arc must not turn by more than 360 degrees.
    """

    amount: Annotated[Number, ParameterDoc("turning by length", "degrees/unit", required=True)] = 0.0
    direction: Annotated[
        Direction, ParameterDoc("towards which it bends; its part across the axis counts")
    ] = X
    length: Annotated[PositiveConstant, ParameterDoc("of the bent part, about the centre", "units")] = 2.0

    def _row(self, before: Any, after: Any) -> tuple[int, tuple[Any, ...]]:
        most = np.maximum(abs(before), abs(after)).max()
        if most * self.length > 2 * math.pi * (1 + 1e-12):
            raise FrameError(
                f"bend amount {math.degrees(most):g} degrees per unit turns a length of {self.length:g} by "
                f"{math.degrees(most * self.length):g} degrees; 360 are the most. Lower amount or length."
            )
        return kernels.BEND, (*self._across(), 0.5 * self.length, before, after)


FLOWS: tuple[type, ...] = (Twist, Taper, Stretch, Shear, Bend)
