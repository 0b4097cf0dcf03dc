"""Formulas in shot files: text, or a number that is one too; what is wrong is told with its column."""

from __future__ import annotations

import math
from typing import Any

from pydantic import AfterValidator, BeforeValidator, GetJsonSchemaHandler
from pydantic_core import CoreSchema, PydanticCustomError

from pipeline.formula import Expression, FormulaError
from pipeline.shot.documents.fields import is_number


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
