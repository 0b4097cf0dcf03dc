"""What values in shot files look like: strict, with names that are checked against a registry."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any, Generic, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, Tag
from pydantic_core import PydanticCustomError

from pipeline.errors import suggestion
from pipeline.flow.catalogue.directions import X, Y, Z
from pipeline.flow.choreography import Keyframes, Number, Place, Vector
from pipeline.flow.easing import EASINGS
from pipeline.flow.velocity import MOST_SUBSTEPS
from pipeline.shot.clock import Clock

T = TypeVar("T")

DEGREE = math.radians(1.0)

SMALLEST, LARGEST = 1e-9, 1e12
"""Measures and numbers whose squares, inverses and differences stay finite with room to spare."""


class Document(BaseModel):
    """A mapping in a shot file: no unknown keys, no silent conversions."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


def one_of(names: Iterable[str], what: str) -> AfterValidator:
    """A validator: the text must be one of `names`."""
    known = tuple(names)

    def check(word: str) -> str:
        if word not in known:
            raise PydanticCustomError(
                "unknown_name",
                "{word} is no {what}. {suggestion}",
                {"word": repr(word), "what": what, "suggestion": suggestion(word, known)},
            )
        return word

    return AfterValidator(check)


def _computable(value: float) -> float:
    if abs(value) > LARGEST:
        raise PydanticCustomError(
            "too_large",
            "{value} is too large to compute with; numbers go up to 1e12. Write a smaller one.",
            {"value": f"{value:g}"},
        )
    return value


def _not_tiny(value: float) -> float:
    if value < SMALLEST:
        raise PydanticCustomError(
            "too_small",
            "{value} is too small to compute with; measures start at 1e-9. Write a larger one.",
            {"value": f"{value:g}"},
        )
    return value


def _form(value: Any) -> str:
    return "keyed" if isinstance(value, dict) else "list" if isinstance(value, list) else "plain"


Ease = Annotated[str, one_of(EASINGS, "easing")]
Real = Annotated[float, AfterValidator(_computable)]
Positive = Annotated[float, Field(gt=0), AfterValidator(_not_tiny), AfterValidator(_computable)]
Count = Annotated[int, Field(ge=1, le=MOST_SUBSTEPS)]
Triple = Annotated[list[Real], Field(min_length=3, max_length=3)]
AxisName = Annotated[str, one_of(("x", "y", "z"), "axis")]
Axis = Annotated[Annotated[AxisName, Tag("plain")] | Annotated[Triple, Tag("list")], Discriminator(_form)]
Colour = Annotated[list[Annotated[float, Field(ge=0, le=1)]], Field(min_length=3, max_length=3)]


class Key(Document, Generic[T]):
    """One key with an easing of its own, for the way from it to the next."""

    value: T
    ease: Ease


KeyValue = Annotated[
    Annotated[T, Tag("plain")] | Annotated[T, Tag("list")] | Annotated[Key[T], Tag("keyed")],
    Discriminator(_form),
]


class Keyed(Document, Generic[T]):
    """`{ease: sine_in_out, keys: {1: 0, 20: 4}}`; whether the times are good is for `checks` to say."""

    keys: dict[Any, KeyValue[T]] = Field(min_length=1)
    ease: Ease = "sine_in_out"


# A constant or keys. Spelt out for each kind: a generic alias would lose the kind within Keyed.
NumberField = Annotated[
    Annotated[Real, Tag("plain")] | Annotated[Real, Tag("list")] | Annotated[Keyed[Real], Tag("keyed")],
    Discriminator(_form),
]
PositiveField = Annotated[
    Annotated[Positive, Tag("plain")]
    | Annotated[Positive, Tag("list")]
    | Annotated[Keyed[Positive], Tag("keyed")],
    Discriminator(_form),
]
PlaceField = Annotated[
    Annotated[Triple, Tag("plain")] | Annotated[Triple, Tag("list")] | Annotated[Keyed[Triple], Tag("keyed")],
    Discriminator(_form),
]


def number(parameter: float | Keyed[Any], clock: Clock, unit: float = 1.0) -> Number:
    """A parsed scalar as a flow takes it; `unit` turns the file's unit into the code's."""
    if isinstance(parameter, Keyed):
        return _keyframes(parameter, clock, lambda value: (float(value) * unit,))
    return float(parameter) * unit


def place(parameter: list[float] | Keyed[Any], clock: Clock) -> Place:
    """A parsed vector as a flow takes it."""
    return _keyframes(parameter, clock, vector) if isinstance(parameter, Keyed) else vector(parameter)


def vector(values: list[float]) -> Vector:
    x, y, z = values
    return float(x), float(y), float(z)


def axis(value: str | list[float]) -> Vector:
    return {"x": X, "y": Y, "z": Z}[value] if isinstance(value, str) else vector(value)


def _keyframes(keyed: Keyed[Any], clock: Clock, convert: Any) -> Keyframes:
    times, values, eases = [], [], []
    for key, item in keyed.keys.items():
        seconds = clock.seconds(key)
        assert seconds is not None, "checks refused keys that are no times"
        times.append(seconds)
        values.append(convert(item.value if isinstance(item, Key) else item))
        eases.append(item.ease if isinstance(item, Key) else keyed.ease)
    return Keyframes(tuple(times), tuple(values), tuple(eases))
