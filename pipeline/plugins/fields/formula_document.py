"""The entry `formula` of flows in a shot file."""

from typing import Annotated, Any, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    GetJsonSchemaHandler,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import CoreSchema

from flowsculpt.api import quote
from flowsculpt.api.flows import Expression, ParameterDoc
from flowsculpt.api.shots import Changing, Clock, FlowParameters, NumberField
from flowsculpt.pipeline.plugins.fields.compiled_formulas import NAMES
from flowsculpt.pipeline.plugins.fields.formula_field import MAX_NUMBERS, FormulaField


def _check_name(word: str) -> str:
    if not word.isidentifier() or word in {*NAMES, *Expression.RESERVED}:
        rule = "it is not a word, or has a meaning"
        raise ValueError(f"{quote(word)} cannot name a number: {rule}. Choose another.")
    return word


def _check_formula(text: str, info: ValidationInfo) -> str:
    if "numbers" not in info.data:
        return text  # the names are wrong themselves, so the formula's words are unknown
    return Expression(text, (*NAMES, *info.data["numbers"])).text


Text = Annotated[
    str,
    BeforeValidator(Expression.number_text),
    AfterValidator(_check_formula),
    WithJsonSchema({"type": ["string", "number"]}),
]


class FormulaDocument(FlowParameters):
    """`[-y, x, 0.3 * sin(t)]`, or with numbers of its own under `with`, which are validated first."""

    flow = FormulaField

    numbers: Annotated[
        dict[Annotated[str, AfterValidator(_check_name)], NumberField],
        Field(default_factory=dict, alias="with", max_length=MAX_NUMBERS),
        ParameterDoc("numbers for the formulas by their names, each constant or keyed"),
    ]
    velocity: Annotated[
        list[Text], Field(min_length=3, max_length=3), ParameterDoc("along x, y and z, over these", "units/s")
    ]

    @model_validator(mode="before")
    @classmethod
    def _bare(cls, value: Any) -> Any:
        """`formula: [a, b, c]` is `formula: {velocity: [a, b, c]}`."""
        given = value.get("velocity", []) if isinstance(value, dict) else value
        if isinstance(given, str | int | float):
            raise ValueError(f"{quote(given)} is not a list of three, such as [-y, x, 0]")
        return {"velocity": value} if isinstance(value, list) else value

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        bare = {"type": "array", "items": {"type": ["string", "number"]}, "minItems": 3, "maxItems": 3}
        return {"anyOf": [handler(core), bare]}

    def own_values(self, clock: Clock) -> dict[str, Any]:
        words = tuple(
            (name, value.curve(clock) if isinstance(value, Changing) else float(value))
            for name, value in self.numbers.items()
        )
        rate = {"fps": float(clock.rate.fps), "first": clock.frames.first}  # which `frame` counts by
        return {"texts": tuple(self.velocity), "words": words, **rate}

    @model_validator(mode="after")
    def _fits(self) -> Self:
        """Check that all numbers and `frame` fit the flow."""
        x, y, z = self.velocity
        FormulaField((x, y, z), tuple((name, 0.0) for name in self.numbers))
        return self
