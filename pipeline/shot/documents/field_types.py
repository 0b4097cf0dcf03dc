"""Types of values in shot files: strict numbers, names of a registry, vectors, colours and formulas."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self, TypeGuard, Union, get_args

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
    model_validator,
)
from pydantic_core import CoreSchema
from pydantic_core.core_schema import ValidatorFunctionWrapHandler, no_info_wrap_validator_function

from flowsculpt.pipeline.errors import quote, suggest
from flowsculpt.pipeline.flow.parameters import Vector, X, Y, Z
from flowsculpt.pipeline.flow.streamlines import MAX_SUBSTEPS
from flowsculpt.pipeline.formula import Expression
from flowsculpt.pipeline.plugin import plugins
from flowsculpt.pipeline.shot.yaml.document_validation import ParseContext, finding
from flowsculpt.pipeline.shot.yaml.messages import number_in
from flowsculpt.pipeline.shot.yaml.synonyms import value_meant
from flowsculpt.pipeline.shot.yaml.yaml_source import in_yaml
from flowsculpt.render.base.plural import indefinite, plural

DEGREE = math.radians(1.0)

ORIGIN = [0.0, 0.0, 0.0]

SMALLEST, LARGEST = 1e-9, 1e12
"""Bounds of measures and numbers: squares, inverses and differences stay finite."""


def _reported(value: Any, validate: ValidatorFunctionWrapHandler) -> Any:
    """Validate a value; turn an error of ours into a finding."""
    return ParseContext.attempt(lambda: validate(value))


class Document(BaseModel):
    """A mapping in a shot file: no unknown keys, no silent conversions.

    Its validators raise ValueError, or what reading files raises; messages name the place.

    what     the kind of file, for messages about its names at the top
    example  one that a shot can have, for messages; empty where its needed names are example enough
    """

    what: ClassVar[str] = "a shot"
    example: ClassVar[str] = ""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Report errors of ours, which validators raise, at the place of the document.

        The schema is wrapped in its place: references to it, and so the JSON Schema, stay as they are.
        """
        found = handler(source)
        schema: Any = handler.resolve_ref_schema(found)
        if schema["type"] != "function-wrap":
            inner = {name: value for name, value in schema.items() if name != "ref"}
            wrapped = no_info_wrap_validator_function(_reported, inner, ref=schema.get("ref"))
            schema.clear()
            schema.update(wrapped)
        return found

    def check_shot(self, shot: Any) -> None:
        """Check an entry of a plug-in against the `Shot` that has it; raise UsageError for what is wrong."""

    @classmethod
    def model_rebuild(cls, **given: Any) -> bool | None:
        """Build what validates; not where a generic document is only given a type.

        Pydantic builds the generic one too then, with the names that it passes; for most, nothing uses it.
        """
        is_given_type = given.get("_types_namespace") is not None and cls.__pydantic_fields_complete__
        return None if is_given_type else super().model_rebuild(**given)


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
    """An annotation of a union: a value is checked, and its faults are reported, as one member only.

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
            meant = value_meant(word, known)
            hint = f"Did you mean {meant!r}?" if meant else plugins().lacking(word) or suggest(word, known)
            raise ValueError(f"{quote(word)} is not {indefinite(kind)}. {hint}")
        return word

    return OneOf(check, known)


def exactly_one(*names: str) -> ConfigDict:
    """Return the JSON Schema of a document whose validator demands exactly one of these names."""
    return ConfigDict(json_schema_extra={"oneOf": [{"required": [name]} for name in names]})


class OneOfSeveral(Document):
    """A document that has exactly one of several names. Those are in `several`; messages call it `noun`."""

    noun: ClassVar[str]
    several: ClassVar[tuple[str, ...]]

    @property
    def named(self) -> list[str]:
        """The alternatives that are given: exactly one after validation."""
        return [name for name in self.several if getattr(self, name) is not None]

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        schema = handler.resolve_ref_schema(handler(core))
        schema |= {"oneOf": [{"required": [name]} for name in cls.several]} if cls.several else {}
        return schema

    @model_validator(mode="after")
    def _names_one(self) -> Self:
        if len(self.named) != 1:
            empty = [name for name in self.several if name in self.model_fields_set]
            if empty and not self.named:
                kinds = get_args(type(self).model_fields[empty[0]].annotation)
                has_settings = any(isinstance(kind, type) and issubclass(kind, Document) for kind in kinds)
                such_as = self.example or (has_settings and f"{{{empty[0]}: {{}}}} for its defaults")
                raise ValueError(f"{empty[0]} is empty. Write {such_as or 'its value'}.")
            fact = f"is one of {', '.join(self.several)}, and this has {' and '.join(self.named) or 'none'}"
            such_as = f", such as {self.example}" if self.example else ""
            raise ValueError(f"{self.noun} {fact}. Write one{such_as}.")
        return self


def _check_smallest(value: float) -> float:
    if value < SMALLEST:
        raise ValueError(
            f"{value:g} is too small to compute with; measures start at 1e-9. Write a larger one."
        )
    return value


def require_three(value: Any) -> Any:
    """Refuse what is no list of three, with a list that is."""
    if isinstance(value, list):
        if value and all(isinstance(item, list) for item in value):
            raise ValueError(
                "this is a list of places; a place that moves has keys. Write {keys: {1: "
                f"{in_yaml(value[0])}, 24: {in_yaml(value[-1])}}}}}."
            )
        if len(value) != 3:
            fact = (
                f"{in_yaml(value)} has {plural(len(value), 'number')}; it must have three, along x, y and z."
            )
            raise ValueError(f"{fact} Write {in_yaml(value[:3])}." if len(value) > 3 else fact)
    elif is_number(value):
        raise ValueError(f"{value} is one number; it must be three, along x, y and z. Write {[value] * 3}.")
    elif isinstance(value, dict) and {"x", "y", "z"} == set(value):
        raise ValueError(f"a place is a list. Write {in_yaml([value[name] for name in 'xyz'])}.")
    return value


def _require_axis(value: Any) -> Any:
    """Refuse numbers of axes and backward ones, with the vector that is meant."""
    if isinstance(value, str) and (match := re.fullmatch(r"(-?)\s*([xyzXYZ])", value)) and match[1]:
        vector_text = [-1 if name == match[2].lower() else 0 for name in "xyz"]
        raise ValueError(f"an axis that points backwards is a vector. Write {vector_text}.")
    if is_number(value):
        raise ValueError(f"{value} is not an axis. Write x, y, z or a vector, such as [0, 1, 1].")
    return value


def is_written_number(value: Any) -> bool:
    """Tell whether a value is text that begins like a number, such as 50% or 2 mm: a number is meant."""
    return isinstance(value, str) and number_in(value) is not None


Real = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[
    float, Field(gt=0, le=LARGEST), AfterValidator(_check_smallest), SchemaKeywords(minimum=SMALLEST)
]
"""A number above 0, such as a length."""

ZeroToOne = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=1, le=MAX_SUBSTEPS)]
Degrees = Annotated[float, Field(ge=-3600, le=3600)]
Triple = Annotated[list[Real], BeforeValidator(require_three), Field(min_length=3, max_length=3)]
"""Three numbers along x, y and z: a place, a direction or a size."""

AxisName = Annotated[str, one_of(("x", "y", "z"), "axis")]
AxisVector = Annotated[Triple, SchemaKeywords(**{"not": {"const": [0, 0, 0]}})]
Axis = Annotated[
    AxisName | AxisVector, ByForm(lambda value: isinstance(value, list)), BeforeValidator(_require_axis)
]


def vector(values: list[float]) -> Vector:
    x, y, z = values
    return float(x), float(y), float(z)


def axis(value: str | list[float]) -> Vector:
    return {"x": X, "y": Y, "z": Z}[value] if isinstance(value, str) else vector(value)


def is_number(value: Any) -> bool:
    """Tell whether a value of a file is a number; true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def is_triple(value: Any) -> TypeGuard[list[float]]:
    """Tell whether a value of a file is a list of three numbers."""
    return isinstance(value, list) and len(value) == 3 and all(map(is_number, value))


def formula_over(names: tuple[str, ...]) -> AfterValidator:
    """Return a validator of text that must be a formula over these names."""
    return AfterValidator(lambda text: Expression(text, names).text)


NumberOrText = Annotated[
    str, BeforeValidator(Expression.number_text), SchemaKeywords(type=["string", "number"])
]
"""Text of a formula, which may be a number."""


HEX_PATTERN = r"^#([0-9a-fA-F]{3}|[0-9a-fA-F]{6})$"
"""JSON Schema pattern of a colour such as #c04020 or #c42."""

WORDS = {
    "black": "'#141414'",
    "blue": "'#2850b4'",
    "brown": "'#6e4628'",
    "gray": "'#808080'",
    "green": "'#328c46'",
    "grey": "'#808080'",
    "orange": "'#dc7828'",
    "pink": "'#e696aa'",
    "purple": "'#6e3c96'",
    "red": "'#b4281e'",
    "white": "'#e6e6e6'",
    "yellow": "'#e1be32'",
}
"""Colours that messages propose for words of daily English, as a shot file writes them."""

_HEX = re.compile(r"#?((?=.*\d)[0-9a-fA-F]{3}|(?=.*\d)[0-9a-fA-F]{6}|(?<=#)([0-9a-fA-F]{3,4}){1,2})")
_RGB = re.compile(r"rgba?\(\s*(\d+)\s*,\s*(\d+)\s*,\s*(\d+)")


def is_hex(value: Any) -> bool:
    """Tell whether a value is meant as a colour of sRGB: text that begins with #."""
    return isinstance(value, str) and value.startswith("#")


def linear_of_hex(text: str) -> list[float]:
    """Return linear Rec.709 of a hexadecimal colour of sRGB. Raises an error for pydantic for other text."""
    digits = text.removeprefix("#")
    if not re.fullmatch(HEX_PATTERN, text):
        raise _not_a_colour(text)
    if len(digits) == 3:
        digits = "".join(2 * digit for digit in digits)
    return [_linear(int(digits[i : i + 2], 16) / 255.0) for i in (0, 2, 4)]


def _linear(value: float) -> float:
    """Decode sRGB (IEC 61966-2-1), rounded so that a colour has the same digits on every machine."""
    return round(value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4, 9)


def parsed_colour(value: Any) -> Any:
    """Return a colour as three numbers; refuse other forms, with the colour that is meant."""
    if isinstance(value, str):
        return linear_of_hex(value)
    if isinstance(value, list):
        whole = all(isinstance(part, int) and 0 <= part <= 255 for part in value)
        if len(value) != 4 and not (len(value) == 3 and whole and max(value) > 16):
            return value
    if is_number(value) or _meant_colour(value) is not None:
        raise _not_a_colour(value)
    return value


def _not_a_colour(value: Any) -> ValueError:
    meant = _meant_colour(value) or (in_yaml([value] * 3) if is_number(value) else None)
    rule = "it is red, green and blue from 0 to 1, linear and without alpha, or sRGB in quotes, as '#c04020'"
    fact = f"{quote(value) if isinstance(value, str) else in_yaml(value)} is not a colour"
    return ValueError(f"{fact}; {rule}.{f' Write {meant}.' if meant else ''}")


def _meant_colour(value: Any) -> str | None:
    """Return the colour that a value means, as a shot file writes it; None where it means no colour."""
    if isinstance(value, dict) and [str(name).lower() for name in value] in (list("rgb"), list("rgba")):
        value = list(value.values())
    if isinstance(value, list) and len(value) in (3, 4) and all(map(is_number, value)):
        if all(0 <= part <= 1 for part in value):
            return in_yaml(value[:3])
        return _hex(value) if min(value) >= 0 else None
    if isinstance(value, int) and not isinstance(value, bool) and 255 < value < 2**24:
        return f"'#{value}'" if len(str(value)) == 6 else f"'#{value:06x}'"  # its digits, or 0xc04020
    if not isinstance(value, str):
        return None
    if rgb := _RGB.match(value):
        return _hex(list(map(int, rgb.groups())))
    if not (match := _HEX.fullmatch(value)):
        return WORDS.get(value.lower())
    return f"'#{match[1][:3] if len(match[1]) < 5 else match[1][:6]}'"


def _hex(values: list[float]) -> str:
    return f"'#{''.join(f'{min(round(value), 255):02x}' for value in values[:3])}'"


def no_bare_colour(entry: str, beginning: str) -> BeforeValidator:
    """Return a validator that refuses a colour where the name or the mapping of an entry must stand.

    `beginning` is the item of the mapping before the colour: `material: clay`.
    """

    def check(value: Any) -> Any:
        if (colour := _meant_colour(value)) is not None:
            raise finding(
                f"{entry} is a colour; it must be a name or a mapping. "
                f"Write {entry}: {{{beginning}, colour: {colour}}}."
            )
        return value

    return BeforeValidator(check)


ColourParts = Annotated[list[ZeroToOne], Field(min_length=3, max_length=3)]

Colour = Annotated[
    ColourParts, BeforeValidator(parsed_colour), SchemaKeywords(type=["array", "string"], pattern=HEX_PATTERN)
]
"""Three numbers, linear Rec.709, or a text of sRGB; validated it is three numbers."""
