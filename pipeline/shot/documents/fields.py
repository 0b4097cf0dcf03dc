"""What values in shot files look like: strict, with names that are checked against a registry."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    GetJsonSchemaHandler,
    Tag,
)
from pydantic_core import CoreSchema, PydanticCustomError

from pipeline.errors import suggestion
from pipeline.flow.streamlines import MAX_SUBSTEPS
from pipeline.flow.vectors import Vector, X, Y, Z
from pipeline.formula import Expression, FormulaError

DEGREE = math.radians(1.0)

SMALLEST, LARGEST = 1e-9, 1e12
"""Measures and numbers whose squares, inverses and differences stay finite with room to spare."""


class Document(BaseModel):
    """A mapping in a shot file: no unknown keys, no silent conversions.

    renamed  words that shot files said in earlier versions, and what they are called now
    """

    renamed: ClassVar[Mapping[str, str]] = {}

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)


class Told:
    """Keywords of a JSON Schema for what validators do, which it does not see: `Told(minimum=0)`."""

    def __init__(self, **keywords: Any) -> None:
        self.keywords = keywords

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {**handler(core), **self.keywords}


@dataclass(frozen=True)
class OneOf(AfterValidator):
    """A validator that knows what it lets pass."""

    names: tuple[str, ...] = ()

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {**handler(core), "enum": list(self.names)}


def one_of(names: Iterable[str], what: str) -> OneOf:
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

    return OneOf(check, known)


def exactly_one(*names: str) -> ConfigDict:
    """For documents of which a validator says that: one of these names, and no other."""
    return ConfigDict(json_schema_extra={"oneOf": [{"required": [name]} for name in names]})


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
    return "list" if isinstance(value, list) else "plain"


Real = Annotated[float, AfterValidator(_computable), Told(minimum=-LARGEST, maximum=LARGEST)]
Positive = Annotated[
    float,
    Field(gt=0),
    AfterValidator(_not_tiny),
    AfterValidator(_computable),
    Told(minimum=SMALLEST, maximum=LARGEST),
]
Count = Annotated[int, Field(ge=1, le=MAX_SUBSTEPS)]
Triple = Annotated[list[Real], Field(min_length=3, max_length=3)]
AxisName = Annotated[str, one_of(("x", "y", "z"), "axis")]
Across = Annotated[Triple, Told(**{"not": {"const": [0, 0, 0]}})]
Axis = Annotated[Annotated[AxisName, Tag("plain")] | Annotated[Across, Tag("list")], Discriminator(_form)]
Colour = Annotated[list[Annotated[float, Field(ge=0, le=1)]], Field(min_length=3, max_length=3)]


def vector(values: list[float]) -> Vector:
    x, y, z = values
    return float(x), float(y), float(z)


def axis(value: str | list[float]) -> Vector:
    return {"x": X, "y": Y, "z": Z}[value] if isinstance(value, str) else vector(value)


def is_number(value: Any) -> bool:
    """Whether a value of a file is a number; true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def misread(column: int, message: str) -> PydanticCustomError:
    """What is wrong with a formula, from the character `column` of it on."""
    return PydanticCustomError("formula", "{message}", {"message": message, "column": column})


def readable(text: str, names: tuple[str, ...]) -> str:
    """A text that is a formula over these names. Raises a finding for pydantic to report at its column."""
    try:
        Expression(text, names)
    except FormulaError as error:
        raise misread(error.column, error.message) from None
    return text


def over(names: tuple[str, ...]) -> AfterValidator:
    """A validator: the text is a formula over these names."""
    return AfterValidator(lambda text: readable(text, names))


def _written(value: Any) -> Any:
    if not is_number(value):
        return value
    if math.isnan(value):
        raise misread(1, "this is no number; write one plainly, such as 0.05")
    if math.isinf(value):
        raise misread(1, "this number is too large; 1e100 is the largest")
    return repr(value)


class NumberToo(BeforeValidator):
    """A validator that lets numbers pass as text, and tells so in a schema."""

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {**handler(core), "type": ["string", "number"]}


A_NUMBER_TOO = NumberToo(_written)
"""`0` and `0.5` are formulas."""
