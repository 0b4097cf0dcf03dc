"""What changes in time in a shot file: a constant, keys, or a formula."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any, Generic, NamedTuple, TypeVar

from pydantic import AfterValidator, Discriminator, Field, Tag, ValidationInfo
from pydantic_core import PydanticCustomError

from pipeline.errors import UsageError
from pipeline.flow.easing import EASINGS
from pipeline.flow.formula_curve import FormulaCurve
from pipeline.flow.keyframes import BEZIER, Curve, Handle, Keyframes, Number, Values, VectorParameter
from pipeline.formula import TIME
from pipeline.shot.clock import A_TIME, Clock
from pipeline.shot.documents.fields import (
    A_NUMBER_TOO,
    Document,
    Positive,
    Real,
    Told,
    Triple,
    one_of,
    over,
    vector,
)

T = TypeVar("T")

MOST_LOOKS = 4000
"""At so many moments of a shot at most is a curve looked at before it is used."""

Ease = Annotated[str, one_of((*EASINGS, BEZIER), "easing")]
Beyond = Annotated[str, one_of(("hold", "loop", "ping_pong", "offset", "continue"), "way to go on")]


Handles = Annotated[
    Any,
    Told(
        type=["array", "null"],
        prefixItems=[{"type": ["number", "string"]}, {"type": ["number", "array"]}],
        minItems=2,
        maxItems=2,
    ),
]
"""Of a way that is Bézier's; `keys` says what they must be."""


class Key(Document, Generic[T]):
    """One key with an easing of its own, for the way from it to the next, and handles where that is Bézier's.

    left, right  [time, value] away from the key; their form is for `keys` to check
    """

    value: T
    ease: Ease | None = None
    left: Handles = None
    right: Handles = None


KeyValue = Annotated[
    Annotated[T, Tag("plain")] | Annotated[T, Tag("list")] | Annotated[Key[T], Tag("keyed")],
    Discriminator(lambda value: "keyed" if isinstance(value, dict) else "plain"),
]


class Keyed(Document, Generic[T]):
    """`{ease: sine_in_out, keys: {1: 0, 20: 4}, after: loop}`; `keys` says whether times are good."""

    keys: Annotated[dict[Any, KeyValue[T]], Told(propertyNames={"pattern": A_TIME})] = Field(min_length=1)
    ease: Ease = "sine_in_out"
    before: Beyond = "hold"
    after: Beyond = "hold"


FormulaText = Annotated[str, A_NUMBER_TOO, over(TIME)]


class OverTime(Document):
    """`{formula: 4 * sin(2 * pi * t)}`: over moments."""

    formula: FormulaText


class OverTimeTriple(Document):
    """`{formula: [cos(t), 0, sin(t)]}`"""

    formula: Annotated[list[FormulaText], Field(min_length=3, max_length=3)]


class Bounds(NamedTuple):
    """Where values must stay."""

    low: float
    high: float
    rule: str


ANYWHERE = Bounds(-math.inf, math.inf, "")
ABOVE_0 = Bounds(math.ulp(0.0), math.inf, "above 0")
NOT_BELOW_0 = Bounds(0.0, math.inf, "at 0 or above")
A_SHARE = Bounds(-1e-12, 1.0 + 1e-12, "from 0 to 1")


def stays(bounds: Bounds) -> AfterValidator:
    """A validator: in the course of the shot the values stay finite, and within bounds.

    The clock is in the context of the validation; without one nothing is looked at.
    """

    def check(value: Any, info: ValidationInfo) -> Any:
        clock: Clock | None = (info.context or {}).get("clock")
        if clock is None or not isinstance(value, Keyed | OverTime | OverTimeTriple):
            return value
        bad = _first_bad(value, clock, bounds)
        if bad:
            raise PydanticCustomError("bad_curve", "{fact}", {"fact": bad})
        return value

    return AfterValidator(check)


def _first_bad(value: Keyed[Any] | OverTime | OverTimeTriple, clock: Clock, bounds: Bounds) -> str | None:
    """The first moment, every half frame, at which values are not as they must be."""
    if isinstance(value, Keyed) and (bounds is ANYWHERE or None in map(clock.seconds, value.keys)):
        return None
    halves = 2 * (clock.frames.last - clock.frames.first) + 1
    times = [clock.time(clock.frames.first + i / 2) for i in range(0, halves, -(-halves // MOST_LOOKS))]
    curve = curve_of(value, clock, lambda item: (item,) if not isinstance(item, list) else tuple(item))
    try:
        rows = curve.over(times).tolist() if isinstance(curve, FormulaCurve) else map(curve.at, times)
        for time, row in zip(times, rows, strict=True):
            worst = min(row) if min(row) < bounds.low else max(row)
            if not bounds.low <= worst <= bounds.high:
                frame = clock.frames.first + float(clock.rate.fps) * time
                return (
                    f"is {worst:.4g} at frame {frame:g}; it must stay {bounds.rule}. Mend what leads there."
                )
    except UsageError as error:
        return f"has a value that is none: {error}"
    return None


Share = Annotated[float, Field(ge=0, le=1)]
NotNegative = Annotated[Real, Field(ge=0)]

# A constant, keys or a formula. Spelt out for each kind: a generic alias would lose the kind within Keyed.


def form(value: Any) -> str:
    """By which a union of what is plain, a list, keys and a formula is told apart."""
    if isinstance(value, dict):
        return "formula" if "formula" in value else "keyed"
    return "list" if isinstance(value, list) else "plain"


NumberField = Annotated[
    Annotated[Real, Tag("plain")]
    | Annotated[Real, Tag("list")]
    | Annotated[Keyed[Real], Tag("keyed")]
    | Annotated[OverTime, Tag("formula")],
    Discriminator(form),
    stays(ANYWHERE),
]
PositiveField = Annotated[
    Annotated[Positive, Tag("plain")]
    | Annotated[Positive, Tag("list")]
    | Annotated[Keyed[Positive], Tag("keyed")]
    | Annotated[OverTime, Tag("formula")],
    Discriminator(form),
    stays(ABOVE_0),
]
NotNegativeField = Annotated[
    Annotated[NotNegative, Tag("plain")]
    | Annotated[NotNegative, Tag("list")]
    | Annotated[Keyed[NotNegative], Tag("keyed")]
    | Annotated[OverTime, Tag("formula")],
    Discriminator(form),
    stays(NOT_BELOW_0),
]
WeightField = Annotated[
    Annotated[Share, Tag("plain")]
    | Annotated[Share, Tag("list")]
    | Annotated[Keyed[Share], Tag("keyed")]
    | Annotated[OverTime, Tag("formula")],
    Discriminator(form),
    stays(A_SHARE),
]
PlaceField = Annotated[
    Annotated[Triple, Tag("plain")]
    | Annotated[Triple, Tag("list")]
    | Annotated[Keyed[Triple], Tag("keyed")]
    | Annotated[OverTimeTriple, Tag("formula")],
    Discriminator(form),
    stays(ANYWHERE),
]


def number(parameter: float | Keyed[Any] | OverTime, clock: Clock, unit: float = 1.0) -> Number:
    """A parsed scalar as a flow takes it; `unit` turns the file's unit into the code's."""
    if isinstance(parameter, Keyed | OverTime):
        return curve_of(parameter, clock, lambda value: (float(value) * unit,), unit)
    return float(parameter) * unit


def place(
    parameter: list[float] | Keyed[Any] | OverTimeTriple, clock: Clock, unit: float = 1.0
) -> VectorParameter:
    """A parsed vector as a flow takes it."""
    if isinstance(parameter, Keyed | OverTimeTriple):
        return curve_of(parameter, clock, lambda value: tuple(unit * part for part in vector(value)), unit)
    x, y, z = vector(parameter)
    return unit * x, unit * y, unit * z


def curve_of(
    value: Keyed[Any] | OverTime | OverTimeTriple,
    clock: Clock,
    convert: Callable[[Any], Values],
    unit: float = 1.0,
) -> Curve:
    """Keys or a formula as a curve; `convert` makes a key's value one of the code's, which is in `unit`."""
    if isinstance(value, Keyed):
        return _keyframes(value, clock, convert)
    texts = [value.formula] if isinstance(value, OverTime) else value.formula
    return FormulaCurve(tuple(texts), float(clock.rate.fps), clock.frames.first, unit)


def _keyframes(keyed: Keyed[Any], clock: Clock, convert: Callable[[Any], Values]) -> Keyframes:
    def handle(drawn: list[Any] | None) -> Handle | None:
        return None if drawn is None else Handle(_sure(clock.length(drawn[0])), convert(drawn[1]))

    times, values, eases, left, right = [], [], [], [], []
    for moment, item in keyed.keys.items():
        key = item if isinstance(item, Key) else Key(value=item)
        times.append(_sure(clock.seconds(moment)))
        values.append(convert(key.value))
        eases.append(key.ease or (BEZIER if key.right else keyed.ease))
        left.append(handle(key.left))
        right.append(handle(key.right))
    drawn = any(left) or any(right)
    return Keyframes(
        tuple(times),
        tuple(values),
        tuple(eases),
        tuple(left) if drawn else (),
        tuple(right) if drawn else (),
        keyed.before,  # type: ignore[arg-type]  # one of them, as its validator says
        keyed.after,  # type: ignore[arg-type]  # likewise
    )


def _sure(seconds: float | None) -> float:
    assert seconds is not None, "checks refused what is no time"
    return seconds
