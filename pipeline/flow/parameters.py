"""The parameters of flows: vectors, values constant or changing in time, and their documentation.

    strength: Annotated[Number, ParameterDoc("circulation about the axis", "units²/s")] = 1.0

Shot files, their errors, the list of flows and its page in the docs are all made from these annotations.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
import re
import typing
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np

from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.errors import FrameError, UsageError

Vector = tuple[float, float, float]

X: Vector = (1.0, 0.0, 0.0)
Y: Vector = (0.0, 1.0, 0.0)
Z: Vector = (0.0, 0.0, 1.0)
ORIGIN: Vector = (0.0, 0.0, 0.0)


def unit(axis: Vector) -> Vector:
    """Return the axis with length 1. Raises UsageError where it has no direction."""
    length = math.hypot(*axis)
    if not (length > 1e-12 and math.isfinite(length)):
        raise UsageError(f"axis {axis} has no direction; write x, y, z or a vector such as [0, 1, 1]")
    x, y, z = axis
    return x / length, y / length, z / length


def across(axis: Vector, direction: Vector) -> Vector:
    """Return the part of a direction across an axis, with length 1. Raises UsageError where there is none."""
    (a, b, c), (x, y, z) = unit(axis), unit(direction)
    along = a * x + b * y + c * z
    return unit((x - along * a, y - along * b, z - along * c))


def transform(matrix: Floats, points: Points) -> Points:
    """Return matrix (3, 3) · each of points (N, 3), with bits that do not depend on the other points."""
    x, y, z = points.T[:, :, None]
    return x * matrix[:, 0] + y * matrix[:, 1] + z * matrix[:, 2]


def kernel_points(points: Points) -> Points:
    """Return points (N, 3) as the kernels' declared type: a read-only array would have another."""
    return np.require(points, np.float64, ["C", "W"])


Values = tuple[float, ...]


class Curve(ABC):
    """Values that change in time. A value: the same time gives the same numbers, between frames too."""

    @abstractmethod
    def at(self, time: float) -> Values:
        """Return the values at a time, seconds from the start of the shot."""


Number = float | Curve
"""A scalar parameter: constant or changing in time."""

VectorParameter = Vector | Curve
"""A vector parameter: constant or changing in time."""


def number_at(parameter: Number, time: float) -> float:
    """Return the value of a parameter at a time, seconds of the shot."""
    if isinstance(parameter, float):  # planning asks millions of times, and a look for an ABC is slow
        return parameter
    return parameter.at(time)[0] if isinstance(parameter, Curve) else parameter


def vector_at(parameter: VectorParameter, time: float) -> Vector:
    """Return the value of a parameter with three components at a time, seconds of the shot."""
    if isinstance(parameter, tuple):
        return parameter
    if isinstance(parameter, Curve):
        x, y, z = parameter.at(time)
        return x, y, z
    return parameter


def weight_at(weight: Number, time: float, name: str) -> float:
    """Return the weight of the flow `name` at a time. Raises FrameError where it is not from 0 to 1."""
    value = float(number_at(weight, time))
    if not -1e-12 <= value <= 1.0 + 1e-12:
        raise FrameError(
            f"flow {name} has the weight {value:g} at {time:g} s; a weight is from 0 to 1. "
            "Correct its keys, or choose an easing that does not overshoot."
        )
    return min(max(value, 0.0), 1.0)


Form = Literal[
    "number", "vector", "point", "direction", "constant", "whole", "choice", "switch", "text", "other"
]

POSITIVE, DIRECTION = "positive", "direction"

PositiveNumber = Annotated[Number, POSITIVE]
"""A number above 0, constant or keyed."""

PositiveConstant = Annotated[float, POSITIVE]
"""A number above 0 that no keys change."""

Direction = Annotated[Vector, DIRECTION]
"""Any vector but 0; its length does not count. Shot files may name an axis."""


@dataclass(frozen=True)
class ParameterDoc:
    """The documentation of a parameter.

    text      one line
    unit      the unit in shot files; one that begins with degrees is radians in code
    required  a shot must give it, though Python has a default
    bounds    the least and greatest value of a constant
    """

    text: str
    unit: str = ""
    required: bool = False
    bounds: tuple[float, float] | None = None

    @property
    def factor(self) -> float:
        """The factor from a value in a shot file to the code's value."""
        return math.radians(1.0) if self.unit.startswith("degrees") else 1.0


@dataclass(frozen=True)
class Parameter:
    """One parameter of a flow.

    form      number and vector may be keyed; constant and point are the same without keys
    positive  True if it must be above 0
    default   as in code; dataclasses.MISSING where it has none
    choices   the words of a choice
    kind      its annotated type, for parameters with a form of their own
    """

    name: str
    form: Form
    doc: ParameterDoc
    positive: bool
    default: Any
    choices: tuple[str, ...]
    kind: Any

    @property
    def description(self) -> str:
        """One line about it, with its unit in parentheses."""
        return f"{self.doc.text} ({self.doc.unit})" if self.doc.unit else self.doc.text

    @property
    def needed(self) -> bool:
        """True if a shot must give it."""
        return self.doc.required or self.default is dataclasses.MISSING

    @property
    def default_in_file(self) -> Any:
        """Its default as a shot file would write it; None where a shot must give it."""
        if self.needed:
            return None
        if self.form in ("number", "constant"):
            return round(self.default / self.doc.factor, 12)
        if self.form == "direction":
            return _AXES.get(self.default, list(self.default))
        return list(self.default) if self.form in ("vector", "point") else self.default


_AXES = {X: "x", Y: "y", Z: "z"}
_FORMS: dict[Any, Form] = {
    Number: "number",
    VectorParameter: "vector",
    float: "constant",
    int: "whole",
    bool: "switch",
    str: "text",
}


def parameters_of(flow: type) -> tuple[Parameter, ...]:
    """Return the parameters of a flow's dataclass, in their order: its fields that have a ParameterDoc."""
    kinds = typing.get_type_hints(flow, include_extras=True)
    return tuple(
        parameter(field.name, kinds[field.name], field.default)
        for field in dataclasses.fields(flow)
        if any(isinstance(mark, ParameterDoc) for mark in _marks(kinds[field.name]))
    )


def shot_name(flow: type) -> str:
    """Return a flow's name in shot files and messages: `vortex_ring` for VortexRing."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", flow.__name__).lower()


def summary(flow: type) -> str:
    """Return the first sentence of a flow's docstring."""
    return inspect.cleandoc(flow.__doc__ or "").partition("\n")[0]


def parameter(name: str, annotation: Any, default: Any) -> Parameter:
    """Return the parameter that a field's annotation describes."""
    marks = _marks(annotation)
    kind = typing.get_args(annotation)[0] if marks else annotation
    return Parameter(
        name=name,
        form=_form(kind, DIRECTION in marks),
        doc=next((mark for mark in reversed(marks) if isinstance(mark, ParameterDoc)), ParameterDoc("")),
        positive=POSITIVE in marks,
        default=default,
        choices=typing.get_args(kind) if typing.get_origin(kind) is Literal else (),
        kind=kind,
    )


def _marks(annotation: Any) -> tuple[Any, ...]:
    return typing.get_args(annotation)[1:] if typing.get_origin(annotation) is Annotated else ()


def _form(kind: Any, direction: bool) -> Form:
    if kind == Vector:
        return "direction" if direction else "point"
    return "choice" if typing.get_origin(kind) is Literal else _FORMS.get(kind, "other")
