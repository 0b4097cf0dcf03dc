"""What a flow's parameters are, read off its dataclass: the one place that knows them.

    strength: Annotated[Number, Sense("circulation, counter-clockwise about the axis", "units²/s")] = 1.0

Shot files, their errors, the list of flows and its page in the docs are all made from these.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
import re
import typing
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pipeline.flow.keyframes import Number, Place, Vector

Form = Literal[
    "number", "place", "point", "direction", "constant", "whole", "choice", "switch", "text", "other"
]

POSITIVE, DIRECTION = "positive", "direction"

Positive = Annotated[Number, POSITIVE]
"""A number above 0, constant or keyed."""

PositiveConstant = Annotated[float, POSITIVE]

Direction = Annotated[Vector, DIRECTION]
"""Any vector but 0; its length does not count. Shot files may name an axis."""


@dataclass(frozen=True)
class Sense:
    """What a parameter means.

    text      one line
    unit      of its values in shot files; what begins with degrees is radians in code
    required  a shot has to say it, though Python has a default
    """

    text: str
    unit: str = ""
    required: bool = False

    @property
    def factor(self) -> float:
        """What turns a value of a shot file into the code's."""
        return math.radians(1.0) if self.unit.startswith("degrees") else 1.0


@dataclass(frozen=True)
class Between:
    """Where a constant has to be, its ends too."""

    low: float
    high: float


@dataclass(frozen=True)
class Parameter:
    """One parameter of a flow.

    form      number and place may be keyed; point and constant are the same without keys
    positive  whether it has to be above 0
    bounds    where else it has to be
    default   as in code; dataclasses.MISSING where it has none
    choices   the words that a choice is between
    kind      its type as annotated, for what has a form of its own
    """

    name: str
    form: Form
    sense: Sense
    positive: bool
    bounds: Between | None
    default: Any
    choices: tuple[str, ...]
    kind: Any

    @property
    def needed(self) -> bool:
        """Whether a shot has to say it."""
        return self.sense.required or self.default is dataclasses.MISSING

    @property
    def default_in_file(self) -> Any:
        """Its default as a shot file would write it; None where it has to be said."""
        if self.needed:
            return None
        if self.form in ("number", "constant"):
            return round(self.default / self.sense.factor, 12)
        if self.form == "direction":
            return _AXES.get(self.default, list(self.default))
        return list(self.default) if self.form in ("place", "point") else self.default


_AXES = {(1.0, 0.0, 0.0): "x", (0.0, 1.0, 0.0): "y", (0.0, 0.0, 1.0): "z"}


def parameters_of(flow: type) -> tuple[Parameter, ...]:
    """The parameters of a flow's dataclass, in their order: its fields that have a Sense."""
    kinds = typing.get_type_hints(flow, include_extras=True)
    return tuple(
        parameter(field.name, kinds[field.name], field.default)
        for field in dataclasses.fields(flow)
        if any(isinstance(mark, Sense) for mark in _marks(kinds[field.name]))
    )


def shot_name(flow: type) -> str:
    """What shot files and messages call a flow: `vortex_ring` for VortexRing."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", flow.__name__).lower()


def summary(flow: type) -> str:
    """The first sentence of what a flow says of itself."""
    return inspect.cleandoc(flow.__doc__ or "").partition("\n")[0]


def parameter(name: str, annotation: Any, default: Any) -> Parameter:
    """What a field says of itself by its type's marks."""
    marks = _marks(annotation)
    kind = typing.get_args(annotation)[0] if marks else annotation
    return Parameter(
        name=name,
        form=_form(kind, DIRECTION in marks),
        sense=next((mark for mark in reversed(marks) if isinstance(mark, Sense)), Sense("")),
        positive=POSITIVE in marks,
        bounds=next((mark for mark in marks if isinstance(mark, Between)), None),
        default=default,
        choices=typing.get_args(kind) if typing.get_origin(kind) is Literal else (),
        kind=kind,
    )


def _marks(annotation: Any) -> tuple[Any, ...]:
    return typing.get_args(annotation)[1:] if typing.get_origin(annotation) is Annotated else ()


def _form(kind: Any, direction: bool) -> Form:
    forms: dict[Any, Form] = {
        Number: "number",
        Place: "place",
        float: "constant",
        int: "whole",
        bool: "switch",
        str: "text",
    }
    if kind == Vector:
        return "direction" if direction else "point"
    if typing.get_origin(kind) is Literal:
        return "choice"
    return forms.get(kind, "other")
