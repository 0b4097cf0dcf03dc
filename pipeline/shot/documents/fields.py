"""Types of values in shot files: strict numbers, names of a registry, vectors, colours and formulas."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Annotated, Any, Union, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    Tag,
)
from pydantic_core import CoreSchema, PydanticCustomError

from pipeline.errors import suggestion
from pipeline.flow.parameters import Vector, X, Y, Z
from pipeline.flow.streamlines import MAX_SUBSTEPS
from pipeline.formula import Expression, FormulaError
from pipeline.shot.yaml.validation import bad_value

DEGREE = math.radians(1.0)

ORIGIN = [0.0, 0.0, 0.0]

SMALLEST, LARGEST = 1e-9, 1e12
"""Bounds of measures and numbers: squares, inverses and differences stay finite."""


class Document(BaseModel):
    """A mapping in a shot file: no unknown keys, no silent conversions."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)


def optional(description: str, **rules: Any) -> Any:
    """Return a `Field` that may be left out. If it has a unit, its description ends with (unit)."""
    return Field(None, description=description, **rules)


class SchemaKeywords:
    """JSON Schema keywords for the rule of a validator, which pydantic does not see."""

    def __init__(self, **keywords: Any) -> None:
        self.keywords = keywords

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {**handler(core), **self.keywords}


@dataclass(frozen=True)
class ByForm:
    """An annotation of a union: a value is checked, and its mistakes are told, as one of the members only.

    choose  returns the index of the member for a value as the file has it
    """

    choose: Callable[[Any], int]

    def __get_pydantic_core_schema__(self, union: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        members = [Annotated[member, Tag(f"form {i}")] for i, member in enumerate(get_args(union))]
        tagged: Any = Union[*members]
        return handler(Annotated[tagged, Discriminator(lambda value: f"form {int(self.choose(value))}")])


MAPPING_IS_SECOND = ByForm(lambda value: isinstance(value, dict))
"""The form of a union of two, such as a name and a document: a mapping in the file is the second."""


@dataclass(frozen=True)
class OneOf(AfterValidator):
    """A validator that tells the JSON Schema the names it accepts."""

    names: tuple[str, ...] = ()

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {**handler(core), "enum": list(self.names)}


def one_of(names: Iterable[str], kind: str) -> OneOf:
    """Return a validator of text that must be one of `names`; `kind` is what messages call it."""
    known = tuple(names)

    def check(word: str) -> str:
        if word not in known:
            raise bad_value(f"{word!r} is no {kind}. {suggestion(word, known)}")
        return word

    return OneOf(check, known)


def exactly_one(*names: str) -> ConfigDict:
    """Return the JSON Schema of a document whose validator demands exactly one of these names."""
    return ConfigDict(json_schema_extra={"oneOf": [{"required": [name]} for name in names]})


def _check_largest(value: float) -> float:
    if abs(value) > LARGEST:
        raise bad_value(
            f"{value:g} is too large to compute with; numbers go up to 1e12. Write a smaller one."
        )
    return value


def _check_smallest(value: float) -> float:
    if value < SMALLEST:
        raise bad_value(
            f"{value:g} is too small to compute with; measures start at 1e-9. Write a larger one."
        )
    return value


Real = Annotated[float, AfterValidator(_check_largest), SchemaKeywords(minimum=-LARGEST, maximum=LARGEST)]
Positive = Annotated[
    float,
    Field(gt=0),
    AfterValidator(_check_smallest),
    AfterValidator(_check_largest),
    SchemaKeywords(minimum=SMALLEST, maximum=LARGEST),
]
ZeroToOne = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=1, le=MAX_SUBSTEPS)]
Degrees = Annotated[float, Field(ge=-3600, le=3600)]
Triple = Annotated[list[Real], Field(min_length=3, max_length=3)]
AxisName = Annotated[str, one_of(("x", "y", "z"), "axis")]
AxisVector = Annotated[Triple, SchemaKeywords(**{"not": {"const": [0, 0, 0]}})]
Axis = Annotated[AxisName | AxisVector, ByForm(lambda value: isinstance(value, list))]
Colour = Annotated[list[ZeroToOne], Field(min_length=3, max_length=3)]


def vector(values: list[float]) -> Vector:
    x, y, z = values
    return float(x), float(y), float(z)


def axis(value: str | list[float]) -> Vector:
    return {"x": X, "y": Y, "z": Z}[value] if isinstance(value, str) else vector(value)


def is_number(value: Any) -> bool:
    """Tell whether a value of a file is a number; true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def formula_error(column: int, message: str) -> PydanticCustomError:
    """Return a finding about a formula, from its character `column` on."""
    return PydanticCustomError("formula", "{message}", {"message": message, "column": column})


def parsed_formula(text: str, names: tuple[str, ...]) -> str:
    """Return a text that is a formula over these names. Raises a finding at the column of the mistake."""
    try:
        Expression(text, names)
    except FormulaError as error:
        raise formula_error(error.column, error.message) from None
    return text


def formula_over(names: tuple[str, ...]) -> AfterValidator:
    """Return a validator of text that must be a formula over these names."""
    return AfterValidator(lambda text: parsed_formula(text, names))


def _as_text(value: Any) -> Any:
    if not is_number(value):
        return value
    if math.isnan(value):
        raise formula_error(1, "this is no number; write one plainly, such as 0.05")
    if math.isinf(value):
        raise formula_error(1, "this number is too large; 1e100 is the largest")
    return repr(value)


NumberOrText = Annotated[str, BeforeValidator(_as_text), SchemaKeywords(type=["string", "number"])]
"""Text of a formula, which may be a number."""
